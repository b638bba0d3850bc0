"""Groups of binary lines as bits of a word."""

from __future__ import annotations

from typing import Final

from qrobot.errors import MotionError

N_LINES: Final = 16  # of a STATE packet, inputs and outputs alike


def check_lines(first: int, count: int) -> None:
    """Raises MotionError when there are no such lines; line 1 is the first."""
    if not (first >= 1 and count >= 1 and first + count - 1 <= N_LINES):
        raise MotionError(f"lines {first} to {first + count - 1}: there are lines 1 to {N_LINES}")


def set_bits(word: int, first: int, count: int, value: int) -> int:
    """The word with `value` in `count` bits from line `first` on. Raises MotionError: no such lines, or value."""
    check_lines(first, count)
    if not 0 <= value < 1 << count:
        raise MotionError(f"lines {first} to {first + count - 1} show 0 to {(1 << count) - 1}, not {value}")
    mask = ((1 << count) - 1) << (first - 1)
    return word & ~mask | value << (first - 1)


def get_bits(word: int, first: int, count: int) -> int:
    """The value of `count` bits from line `first` on. Raises MotionError: no such lines."""
    check_lines(first, count)
    return word >> (first - 1) & ((1 << count) - 1)
