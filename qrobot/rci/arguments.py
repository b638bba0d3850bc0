"""Arguments that the calls of several programming libraries have, each refused with the name of its call."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, nan
from typing import Final, SupportsFloat

from qrobot.config import Robot
from qrobot.config.collision import NO_TORQUES, threshold_objection
from qrobot.errors import MotionError
from qrobot.units import M_PER_MM
from qrobot.wire import Collision, CollisionReaction, Payload

MOST_BACK_MM: Final = 300.0  # [A] after a collision


def numbers(call: str, *values: object) -> tuple[float, ...]:
    """The arguments of a call. Raises MotionError when one is no finite number."""
    found = [as_float(value) for value in values]
    for value, number in zip(values, found, strict=True):
        if not isfinite(number):
            raise MotionError(f"{call}: {shown(value)} is not a finite number")
    return tuple(found)


def as_float(value: object) -> float:
    """A number as a float; NaN for what is none, and for a whole number that no float is as large as."""
    try:
        return float(value) if isinstance(value, SupportsFloat) else nan
    except (OverflowError, TypeError, ValueError):  # a whole number of 400 digits, several numbers, a text
        return nan


def shown(value: object) -> str:
    """Text of what was given: as Python writes it, unless it has a whole number of more digits than that writes."""
    try:
        return repr(value)
    except ValueError:  # 4300 digits
        return "a number of thousands of digits"


def payload_of(call: str, kg: float, centre: Sequence[float], inertia: Sequence[float]) -> Payload:
    """A load: mass, and in the frame of the flange centre of mass, mm, shape (3,), and inertia, kg m^2, shape (6,).

    Raises:
        MotionError: no such numbers, or not so many. Whether an arm can carry it, its servo knows.
    """
    mass, *at = numbers(call, kg, *centre)
    moments = numbers(call, *inertia)
    if len(at) != 3 or len(moments) != 6:
        raise MotionError(f"{call}: a centre has 3 numbers, mm, and an inertia 6, kg m^2: xx yy zz xy xz yz")
    return Payload(mass, tuple(M_PER_MM * x for x in at), tuple(moments))


def retract_m(call: str, mm: float) -> float:
    """A way back from what the arm has met, m. Raises MotionError: it is none, or too long."""
    (mm,) = numbers(call, mm)
    if not 0.0 <= mm <= MOST_BACK_MM:
        raise MotionError(f"{call}({mm:g}): 0 to {MOST_BACK_MM:g} mm are possible")
    return mm * M_PER_MM


def require_torques(call: str, known: bool) -> None:
    """Raise MotionError for a call that acts by torques, of an arm whose torques are not `known`."""
    if not known:
        raise MotionError(f"{call}: {NO_TORQUES}")


def collision_of(call: str, robot: Robot, reaction: str, thresholds: Sequence[float] | None, *others: str) -> Collision:
    """The reaction of `robot` to a collision, and torques by which one is told, N m (N), shape (n,); None: its file's.

    `others` are reactions that the call has besides.

    Raises:
        MotionError: there is no such reaction, or the arm does not take such thresholds.
    """
    reactions = {each.name.lower(): each for each in CollisionReaction}
    if reaction not in reactions:
        raise MotionError(f"{call}: {reaction!r} is none of {', '.join([*reactions, *others])}")
    asked = numbers(call, *([0.0] * robot.n if thresholds is None else thresholds))
    objection = "" if thresholds is None or all(asked) else "a threshold is a torque above 0"
    if objection := objection or threshold_objection(robot, asked):
        raise MotionError(f"{call}: {objection}")
    return Collision(asked, reactions[reaction])
