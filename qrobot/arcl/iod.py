"""IO descriptors: contiguous binary lines, or an analogue channel, as a number (Corke & Kirkham, section 2.8).

Lines are described by their numbers, or by a name of the deployment file; analogue inputs and outputs by names alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import isnan
from typing import Final

from qrobot.arcl.machine.digital import N_INPUTS, N_OUTPUTS, check_lines, get_bits, set_bits
from qrobot.arcl.robot import ArclRobot
from qrobot.errors import MotionError
from qrobot.rci.arguments import as_float, shown


class LineDirection(Enum):
    """The direction of lines, seen from the program."""

    IN = "in"
    OUT = "out"


IOD_IN: Final = LineDirection.IN
IOD_OUT: Final = LineDirection.OUT
FIRST_LINE: Final = 1  # of a program: input 0 of the board


@dataclass(frozen=True, eq=False)
class IOD:
    """A group of lines, or an analogue channel, of one robot.

    Attributes:
        rp: the robot.
        direction: inputs or outputs.
        first: number of the first line, from 1; it is bit 0 of the value.
        count: how many there are; 0 for an analogue channel or output.
        name: in the deployment file; empty for none.
        channel: of the converter, from 0, or number of the analogue output, from 1; -1 for lines.
        per_volt, zero_v: its value is (volts - zero_v) x per_volt.
        unit: of that value.
    """

    rp: ArclRobot
    direction: LineDirection
    first: int
    count: int
    name: str = ""
    channel: int = -1
    per_volt: float = 1.0
    zero_v: float = 0.0
    unit: str = ""


def new_iod(rp: ArclRobot, direction: LineDirection, first: int, count: int = 1) -> IOD:
    """A group of `count` lines from line `first` on.

    Raises:
        MotionError: no robot, no such lines, or some to which nothing leads by the deployment file of the arm.
    """
    _check_robot("new_iod", rp)
    if not isinstance(direction, LineDirection):
        raise MotionError(f"new_iod: IOD_IN or IOD_OUT is needed, not {direction!r}")
    if not all(isinstance(number, int) and not isinstance(number, bool) for number in (first, count)):
        raise MotionError(f"new_iod: numbers of lines are whole, not {shown(first)} and {shown(count)}")
    check_lines(first, count, N_INPUTS if direction is IOD_IN else N_OUTPUTS)
    rp.check_wired(range(first, first + count), direction is IOD_OUT)
    return IOD(rp, direction, first, count)


def named_iod(rp: ArclRobot, name: str) -> IOD:
    """Lines, or an analogue channel, that have that name in the deployment file. Raises ConfigError: none has it."""
    _check_robot("named_iod", rp)
    if not isinstance(name, str):
        raise MotionError(f"named_iod: a name of the deployment file is needed, not {name!r}")
    signal = rp.signal(name)
    if signal.analog is not None:
        return IOD(rp, IOD_IN, 0, 0, name, signal.analog, signal.per_volt, signal.zero_v, signal.unit)
    if signal.analog_output is not None:
        return IOD(rp, IOD_OUT, 0, 0, name, signal.analog_output, signal.per_volt, signal.zero_v, signal.unit)
    if signal.outputs is not None:
        first, last = signal.outputs
        return IOD(rp, IOD_OUT, first, last - first + 1, name)
    first, last = signal.inputs or (0, 0)  # one of the four is given
    return IOD(rp, IOD_IN, first + FIRST_LINE, last - first + 1, name)


def iod_value(iod: IOD) -> float:
    """The value at the newest sample, of an analogue channel in its unit; NaN where it has none now.

    Of an analogue output it is what this program has told it last, which a stop may have ended; NaN before.
    """
    if _iod("iod_value", iod).channel < 0:
        return float(iod_read(iod))
    output = iod.direction is IOD_OUT
    volts = iod.rp.analog_written(iod.channel) if output else float(iod.rp.sensors[iod.channel])
    return (volts - iod.zero_v) * iod.per_volt


def iod_set_value(iod: IOD, value: float) -> None:
    """Let an analogue output show a value in its unit, or lines a whole number, now.

    Raises MotionError: it is an input, or the value is not within its range; nothing has changed then.
    """
    if _iod("iod_set_value", iod).channel < 0:
        iod_write(iod, int(value) if isinstance(value, float) and value.is_integer() else value)  # type: ignore[arg-type]
        return
    if iod.direction is IOD_IN:
        raise MotionError(f"iod_set_value: {iod.name} is an analogue input")
    if isinstance(value, bool) or not isinstance(value, int | float) or isnan(volts := as_float(value)):
        raise MotionError(f"iod_set_value: a number is needed, not {shown(value)}")
    iod.rp.write_analog(iod.channel, volts / iod.per_volt + iod.zero_v)


def iod_read(iod: IOD) -> int:
    """The value of the lines at the newest sample; of outputs what is in force, which a stop may have changed.

    Outputs that were switched less than some samples ago read as they were switched.

    Raises MotionError: it is an analogue channel.
    """
    if _iod("iod_read", iod).channel >= 0:
        raise MotionError(f"iod_read: {iod.name} is an analogue channel, in {iod.unit}: iod_value reads it")
    inputs, outputs = iod.rp.lines
    return get_bits(inputs if iod.direction is IOD_IN else outputs, iod.first, iod.count)


def iod_write(iod: IOD, value: int) -> None:
    """Switch the lines, now. Raises MotionError: they are inputs, or have too few bits for the value."""
    if _iod("iod_write", iod).channel >= 0:
        if iod.direction is IOD_OUT:
            raise MotionError(f"iod_write: {iod.name} is an analogue output, in {iod.unit}: iod_set_value writes it")
        raise MotionError(f"iod_write: {iod.name} is an analogue input")
    if iod.direction is IOD_IN:
        raise MotionError(f"iod_write: lines {iod.first} to {iod.first + iod.count - 1} are inputs")
    if isinstance(value, bool) or not isinstance(value, int):
        raise MotionError(f"iod_write: a whole number is needed, not {value!r}")
    set_bits(0, iod.first, iod.count, value)
    iod.rp.write_outputs(iod.first, iod.count, value)


def _check_robot(call: str, given: object) -> None:
    if not isinstance(given, ArclRobot):
        raise MotionError(f"{call}: a robot is needed, from arcl_open, not {given!r}")


def _iod(call: str, given: object) -> IOD:
    if not isinstance(given, IOD):
        raise MotionError(f"{call}: an IO descriptor is needed, from new_iod or named_iod, not {given!r}")
    return given
