"""`makePosition` of Multi-RCCL: the unknown of an equation is named, for it may be the place of any manipulator."""

from __future__ import annotations

from itertools import count
from typing import Final

from qrobot.errors import MotionError
from qrobot.motion import Equation, TransformKind, Trsf
from qrobot.multi_rccl.moving_transform import MovingTransform
from qrobot.rccl import EQ, TL, Position, t6
from qrobot.rccl.position import Separator

TRANS: Final = Trsf("TRANS", TransformKind.UNKNOWN)
"""The transform of whichever manipulator is moved to the position."""

_numbers = count(1)


def make_position(*terms: Trsf | Separator, unknown: Trsf | None = None, name: str = "") -> Position:
    """A position equation: `make_position(TRANS, tool, EQ, coord, p, TL, tool)` is TRANS TOOL = COORD P.

    Args:
        terms: transforms and the separators EQ and TL; TL is followed by the one term that ends in the frame moved.
        unknown: the term that the equation is solved for; default TRANS, or t6 where TRANS does not occur. One may be
            a manipulator's own `trans`: the position is for that manipulator then.
        name: for traces and messages; default P1, P2, ...

    Raises:
        MotionError: a term is no transform, EQ or TL is missing or in the wrong place, or the equation makes no sense.
    """
    if unknown is not None and not isinstance(unknown, Trsf):
        raise MotionError(f"make_position: the unknown is a transform, not {unknown!r}")
    if (strange := [term for term in terms if not isinstance(term, Trsf | Separator)]) != []:
        raise MotionError(f"make_position: {strange[0]!r} is no transform")
    if terms.count(EQ) != 1 or terms.count(TL) != 1 or terms[-2:-1] != (TL,) or terms[-1] is EQ:
        raise MotionError("make_position: write (terms with TRANS, EQ, terms, TL, the term of the tool)")
    at = terms.index(EQ)
    left, right = ([term for term in part if isinstance(term, Trsf)] for part in (terms[:at], terms[at + 1 : -2]))
    sought = unknown if unknown is not None else t6 if TRANS not in left and t6 in left else TRANS
    tool = terms[-1]
    assert isinstance(tool, Trsf)  # no separator is left
    name = name or f"P{next(_numbers)}"
    return Position(name, Equation(name, left, right, tool, sought))


def goal_for(call: str, position: object, own: Trsf, name: str) -> Position:
    """A position that manipulator `name` may go to, whose transform is `own`.

    Raises:
        MotionError: it is none; its unknown is another manipulator's transform; it depends on where `name` is; or on
            where a manipulator is that is not under control.
    """
    if not isinstance(position, Position):
        raise MotionError(f"{call}: a position is needed, from make_position, jposition or pose, not {position!r}")
    equation = position.target
    if not isinstance(equation, Equation):
        return position
    if equation.unknown not in (TRANS, t6, own):
        raise MotionError(f"position {position.name} is solved for {equation.unknown.name}: it is no goal of {name}")
    if own is not equation.unknown and own in equation.terms:
        raise MotionError(f"position {position.name} of {name} moves with {name} itself: {own.name} stands in it")
    for term in equation.terms:
        if isinstance(term, MovingTransform) and term is not equation.unknown:
            term.require_known()
    return position
