"""The position descriptor of RCCL, and `makeposition`."""

from __future__ import annotations

from enum import Enum
from typing import Final, TypeAlias

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion import HERE, Equation, Termination, Trsf
from qrobot.motion.request import Here
from qrobot.rccl.event import Event


class Separator(Enum):
    """Separators of the arguments of `makeposition`."""

    EQ = "EQ"
    TL = "TL"


EQ: Final = Separator.EQ
TL: Final = Separator.TL

Target: TypeAlias = "Floats | Equation | Here"


class Position:
    """Goal of motions, and the state of the latest one to it.

    Args:
        name: for traces and messages.
        target: joint positions, rad or m, shape (n,); or an equation; or HERE, which is where the arm is.

    Attributes:
        name: for traces and messages.
        target: as given; joint positions are copied and made read-only.
        code: why the latest motion to it ended: a `Termination`, or the program's own number (`nextmove`); 0 before.
        scal: how much of the motion is done, 0 to 1.
        why: more of the reason in words, as which joint met which limit; empty where the code says it all. Ours.
    """

    def __init__(self, name: str, target: Target) -> None:
        self.name = name
        if isinstance(target, np.ndarray):
            target = np.array(target, dtype=np.float64)
            target.flags.writeable = False
        self.target: Target = target
        self.code: int = Termination.NONE
        self.scal, self.why = 0.0, ""
        self._end = Event(f"{name}.end")

    @property
    def q(self) -> Floats:
        """Joint positions, rad or m. Shape (n,). Raises MotionError when it is not given by its joints."""
        if not isinstance(self.target, np.ndarray):
            raise MotionError(f"position {self.name} is not given by its joints")
        return self.target

    @property
    def equation(self) -> Equation:
        """Its equation. Raises MotionError when it has none."""
        if not isinstance(self.target, Equation):
            raise MotionError(f"position {self.name} has no equation")
        return self.target

    @property
    def end(self) -> Event:
        """Signalled at the end of every motion to this position. Assigning a number sets its count."""
        return self._end

    @end.setter
    def end(self, count: int) -> None:
        self._end.count = count

    def __repr__(self) -> str:
        if isinstance(self.target, np.ndarray):
            return f"Position({self.name!r}, q={np.round(self.target, 4).tolist()})"
        return f"Position({self.name!r}, {self.target})"


def makeposition(name: str, *terms: Trsf | Separator) -> Position:
    """A position equation: `makeposition("P", z, t6, e, EQ, table, pin, TL, e)` is Z T6 E = TABLE PIN.

    Left of EQ must stand `t6`, once; TL is followed by the one term, of either side, that ends in the controlled frame.

    Raises:
        MotionError: a term is no transform, EQ or TL is missing or in the wrong place, or the equation makes no sense.
    """
    if (strange := [term for term in terms if not isinstance(term, Trsf | Separator)]) != []:
        raise MotionError(f"makeposition {name}: {strange[0]!r} is no transform")
    if terms.count(EQ) != 1 or terms.count(TL) != 1 or terms[-2:-1] != (TL,) or terms[-1] is EQ:
        raise MotionError(f'makeposition: write ("{name}", terms with t6, EQ, terms, TL, the term of the tool)')
    at = terms.index(EQ)
    left, right, tool = ([term for term in part if isinstance(term, Trsf)] for part in _parts(terms, at))
    return Position(name, Equation(name, left, right, tool[0]))


def _parts(terms: tuple[Trsf | Separator, ...], at: int) -> tuple[tuple[Trsf | Separator, ...], ...]:
    return terms[:at], terms[at + 1 : -2], terms[-1:]


def require_position(call: str, given: object) -> Position:
    """Check that a call was given a position. Raises MotionError when it is none."""
    if not isinstance(given, Position):
        raise MotionError(f"{call}: a position is needed, from makeposition, jposition or pose, not {given!r}")
    return given


def there() -> Position:
    """The built-in position that is always the arm's own: a move to it is an absolute stop."""
    return Position("there", HERE)
