"""Setpoints from a list, one each sample, with a stop at any instant."""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.world.limits import MotionLimits


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
