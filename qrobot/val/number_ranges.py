"""Numbers that steps take. Each function raises ProgramError for one that it does not, else it gives the number."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from qrobot.errors import ProgramError
from qrobot.rci.arguments import MOST_BACK_MM
from qrobot.val import tree

FASTEST: Final = 1000.0  # of SPEED, per cent or mm/s
LONGEST_DELAY_S: Final = 86_400.0  # a day [A]
LONGEST_HAND_TIME_S: Final = 60.0
LEAST_COLLISION: Final = 1.0  # percent [A]
FILES_OWN: Final = 100.0  # percent of the thresholds of a collision in the robot file
MOST_TIMERS: Final = 15


def speed(value: float) -> float:
    """The number of a SPEED or a DRIVE."""
    if not 0.0 < value <= FASTEST:
        raise ProgramError(f"SPEED: a number above 0 and up to {FASTEST:g} is needed, not {value:g}")
    return value


def delay(seconds: float) -> float:
    """The number of a DELAY."""
    if not 0.0 <= seconds <= LONGEST_DELAY_S:
        raise ProgramError(f"DELAY: expected 0 to {LONGEST_DELAY_S:.0f} seconds, not {seconds:g}")
    return seconds


def joint(number: float, joints: int) -> int:
    """The joint of a DRIVE, from 1."""
    if number != int(number) or not 1 <= number <= joints:
        raise ProgramError(f"DRIVE: joints are 1 to {joints}, not {number:g}")
    return int(number)


def timer(number: float) -> int:
    """The number of a timer."""
    if number != int(number) or not 0 <= number <= MOST_TIMERS:
        raise ProgramError(f"timers are 0 to {MOST_TIMERS}, not {number:g}")
    return int(number)


def hand_time(seconds: float) -> float:
    """The number of PARAMETER HAND.TIME."""
    if not 0.0 <= seconds <= LONGEST_HAND_TIME_S:
        raise ProgramError(f"HAND.TIME is 0 to {LONGEST_HAND_TIME_S:g} s, not {seconds:g}")
    return seconds


def collision(percent: float) -> float:
    """The number of PARAMETER COLLISION."""
    if not LEAST_COLLISION <= percent <= FILES_OWN:
        raise ProgramError(f"COLLISION is {LEAST_COLLISION:g} to {FILES_OWN:g} per cent, not {percent:g}")
    return percent


def retract(mm: float) -> float:
    """The number of PARAMETER RETRACT."""
    if not 0.0 <= mm <= MOST_BACK_MM:
        raise ProgramError(f"RETRACT is 0 to {MOST_BACK_MM:g} mm, not {mm:g}")
    return mm


def check_numbers(action: tree.StepAction, joints: int, constant: Callable[[tree.Expression], float | None]) -> None:
    """Raise ProgramError for a number that the action does not take; `constant` gives its value, None if unknown."""

    def look(check: Callable[[float], float], expression: tree.Expression | None) -> None:
        value = None if expression is None else constant(expression)
        if value is not None:
            check(value)

    match action:
        case tree.SpeedSetting(value=value):
            look(speed, value)
        case tree.Instruction(word="DELAY", arguments=(seconds,)):
            look(delay, seconds)
        case tree.Instruction(word="DRIVE", arguments=(number, _, share)):
            look(lambda each: joint(each, joints), number)
            look(speed, share)
        case tree.NumberedAssignment(word="TIMER", number=number):
            look(timer, number)
        case tree.ParameterSetting(name="HAND.TIME", value=value):
            look(hand_time, value)
        case tree.ParameterSetting(name="COLLISION", value=value):
            look(collision, value)
        case tree.ParameterSetting(name="RETRACT", value=value):
            look(retract, value)
