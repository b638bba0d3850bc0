"""The position loop inside an emulated drive: what the drive's maker builds, tuned as somebody on the spot would."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

FULL_TORQUE: Final = 1000.0  # thousandths of the rated torque
INTEGRAL_SHARE: Final = 0.03  # of the gain, a cycle: takes a load up in some hundredths of a second [A]
RATE_SHARE: Final = 0.35  # of a new rate: a low pass of 40 Hz at 500 cycles a second, for positions are whole counts
SLOWING: Final = 0.85  # of the speed is left after a cycle of a quick stop: two hundredths of a second at 500 Hz [A]


@dataclass
class PositionLoop:
    """PID with the target's speed fed forward, once a cycle; everything in increments, cycles and thousandths.

    Attributes:
        gain: torque for an increment of error.
        damping: torque for an increment a cycle of too little speed.
        limit: most torque it gives.
    """

    gain: float
    damping: float
    limit: float = FULL_TORQUE
    _target: float = 0.0
    _speed: float = 0.0
    _position: int = 0
    _rate: float = 0.0
    _integral: float = 0.0

    def rest(self, position: int) -> None:
        """The motor is not driven: the loop begins anew from where it is."""
        self._target, self._position = float(position), position
        self._speed = self._rate = self._integral = 0.0

    def follow(self, target: int, position: int) -> int:
        """Torque of a cycle that leads to `target`."""
        self._speed = target - self._target
        return self._drive(float(target), position)

    def slow_down(self, position: int) -> int:
        """Torque of a cycle of a quick stop."""
        self._speed *= SLOWING
        return self._drive(self._target + self._speed, position)

    def _drive(self, target: float, position: int) -> int:
        self._rate += RATE_SHARE * (position - self._position - self._rate)
        self._target, self._position = target, position
        error = target - position
        self._integral += INTEGRAL_SHARE * self.gain * error
        self._integral = min(max(self._integral, -self.limit), self.limit)
        torque = self.gain * error + self.damping * (self._speed - self._rate) + self._integral
        return round(min(max(torque, -self.limit), self.limit))
