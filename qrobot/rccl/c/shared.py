"""Transforms, positions and variables of a C program, where the program has them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from qrobot.c_transport.memory import Ints32, Reals, SharedPose
from qrobot.c_transport.shared_value import SharedValue
from qrobot.motion import TransformKind
from qrobot.rccl.event import Event
from qrobot.rccl.position import Position, Target
from qrobot.rccl.transforms import Function, Transform
from qrobot.wire.vocabulary import MAX_JOINTS

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


class SharedTransform(SharedValue, Transform):
    """A transform whose value is what the program's fields say.

    Args:
        name: for traces.
        kind: when its value counts.
        fields: of the program: n, o, a and p (mm). Shape (12,).
        function: of a functional one.
    """

    def __init__(self, name: str, kind: TransformKind, fields: Reals, function: Function | None = None) -> None:
        self._pose = SharedPose(fields)
        super().__init__(name, kind, function=function)


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
