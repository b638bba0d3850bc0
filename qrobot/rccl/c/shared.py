"""Transforms, positions and variables of a C program, where the program has them.

Fields of the program are single precision: as long as a field is the rounding of the number that was put there, the
number itself counts, so that constants of a C program and of its twin in Python are the same.
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np
import numpy.typing as npt

from qrobot.arrays import Floats
from qrobot.motion import TransformKind
from qrobot.rccl.event import Event
from qrobot.rccl.position import Position, Target
from qrobot.rccl.transforms import Function, Transform
from qrobot.units import M_PER_MM, MM_PER_M
from qrobot.wire.vocabulary import MAX_JOINTS

Ints32: TypeAlias = npt.NDArray[np.int32]
Reals: TypeAlias = npt.NDArray[np.float32]

_FIELDS: Final = 12  # n, o, a, p
_COLUMNS: Final = 4
HOW: Final = np.dtype(
    [("n", "i4"), ("mode", "i4"), ("flags", "i4"), ("inputs", "u4"), ("hand", "i4"), ("outputs", "u4"), ("adcr", "i4")]
    + [("time", "f8")]
    + [(name, "f8", (MAX_JOINTS,)) for name in ("q", "v", "tau", "q_setpoint")]
    + [("force", "f8", (6,))],
    align=True,
)
"""`struct rccl_how` of rccl.h."""
CHG: Final = np.dtype(
    [("hand", "i4"), ("outputs", "u4"), ("modes", "i4", (MAX_JOINTS,)), ("setpoints", "f8", (MAX_JOINTS,))]
)
"""`struct rccl_chg` of rccl.h."""


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

    def record(self, place: int, layout: np.dtype[np.void]) -> npt.NDArray[np.void]:
        """A structure at `place`. Shape (1,)."""
        return np.frombuffer(self._map, layout, 1, place)


class SharedTransform(Transform):
    """A transform whose value is what the program's fields say.

    Args:
        name: for traces.
        kind: when its value counts.
        fields: of the program: n, o, a and p (mm). Shape (12,).
        function: of a functional one.
    """

    def __init__(self, name: str, kind: TransformKind, fields: Reals, function: Function | None = None) -> None:
        self._fields = fields
        self._known = b""
        self._exact = np.eye(4)
        super().__init__(name, kind, function=function)

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
        """The program frees its memory: keep the value for motions under way."""
        self._read()
        self._fields = self._fields.copy()
        self._known = self._fields.tobytes()
        if self._function is not None:
            self._function = _leave_it

    def _read(self) -> None:
        """Take over the fields that the program has changed."""
        data = self._fields.tobytes()
        now, before = (np.frombuffer(which, np.float32) for which in (data, self._known))
        self._exact = value_of(np.where(now == before, numbers_of(self._exact), now))
        self._known = data


def _leave_it(_: object) -> None:
    pass


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


class SharedEvent(Event):
    """A count that the program sees; `signal` is given, as the program itself counts.

    Args:
        name: for people.
        count: of the program. Shape (1,).
        signal: adds one to it.
    """

    def __init__(self, name: str, count: Ints32, signal: Callable[[], None]) -> None:
        self._count = count
        self._signal = signal
        self.name = name

    @property
    def count(self) -> int:
        """Number of times it was signalled and not taken."""
        return int(self._count[0])

    @count.setter
    def count(self, count: int) -> None:
        self._count[0] = count

    def signal(self) -> None:
        """Count one more event."""
        self._signal()


class SharedPosition(Position):
    """A position whose course the program reads in its structure.

    Args:
        name, target: as of `Position`.
        code: of the program. Shape (1,).
        scal: of the program. Shape (1,).
        end: signalled at the end of every motion to it.
    """

    def __init__(self, name: str, target: Target, code: Ints32, scal: Reals, end: SharedEvent) -> None:
        self._code, self._scal = code, scal
        super().__init__(name, target)
        self._end: Event = end

    def part(self) -> None:
        """The program frees its memory: motions under way tell nobody any more."""
        self._code, self._scal = self._code.copy(), self._scal.copy()
        self._end = Event(self._end.name)

    @property
    def code(self) -> int:
        """Termination code of the latest motion to it."""
        return int(self._code[0])

    @code.setter
    def code(self, code: int) -> None:
        self._code[0] = code

    @property
    def scal(self) -> float:
        """Share of the motion that is done, 0 to 1."""
        return float(self._scal[0])

    @scal.setter
    def scal(self, scal: float) -> None:
        self._scal[0] = scal
