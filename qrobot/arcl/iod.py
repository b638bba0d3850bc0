"""IO descriptors: one or more contiguous binary lines, read or written as a number (Corke & Kirkham, section 2.8)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Final

from qrobot.arcl.machine.digital import N_INPUTS, N_OUTPUTS, check_lines, get_bits, set_bits
from qrobot.arcl.robot import ArclRobot
from qrobot.errors import MotionError


class LineDirection(Enum):
    """The direction of lines, seen from the program."""

    IN = "in"
    OUT = "out"


IOD_IN: Final = LineDirection.IN
IOD_OUT: Final = LineDirection.OUT


@dataclass(frozen=True, eq=False)
class IOD:
    """A group of lines of one robot.

    Attributes:
        rp: the robot.
        direction: inputs or outputs.
        first: number of the first line, from 1; it is bit 0 of the value.
        count: how many there are.
    """

    rp: ArclRobot
    direction: LineDirection
    first: int
    count: int


def new_iod(rp: ArclRobot, direction: LineDirection, first: int, count: int = 1) -> IOD:
    """A group of `count` lines from line `first` on. Raises MotionError: there are no such lines."""
    if not isinstance(direction, LineDirection):
        raise MotionError(f"new_iod: IOD_IN or IOD_OUT is needed, not {direction!r}")
    if not all(isinstance(number, int) and not isinstance(number, bool) for number in (first, count)):
        raise MotionError(f"new_iod: numbers of lines are whole, not {first!r} and {count!r}")
    check_lines(first, count, N_INPUTS if direction is IOD_IN else N_OUTPUTS)
    return IOD(rp, direction, first, count)


def iod_read(iod: IOD) -> int:
    """The value of the lines at the newest sample; of outputs what is in force, which a stop may have changed."""
    inputs, outputs = _iod("iod_read", iod).rp.lines
    return get_bits(inputs if iod.direction is IOD_IN else outputs, iod.first, iod.count)


def iod_write(iod: IOD, value: int) -> None:
    """Switch the lines, now. Raises MotionError: they are inputs, or have too few bits for the value."""
    if _iod("iod_write", iod).direction is IOD_IN:
        raise MotionError(f"iod_write: lines {iod.first} to {iod.first + iod.count - 1} are inputs")
    if isinstance(value, bool) or not isinstance(value, int):
        raise MotionError(f"iod_write: a whole number is needed, not {value!r}")
    set_bits(0, iod.first, iod.count, value)
    iod.rp.write_outputs(iod.first, iod.count, value)


def _iod(call: str, given: object) -> IOD:
    if not isinstance(given, IOD):
        raise MotionError(f"{call}: an IO descriptor is needed, from new_iod, not {given!r}")
    return given
