"""A motion request holds everything its segment needs, so that what happens after the call cannot change it (A-21).

Times come in two ways, as in RCCL: the time the segment takes, or a speed from which the time follows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import ceil, floor
from typing import Final, Protocol

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.branch import Branch
from qrobot.motion.world.compliance import ForceLimits
from qrobot.motion.world.drive_transform import OrientationInterpolation
from qrobot.motion.world.equation import Goal
from qrobot.motion.world.limits import MotionLimits

TURN_PER_MM: Final = 0.5  # [A] degrees/s for each mm/s, where one speed is asked for and the other is not
_MOST_SAMPLES: Final = 1e9  # [A] of a motion: eleven days of a millisecond each
_ROUNDING: Final = 1e-9  # in samples: a time that is a whole number of them stays that number


def whole_samples(seconds: float, period_s: float) -> int:
    """The nearest whole number of samples, at least one (as ARCL's execution trace shows: 100 ms at 56 ms are 2)."""
    return max(1, floor(_bounded(seconds / period_s) + 0.5))


def enough_samples(seconds: float, period_s: float) -> int:
    """The smallest whole number of samples that lasts `seconds`, at least one."""
    return max(1, ceil(_bounded(seconds / period_s) - _ROUNDING))


def _bounded(samples: float) -> float:
    if not samples < _MOST_SAMPLES:
        raise MotionError("a motion would take more samples than can be counted; ask for more speed")
    return samples


def _positive(value: float, what: str) -> None:
    if not 0.0 < value < float("inf"):
        raise MotionError(f"{what} must be positive and finite, not {value}")


@dataclass(frozen=True, eq=False)
class Displacement:
    """Length of one segment, from via point to via point.

    Attributes:
        joints: how far each joint goes. Shape (n,).
        tool: DRIVE of the controlled frame. Shape (6,); None when the kinematics are not known.
    """

    joints: Floats
    tool: Floats | None = None


class MotionSpeed(Protocol):
    """Rule for the length of a segment; those below, or a library's own."""

    def samples(self, displacement: Displacement, limits: MotionLimits, period_s: float, /) -> int:
        """Samples from via point to via point, at least one."""


@dataclass(frozen=True)
class Duration:
    """The segment lasts `seconds`, rounded to whole samples."""

    seconds: float

    def __post_init__(self) -> None:
        _positive(self.seconds, "the time of a motion")

    def samples(self, _transition: Displacement, _limits: MotionLimits, period_s: float) -> int:
        """Samples from via point to via point."""
        return whole_samples(self.seconds, period_s)


@dataclass(frozen=True)
class JointSpeed:
    """The fastest joint moves at `speed`, in rad/s or m/s; the others arrive together with it."""

    speed: float

    def __post_init__(self) -> None:
        _positive(self.speed, "the speed of a motion")

    def samples(self, displacement: Displacement, _limits: MotionLimits, period_s: float) -> int:
        """Samples from via point to via point, rounded up: never faster than asked."""
        return enough_samples(float(np.abs(displacement.joints).max()) / self.speed, period_s)


@dataclass(frozen=True)
class SpeedShare:
    """The joint that is busiest for its own limit moves at `share` of that limit, 0 to 1.

    At reduced speed it is a share of the full speed still, as far as the limits in force allow.
    """

    share: float

    def __post_init__(self) -> None:
        if not 0.0 < self.share <= 1.0:
            raise MotionError(f"the share of the joints' speed must be above 0 and at most 1, not {self.share}")

    def samples(self, displacement: Displacement, limits: MotionLimits, period_s: float) -> int:
        """Samples from via point to via point, rounded up: never faster than asked."""
        least_s = float((np.abs(displacement.joints) / limits.v_max).max())
        return enough_samples(max(least_s, least_s * limits.reduction / self.share), period_s)


@dataclass(frozen=True)
class ToolSpeed:
    """The controlled frame moves at `linear` m/s or turns at `angular` rad/s, whichever takes longer (A-18)."""

    linear: float
    angular: float

    def __post_init__(self) -> None:
        _positive(self.linear, "the speed of the tool")
        _positive(self.angular, "the turning speed of the tool")

    def samples(self, displacement: Displacement, _limits: MotionLimits, period_s: float) -> int:
        """Samples from via point to via point, rounded up: never faster than asked.

        Raises:
            MotionError: no kinematics.
        """
        if displacement.tool is None:
            raise MotionError("a tool speed needs the arm's kinematics, which were not given")
        distance, turn = (float(np.linalg.norm(part)) for part in (displacement.tool[:3], displacement.tool[3:]))
        return enough_samples(max(distance / self.linear, turn / self.angular), period_s)


class MotionMode(Enum):
    """Coordinates in which the way is straight."""

    JOINT = "joint"
    CARTESIAN = "cartesian"


class Here(Enum):
    """The position that is always the arm's own: a motion to it is an absolute stop (A-33)."""

    HERE = "here"


HERE: Final = Here.HERE


@dataclass(frozen=True, eq=False)
class MoveRequest:
    """Move all joints together to `target`.

    Attributes:
        name: for people and traces.
        target: joint positions, rad or m, shape (n,), copied and made read-only; or the goal of an equation; or HERE.
        speed: how long the segment takes.
        transition_s: Ta, half the time of the transition that leads into this segment; None takes the default and
            lengthens it as the arm needs.
        mode: how to get to a goal; joint positions are gone to in joint mode always.
        branch: configuration at the goal; None keeps the present one. Only joint mode can change it.
        monitor: called at each sample while the request is served; a true result, a positive whole number, ends it
            with that code (A-37).
        limits: forces and displacements that end it.
        turn: how orientations are interpolated in Cartesian mode.
        stay_s: at HERE: how long the arm stands at least, once it has come to rest; path time, as all of a motion.
    """

    name: str
    target: Floats | Goal | Here
    speed: MotionSpeed
    transition_s: float | None = None
    mode: MotionMode = MotionMode.JOINT
    branch: Branch | None = None
    monitor: Callable[[], object] | None = None
    limits: ForceLimits | None = None
    turn: OrientationInterpolation = OrientationInterpolation.ONE_AXIS
    stay_s: float = 0.0

    def __post_init__(self) -> None:
        if isinstance(self.target, np.ndarray):
            target = np.array(self.target, dtype=np.float64)
            target.flags.writeable = False
            object.__setattr__(self, "target", target)
        if self.transition_s is not None and not 0.0 <= self.transition_s < float("inf"):
            raise MotionError(f"{self.name}: the transition time must not be negative, nor {self.transition_s}")
        if not 0.0 <= self.stay_s < float("inf"):
            raise MotionError(f"{self.name}: an arm stands for no less than no time, not for {self.stay_s} s")

    def ask_monitor(self) -> int:
        """The code with which the monitor ends the motion at this sample, 0 for going on.

        Raises:
            MotionError: it returned something true that is no code.
            Exception: whatever it raised.
        """
        result = None if self.monitor is None else self.monitor()
        return code_of(self.name, result) if result else 0


def code_of(name: str, result: object) -> int:
    """The code that a monitor returned. Raises MotionError: it is not positive, so it could be one of our own."""
    try:
        code: int = int(result)  # type: ignore[call-overload]
    except (TypeError, ValueError, OverflowError):
        code = 0
    if code <= 0 or code != result:
        raise MotionError(
            f"motion to {name}: its monitor (`evalfn`) returned {result!r}, which is no code; return a positive whole "
            "number, or True, to end the motion, and 0 or nothing to go on"
        )
    return code
