"""Setpoints from a list, one each sample; slower or standing at the override, with a stop at any instant."""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.trajectory.speed_override import FULL_SPEED, SpeedOverride
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
        self._clock = 0.0  # of the list: its setpoints at whole numbers
        self._tick: int | None = None  # the newest sample; None before the first
        self._override = SpeedOverride(limits, period_s)
        self._stopping = False
        # Between rows the curve may swing out beyond them, by a fourteenth of a row: not beyond the range.
        self._ends = np.minimum(limits.q_min, q.min(axis=0)), np.maximum(limits.q_max, q.max(axis=0))
        self._brake_step = period_s / float((limits.v_max / limits.a_max).max())

    @property
    def done(self) -> bool:
        """The arm was sent to the last setpoint, or has stopped before."""
        return self._clock >= len(self._q) - 1 or (self._stopping and self._override.rate <= 0.0)

    @property
    def rate(self) -> float:
        """Setpoints of the list in a sample, now."""
        return self._override.rate

    @property
    def moves(self) -> bool:
        """The arm is under way."""
        return self._tick is not None and self.rate > 0.0 and not self.done

    def step(self, tick: int, override: float = FULL_SPEED) -> Floats:
        """The setpoint of sample `tick`; time has passed in those that were left out as well. Shape (n,).

        `override` is the rate at which the list is to pass, 0 to 1: below 1 there are setpoints between its rows.
        """
        if self._tick is None:
            self._override.jump(0.0 if self._stopping else override)
        elif self._stopping:
            self._brake(tick - self._tick)
        else:
            self._clock += self._override.advance(float(tick - self._tick), override)
        self._tick = tick
        return np.clip(self._between(min(self._clock, len(self._q) - 1.0)), *self._ends)

    def stop(self) -> None:
        """Come to rest on the path."""
        self._stopping = True

    def _brake(self, samples: int) -> None:
        while samples > 0 and self.rate > 0.0:
            self._override.jump(max(0.0, self.rate - self._brake_step))
            self._clock += self.rate
            samples -= 1

    def _between(self, clock: float) -> Floats:
        """The cubic through the neighbours' mid slopes (Catmull and Rom); the list itself at whole numbers."""
        i = int(clock)
        s = clock - i
        before, here, after, beyond = (self._q[min(max(k, 0), len(self._q) - 1)] for k in range(i - 1, i + 3))
        start, end = (after - before) / 2, (beyond - here) / 2
        gap = after - here
        q: Floats = here + s * (start + s * (3 * gap - 2 * start - end + s * (start + end - 2 * gap)))
        return np.asarray(q)
