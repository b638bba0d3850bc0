"""Values of variables: numbers, transformations and precision points; how they are written down."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ProgramError
from qrobot.model.orientation import oat, oat_angles
from qrobot.model.transform import transform
from qrobot.units import DEG_PER_RAD, M_PER_MM, MM_PER_M, RAD_PER_DEG

TRUE: Final = -1.0
FALSE: Final = 0.0
STORED_DIGITS: Final = 9  # behind the point, of mm and degrees [A]: far finer than any arm
LARGEST_NUMBER: Final = 1e6  # mm or degrees of a location [A]: a kilometre, some thousand turns


@dataclass(frozen=True, eq=False)
class Transformation:
    """A location by its pose.

    Attributes:
        T: from the frame it is given in, m. Shape (4, 4).
        numbers: x, y, z (mm) and o, a, t (degrees) by which it was given; None where it was computed.
    """

    T: Floats
    numbers: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        """Raise ProgramError: the place is farther away than any that arms are used in."""
        within_reason((self.T[:3, 3] * MM_PER_M).tolist())


@dataclass(frozen=True, eq=False)
class JointLocation:
    """A precision point.

    Attributes:
        q: joint positions, rad or m. Shape (n,).
    """

    q: Floats


def within_reason(numbers: Sequence[float]) -> Sequence[float]:
    """The same mm, degrees or factors. Raises ProgramError: one is larger than a place or a turn can need."""
    for number in numbers:
        if not abs(number) <= LARGEST_NUMBER:
            raise ProgramError(f"{number:g} is too large for a location: numbers go up to {LARGEST_NUMBER:,.0f}")
    return numbers


ValValue: TypeAlias = "float | Transformation | JointLocation"


def transformation(numbers: Sequence[float]) -> Transformation:
    """The location of x, y, z (mm), o, a, t (degrees)."""
    x, y, z, o, a, t = within_reason(numbers)
    rotation = oat(o * RAD_PER_DEG, a * RAD_PER_DEG, t * RAD_PER_DEG)
    return Transformation(transform(rotation, M_PER_MM * np.array([x, y, z])), (x, y, z, o, a, t))


def numbers_of(T: Floats) -> tuple[float, ...]:
    """x, y, z (mm) and o, a, t (degrees) of a pose (4, 4)."""
    angles = [angle * DEG_PER_RAD for angle in oat_angles(T[:3, :3])]
    return (*(float(x) for x in T[:3, 3] * MM_PER_M), *(float(angle) for angle in angles))


def joint_units(robot: Robot) -> Floats:
    """The factor from degrees (mm on a sliding joint) to SI units. Shape (n,)."""
    return np.where(robot.prismatic, M_PER_MM, RAD_PER_DEG)


def check_joint_count(what: str, count: int, robot: Robot) -> None:
    """Raise ProgramError when a precision point has not as many numbers as the arm has joints."""
    if count != robot.n:
        raise ProgramError(f"{what}: {robot.name} has {robot.n} joints, not {count}")


def joint_location(what: str, degrees: Sequence[float], robot: Robot) -> JointLocation:
    """A precision point of joints in degrees (mm on a sliding joint). Raises ProgramError: not those of this arm."""
    check_joint_count(what, len(degrees), robot)
    return JointLocation(np.array(within_reason(degrees), dtype=np.float64) * joint_units(robot))


def stored_location(name: str, numbers: Sequence[float], robot: Robot) -> Transformation | JointLocation:
    """The location of numbers that a file holds. Raises ProgramError: they are not those of one of this arm."""
    return joint_location(f"location {name}", numbers, robot) if name.startswith("#") else transformation(numbers)


def stored_numbers(value: Transformation | JointLocation, robot: Robot) -> tuple[float, ...]:
    """The numbers that a file holds of a location: those by which it was given, without what rounding adds."""
    if isinstance(value, JointLocation):
        numbers = tuple(float(x) for x in value.q / joint_units(robot))
    else:
        numbers = value.numbers or numbers_of(value.T)
    return tuple(round(number, STORED_DIGITS) + 0.0 for number in numbers)  # and no -0
