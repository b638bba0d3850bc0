"""Speed override: how fast path time passes. The path stays what it is, and so does every place on it.

The rate r of path time goes from one value to another as a cubic of time, with the slope that it has and without one at
the end (h = t/D, c = D r'(0)):

    r(t) = r0 + c (h - 2 h^2 + h^3) + (r1 - r0) (3 h^2 - 2 h^3)
    s(t) = integral of r = D (r0 h + c (h^2/2 - 2 h^3/3 + h^4/4) + (r1 - r0) (h^3 - h^4/2))

Joint velocities are those of the path times r, accelerations those times r^2, and velocities of the path times r'. D is
so long that the last part stays within a share of what the joints can do in a stop.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from qrobot.motion.world.limits import MotionLimits

FULL_SPEED: Final = 1.0
SHORTEST_S: Final = 0.3  # [A] of a change, however small
SHARE: Final = 0.25  # [A] of a_stop, for the change of speed alone
_PEAK: Final = 1.5  # largest slope of 3 h^2 - 2 h^3
_ROOM: Final = 3.0  # a cubic stays between two values while its first slope is at most so many times the room there


class _Ramp(NamedTuple):
    """A change of the rate: of r0 with slope c/D to r1, in D samples, of which `elapsed` are gone."""

    r0: float
    c: float
    r1: float
    length: float
    elapsed: float


class SpeedOverride:
    """Rate of path time of one arm, 0 to 1.

    Args:
        limits: of the joints.
        period_s: sample period.

    Attributes:
        rate: samples of path time in a sample, now.
        slope: its change per sample.
    """

    def __init__(self, limits: MotionLimits, period_s: float) -> None:
        self.rate, self.slope = FULL_SPEED, 0.0
        self._shortest = SHORTEST_S / period_s
        self._whole = _PEAK * float((limits.v_max / limits.a_stop).max()) / (SHARE * period_s)
        self._ramp: _Ramp | None = None

    @property
    def full(self) -> bool:
        """Path time passes as the clock does."""
        return self.rate == FULL_SPEED and self._ramp is None

    def jump(self, rate: float) -> None:
        """Take a rate at once: for an arm that stands, or whose motion is given another form."""
        self.rate, self.slope, self._ramp = rate, 0.0, None

    def advance(self, ticks: float, wanted: float) -> float:
        """Let `ticks` samples pass on the way to the rate `wanted`; the path time that passes in them."""
        if self._ramp is None and self.rate == wanted:
            return ticks if wanted == FULL_SPEED else ticks * wanted
        self._turn_to(wanted)
        passed = 0.0
        while ticks > 0.0 and self._ramp is not None:
            step = min(ticks, self._ramp.length - self._ramp.elapsed)
            passed += self._pass(self._ramp, step)
            ticks -= step
        return passed + ticks * self.rate

    def _turn_to(self, wanted: float) -> None:
        """Begin to change to `wanted`, unless a change under way has to be finished before, or leads there."""
        if self._ramp is not None and self._ramp.r1 == wanted:
            return
        length = max(self._shortest, abs(wanted - self.rate) * self._whole)
        c = self.slope * length
        if -_ROOM * self.rate <= c <= _ROOM * (FULL_SPEED - self.rate) or self._ramp is None:
            self._ramp = _Ramp(self.rate, c, wanted, length, 0.0)

    def _pass(self, ramp: _Ramp, step: float) -> float:
        """Go on by `step` samples in a change; the path time that passes."""
        r0, c, r1, length, elapsed = ramp
        before = _integral(ramp, elapsed / length)
        elapsed += step
        h = elapsed / length
        if elapsed >= length:
            self.jump(r1)
            return length * (_integral(ramp, 1.0) - before)
        self._ramp = ramp._replace(elapsed=elapsed)
        self.rate = r0 + c * h * (1.0 + h * (h - 2.0)) + (r1 - r0) * h * h * (3.0 - 2.0 * h)
        self.slope = (c * (1.0 + h * (3.0 * h - 4.0)) + (r1 - r0) * 6.0 * h * (1.0 - h)) / length
        return length * (_integral(ramp, h) - before)


def _integral(ramp: _Ramp, h: float) -> float:
    """Path time since the change began, as a share of its length."""
    r0, c, r1, _, _ = ramp
    return r0 * h + c * h * h * (0.5 + h * (0.25 * h - 2.0 / 3.0)) + (r1 - r0) * h * h * h * (1.0 - 0.5 * h)
