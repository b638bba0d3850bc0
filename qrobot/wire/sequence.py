"""Sequence numbers of 32 bits that wrap, ordered as in RFC 1982 (serial number arithmetic)."""

from __future__ import annotations

from typing import Final

_MODULUS: Final = 1 << 32
_HALF: Final = 1 << 31


def wrapped(number: int) -> int:
    """An ever growing number as it travels, modulo 2^32."""
    return number % _MODULUS


def difference(newer: int, older: int) -> int:
    """Distance by which one number lies ahead of another, both as they travel: -2^31 to 2^31 - 1."""
    return (newer - older + _HALF) % _MODULUS - _HALF


class Sequence:
    """Accepts only newer numbers, and counts on where they wrap.

    Attributes:
        newest: newest accepted number, unwrapped (it keeps growing); None before the first.
        refused: how many were not newer: repeated, or out of order.
    """

    def __init__(self) -> None:
        self.newest: int | None = None
        self.refused = 0

    def accept(self, seq: int) -> bool:
        """True when `seq` (0 to 2^32 - 1) lies less than 2^31 ahead of the newest; the first one always is."""
        if self.newest is None:
            self.newest = seq
            return True
        step = (seq - self.newest) % _MODULUS
        if not 0 < step < _HALF:
            self.refused += 1
            return False
        self.newest += step
        return True
