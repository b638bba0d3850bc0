"""Groups of binary lines as bits of a word, and the range of analogue outputs."""

from __future__ import annotations

from typing import Final

from qrobot.config.outputs import N_OUTPUTS
from qrobot.errors import MotionError
from qrobot.rci.arguments import as_float, shown

N_INPUTS: Final = 32  # as many as the wire's STATE has bits for

__all__ = ["N_INPUTS", "N_OUTPUTS", "check_analog", "check_lines", "get_bits", "set_bits"]


def check_lines(first: int, count: int, lines: int) -> None:
    """Raises MotionError when there are no such lines; line 1 is the first."""
    if count < 1:
        raise MotionError(f"a group has 1 line or more, not {shown(count)}")
    if not (first >= 1 and first + count - 1 <= lines):
        raise MotionError(f"lines {shown(first)} to {shown(first + count - 1)}: there are lines 1 to {lines}")


def set_bits(word: int, first: int, count: int, value: int) -> int:
    """The word with `value` in `count` outputs from line `first` on. Raises MotionError: no such lines, or value."""
    check_lines(first, count, N_OUTPUTS)
    if not 0 <= value < 1 << count:
        raise MotionError(f"lines {first} to {first + count - 1} show 0 to {(1 << count) - 1}, not {shown(value)}")
    mask = ((1 << count) - 1) << (first - 1)
    return word & ~mask | value << (first - 1)


def get_bits(word: int, first: int, count: int) -> int:
    """The value of `count` bits from line `first` on."""
    return word >> (first - 1) & ((1 << count) - 1)


def check_analog(what: str, volts: object, allowed: tuple[float, float] | None) -> None:
    """Raises MotionError when an analogue output cannot show `volts`; `allowed` is its range, None for no output."""
    if allowed is None:
        raise MotionError(f"there is no analogue {what}; see [[arm.board.analog_outputs]] of the deployment file")
    if isinstance(volts, bool) or not isinstance(volts, int | float):
        raise MotionError(f"analogue {what}: volts are a number, not {shown(volts)}")
    if not allowed[0] <= volts <= allowed[1]:
        raise MotionError(f"analogue {what}: {as_float(volts):g} V is not within {allowed[0]:g} to {allowed[1]:g} V")
