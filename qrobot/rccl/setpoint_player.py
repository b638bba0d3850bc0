"""Setpoints from a list, one each sample, with a stop at any instant."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.fences.fence_set import FenceSet
from qrobot.motion.world.limits import MotionLimits
from qrobot.rccl.setpoints import Setpoints

START_TOLERANCE: Final = 1e-4  # rad or m, between the arm's setpoint and the first of a list


def check_fit(setpoints: Setpoints, robot: str, period_s: float, label: str) -> None:
    """Raise MotionError when setpoints are for another robot, or another sample period."""
    if setpoints.robot != robot:
        raise MotionError(f"{label}: made for {setpoints.robot}, this is {robot}")
    if setpoints.period_us != round(period_s * 1e6):
        periods = f"{setpoints.period_us / 1e3:g} ms from one to the next, the sample period is"
        raise MotionError(f"{label}: {periods} {period_s * 1e3:g} ms")


def check_start(q: Floats, here: Floats, limits: MotionLimits, label: str) -> None:
    """Raise MotionError when setpoints that begin at `q` (n,) do not begin where the arm is, `here` (n,)."""
    away = np.abs(q - here)
    if (away > START_TOLERANCE).any():
        j = int(away.argmax())
        far = f"{away[j]:.4g} {'m' if limits.prismatic[j] else 'rad'}"
        where = f"joint {j + 1} ({limits.names[j]}) stands {far} away"
        raise MotionError(f"{label}: does not begin where the arm is: {where}; move there first")


def check_fences(q: Floats, fences: FenceSet | None, label: str) -> None:
    """Raise FenceCrossed when one of the setpoints (k, n) is too near a fence."""
    if fences is None:
        return
    floor = fences.floor(q[0])
    for number, row in enumerate(q):
        fences.check(row, floor, label, number / len(q))


class SetpointPlayer:
    """Plays a motion that was judged before.

    Args:
        q: setpoints, rad or m. Shape (samples, n).
        period_s: from one to the next.
        limits: of the arm; a stop slows the motion down within the time in which any joint comes to rest.
    """

    def __init__(self, q: Floats, period_s: float, limits: MotionLimits) -> None:
        self._q = q
        self._clock, self._rate, self._braking = 0.0, 1.0, 0.0
        self._brake_step = period_s / float((limits.v_max / limits.a_max).max())

    @property
    def done(self) -> bool:
        """The arm was sent to the last setpoint, or has stopped before."""
        return self._clock > len(self._q) - 1 or self._rate <= 0.0

    def step(self) -> Floats:
        """The next setpoint. Shape (n,)."""
        q = self._between(min(self._clock, len(self._q) - 1.0))
        self._rate = max(0.0, self._rate - self._braking)
        self._clock += self._rate
        return q

    def stop(self) -> None:
        """Come to rest on the path."""
        self._braking = self._brake_step

    def _between(self, clock: float) -> Floats:
        """The cubic through the neighbours' mid slopes (Catmull and Rom); the list itself at whole numbers."""
        i = int(clock)
        s = clock - i
        before, here, after, beyond = (self._q[min(max(k, 0), len(self._q) - 1)] for k in range(i - 1, i + 3))
        start, end = (after - before) / 2, (beyond - here) / 2
        gap = after - here
        q: Floats = here + s * (start + s * (3 * gap - 2 * start - end + s * (start + end - 2 * gap)))
        return np.asarray(q)
