"""Ranges of the numbers that steps take."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from qrobot.errors import ProgramError
from qrobot.rci.arguments import MOST_BACK_MM
from qrobot.val import tree

LEAST_SPEED: Final = 0.1  # percent [A], as the monitor's: slower, an arm seems to stand
FASTEST: Final = 1000.0  # of SPEED, per cent or mm/s
LONGEST_DELAY_S: Final = 86_400.0  # a day [A]
LONGEST_HAND_TIME_S: Final = 60.0
LEAST_COLLISION: Final = 1.0  # percent [A]
FILES_OWN: Final = 100.0  # percent of the thresholds of a collision in the robot file
MOST_TIMERS: Final = 15


@dataclass(frozen=True)
class NumberRange:
    """Numbers that a step takes, ends included.

    Attributes:
        said: of the numbers that it takes, for messages.
        least, most: ends.
        whole: it takes whole numbers only.
    """

    said: str
    least: float
    most: float
    whole: bool = False

    def check(self, number: float) -> float:
        """The number itself. Raises ProgramError for one outside, or not whole."""
        if not self.least <= number <= self.most or (self.whole and number != int(number)):
            raise ProgramError(f"{self.said}, not {number:g}")
        return number


SPEED: Final = NumberRange(  # of DRIVE too
    f"SPEED: {LEAST_SPEED:g} to {FASTEST:g} per cent is needed", LEAST_SPEED, FASTEST
)
SPEED_MMPS: Final = NumberRange(
    f"SPEED: a number above 0 and up to {FASTEST:g} is needed", math.nextafter(0.0, 1.0), FASTEST
)
DELAY: Final = NumberRange(f"DELAY: expected 0 to {LONGEST_DELAY_S:.0f} seconds", 0.0, LONGEST_DELAY_S)
TIMER: Final = NumberRange(f"timers are 0 to {MOST_TIMERS}", 0, MOST_TIMERS, whole=True)
PARAMETER_RANGES: Final = {
    "HAND.TIME": NumberRange(f"HAND.TIME is 0 to {LONGEST_HAND_TIME_S:g} s", 0.0, LONGEST_HAND_TIME_S),
    "COLLISION": NumberRange(f"COLLISION is {LEAST_COLLISION:g} to {FILES_OWN:g} per cent", LEAST_COLLISION, FILES_OWN),
    "RETRACT": NumberRange(f"RETRACT is 0 to {MOST_BACK_MM:g} mm", 0.0, MOST_BACK_MM),
}


def check_cycles(cycles: int) -> int:
    """Cycles of a program that is run. Raises ProgramError for one that is to run not at all."""
    if cycles == 0:
        raise ProgramError("cycles: expected 1 or more, or a negative number for a program without end", column=1)
    return cycles


def joint(joints: int) -> NumberRange:
    """The range of the joint of a DRIVE, of an arm that has so many."""
    return NumberRange(f"DRIVE: joints are 1 to {joints}", 1, joints, whole=True)


def check_numbers(action: tree.StepAction, joints: int, constant: Callable[[tree.Expression], float | None]) -> None:
    """Raise ProgramError for a number that the action does not take; `constant` gives its value, None if unknown."""

    def look(numbers: NumberRange, expression: tree.Expression | None) -> None:
        value = None if expression is None else constant(expression)
        if value is not None:
            numbers.check(value)

    match action:
        case tree.SpeedSetting(value=value, in_mm_s=in_mm_s):
            look(SPEED_MMPS if in_mm_s else SPEED, value)
        case tree.Instruction(word="DELAY", arguments=(seconds,)):
            look(DELAY, seconds)
        case tree.Instruction(word="DRIVE", arguments=(number, _, share)):
            look(joint(joints), number)
            look(SPEED, share)
        case tree.NumberedAssignment(word="TIMER", number=number):
            look(TIMER, number)
        case tree.ParameterSetting(name=name, value=value):
            look(PARAMETER_RANGES[name], value)
        case tree.ProcessStart(cycles=cycles) if cycles is not None and constant(cycles) == 0:
            check_cycles(0)
