"""Memory that a program in C and its engine share, and poses in it.

As long as a field of the program is the rounding of the number that was put there, the number itself counts, so that
constants of a C program, whose fields may be single precision, and of its twin in Python are the same.
"""

from __future__ import annotations

import mmap
import os
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from qrobot.arrays import Floats
from qrobot.units import M_PER_MM, MM_PER_M

Ints32: TypeAlias = npt.NDArray[np.int32]
Reals: TypeAlias = npt.NDArray[np.float32]
_COLUMNS: Final = 4


class ProgramMemory:
    """The pages that a program and its engine share.

    Args:
        file: descriptor of their file, which is closed.
    """

    def __init__(self, file: int) -> None:
        self._map = mmap.mmap(file, os.fstat(file).st_size)
        os.close(file)

    def ints(self, place: int, count: int = 1) -> Ints32:
        """Integers at `place`. Shape (count,)."""
        return np.frombuffer(self._map, np.int32, count, place)

    def words(self, place: int, count: int) -> npt.NDArray[np.int64]:
        """Words of 8 bytes at `place`, a multiple of 8. Shape (count,)."""
        return np.frombuffer(self._map, np.int64, count, place)

    def reals(self, place: int, count: int) -> Reals:
        """Single-precision numbers at `place`. Shape (count,)."""
        return np.frombuffer(self._map, np.float32, count, place)

    def doubles(self, place: int, count: int) -> Floats:
        """Double-precision numbers at `place`, a multiple of 8. Shape (count,)."""
        return np.frombuffer(self._map, np.float64, count, place)

    def text(self, place: int, size: int) -> npt.NDArray[np.uint8]:
        """Bytes of a text at `place`. Shape (size,)."""
        return np.frombuffer(self._map, np.uint8, size, place)

    def record(self, place: int, layout: np.dtype[np.void]) -> npt.NDArray[np.void]:
        """A structure at `place`. Shape (1,)."""
        return np.frombuffer(self._map, layout, 1, place)


class SharedPose:
    """A pose that is what the program's fields say.

    Args:
        fields: of the program: n, o, a and p (mm), in single or double precision. Shape (12,).
    """

    def __init__(self, fields: npt.NDArray[Any]) -> None:
        self._fields = fields
        self._known = b""
        self._exact = np.eye(4)

    @property
    def value(self) -> Floats:
        """The newest value. Shape (4, 4)."""
        if self._fields.tobytes() != self._known:
            self._read()
        return self._exact

    @value.setter
    def value(self, value: Floats) -> None:
        self._exact = value
        self._fields[:] = numbers_of(value)
        self._known = self._fields.tobytes()

    def part(self) -> None:
        """The program frees its memory: keep the value."""
        self._read()
        self._fields = self._fields.copy()
        self._known = self._fields.tobytes()

    def _read(self) -> None:
        """Take over the fields that the program has changed."""
        data = self._fields.tobytes()
        now, before = (np.frombuffer(which, self._fields.dtype) for which in (data, self._known))
        self._exact = value_of(np.where(now == before, numbers_of(self._exact), now))
        self._known = data


def numbers_of(value: Floats) -> Floats:
    """The fields n, o, a, p (mm) of a pose. Shapes (4, 4), (12,)."""
    columns = value[:3].T.copy()
    columns[3] *= MM_PER_M
    return columns.ravel()


def value_of(numbers: Floats) -> Floats:
    """The pose that has these fields. Shapes (12,), (4, 4)."""
    value = np.eye(4)
    value[:3] = numbers.reshape(_COLUMNS, 3).T
    value[:3, 3] *= M_PER_MM
    return value
