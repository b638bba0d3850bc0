"""Positions to move to: ARCL's type `Pos`, and `makeposition` (Corke & Kirkham, section 2.2)."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Final

import numpy as np

from qrobot.arcl.switches import switches
from qrobot.arcl.trace import equation_line
from qrobot.arcl.trace_output import say
from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion import T6, Equation, Trsf
from qrobot.rci.arguments import shown

DEFAULT_NAME: Final = "pos"  # Figure 5 prints it for the position of the paper's program, which gives it no name


class PosMark(Enum):
    """Separators of the arguments of `makeposition`."""

    EQ = "EQ"
    TL = "TL"


EQ: Final = PosMark.EQ
TL: Final = PosMark.TL


class Pos:
    """A place to move to: a position equation, or joint positions.

    Args:
        name: for traces and messages.
        target: an equation; or joint positions, rad (m), shape (n,), copied and made read-only.
        tool: of joint positions: the transform from T6 to the tool's tip, whose speed counts; None for T6 itself.
    """

    def __init__(self, name: str, target: Equation | Floats, tool: Trsf | None = None) -> None:
        if isinstance(target, np.ndarray):
            target = np.array(target, dtype=np.float64)
            target.flags.writeable = False
        self.name = name
        self.target = target
        self.tool = tool

    @property
    def equation(self) -> Equation:
        """Its equation. Raises MotionError: it is given by its joints."""
        if not isinstance(self.target, Equation):
            raise MotionError(f"position {self.name} has no equation")
        return self.target

    @property
    def terms(self) -> tuple[Trsf, ...]:
        """The transforms of its equation; none for joint positions."""
        return self.target.terms if isinstance(self.target, Equation) else ()

    def __repr__(self) -> str:
        if isinstance(self.target, np.ndarray):
            return f"Pos({self.name!r}, q={np.round(self.target, 4).tolist()})"
        return f"Pos({self.name!r}, {self.target})"


def makeposition(*terms: str | Trsf | PosMark | int) -> Pos:
    """A position equation: `makeposition(base, T6, tool, EQ, stand, work, TL, tool)` is BASE T6 TOOL = STAND WORK.

    T6 stands left of EQ, once; TL is followed by the term, of either side, that ends in the tool's tip. A name for
    traces may stand before all that, and a 0 behind it, as behind other lists.

    Raises:
        MotionError: a term is no transform, EQ or TL is missing or in the wrong place, or the equation makes no sense.
    """
    if terms and isinstance(terms[-1], int) and terms[-1] == 0:
        terms = terms[:-1]
    name, *rest = terms if terms and isinstance(terms[0], str) else (DEFAULT_NAME, *terms)
    if strange := [term for term in rest if not isinstance(term, Trsf | PosMark)]:
        raise MotionError(f"makeposition {name}: {strange[0]!r} is no transform")
    if rest.count(EQ) != 1 or rest.count(TL) != 1 or rest[-2:-1] != [TL] or rest[-1] is EQ:
        raise MotionError(
            f"makeposition {name}: write (terms with T6, EQ, terms, TL, the term of the tool); without a tool TL, T6"
        )
    at = rest.index(EQ)
    left, right, tool = (
        [term for term in part if isinstance(term, Trsf)] for part in (rest[:at], rest[at:-2], rest[-1:])
    )
    equation = Equation(str(name), left, right, tool[0], T6)
    if switches.equations:
        say(equation_line(equation))
    return Pos(str(name), equation)


def joints_of(call: str, degs: Sequence[float], units: Floats) -> Floats:
    """Joint positions, rad (m), of degrees (mm). Shape (n,). Raises MotionError: not n finite numbers."""
    try:
        numbers = np.array([float(number) for number in degs])
    except (OverflowError, TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != units.shape or not np.isfinite(numbers).all():
        raise MotionError(f"{call}: {units.size} finite joint positions are needed, not {shown(degs)}")
    joints: Floats = numbers * units
    return joints
