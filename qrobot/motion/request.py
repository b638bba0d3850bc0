"""A motion request holds everything its segment needs, so that what happens after the call cannot change it (A-21).

Times come in two ways, as in RCCL: the time the segment takes, or a speed from which the time follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, floor
from typing import Final, TypeAlias

import numpy as np

from qrobot.errors import MotionError
from qrobot.motion.limits import Floats, MotionLimits

_ROUNDING: Final = 1e-9  # in samples: a time that is a whole number of them stays that number


def whole_samples(seconds: float, period_s: float) -> int:
    """The nearest whole number of samples, at least one (as ARCL's execution trace shows: 100 ms at 56 ms are 2)."""
    return max(1, floor(seconds / period_s + 0.5))


def enough_samples(seconds: float, period_s: float) -> int:
    """The smallest whole number of samples that lasts `seconds`, at least one."""
    return max(1, ceil(seconds / period_s - _ROUNDING))


def _positive(value: float, what: str) -> None:
    if not 0.0 < value < float("inf"):
        raise MotionError(f"{what} must be positive and finite, not {value}")


@dataclass(frozen=True)
class Duration:
    """The segment lasts `seconds`, rounded to whole samples."""

    seconds: float

    def __post_init__(self) -> None:
        _positive(self.seconds, "the time of a motion")

    def samples(self, _distance: Floats, _limits: MotionLimits, period_s: float) -> int:
        """Samples from corner to corner."""
        return whole_samples(self.seconds, period_s)


@dataclass(frozen=True)
class JointSpeed:
    """The fastest joint moves at `speed`, in rad/s or m/s; the others arrive together with it."""

    speed: float

    def __post_init__(self) -> None:
        _positive(self.speed, "the speed of a motion")

    def samples(self, distance: Floats, _limits: MotionLimits, period_s: float) -> int:
        """Samples from corner to corner, rounded up: never faster than asked."""
        return enough_samples(float(np.abs(distance).max()) / self.speed, period_s)


@dataclass(frozen=True)
class SpeedShare:
    """The joint that is busiest for its own limit moves at `share` of that limit, 0 to 1."""

    share: float

    def __post_init__(self) -> None:
        if not 0.0 < self.share <= 1.0:
            raise MotionError(f"the share of the joints' speed must be above 0 and at most 1, not {self.share}")

    def samples(self, distance: Floats, limits: MotionLimits, period_s: float) -> int:
        """Samples from corner to corner, rounded up: never faster than asked."""
        return enough_samples(float((np.abs(distance) / limits.v_max).max()) / self.share, period_s)


Pace: TypeAlias = Duration | JointSpeed | SpeedShare


@dataclass(frozen=True, eq=False)
class MoveRequest:
    """Move all joints together to `target`.

    Attributes:
        name: for people and traces.
        target: joint positions, rad or m. Shape (n,). Copied and made read-only.
        pace: how long the segment takes.
        transition_s: Ta, half the time of the transition that leads into this segment; None takes the default and
            lengthens it as the arm needs.
    """

    name: str
    target: Floats
    pace: Pace
    transition_s: float | None = None

    def __post_init__(self) -> None:
        target = np.array(self.target, dtype=np.float64)
        target.flags.writeable = False
        object.__setattr__(self, "target", target)
        if self.transition_s is not None and not 0.0 <= self.transition_s < float("inf"):
            raise MotionError(f"{self.name}: the transition time must not be negative, nor {self.transition_s}")
