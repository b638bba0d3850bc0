"""Homogeneous transforms, in millimetres and degrees: ARCL's type `Trans` and its constructors (section 2.1)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from qrobot.arcl.switches import switches
from qrobot.arcl.trace import trans_line
from qrobot.arcl.trace_output import say
from qrobot.arcl.vectors import TransColumn, VectorLike, require_name, three
from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.orientation import axis_angle, euler, rpy_angles
from qrobot.model.transform import inverse, rpy, transform
from qrobot.motion import T6, TransformKind, Trsf
from qrobot.units import DEG_PER_RAD, M_PER_MM, RAD_PER_DEG

if TYPE_CHECKING:
    from qrobot.arcl.motion import Motion

CONST: Final = TransformKind.CONST
VARB: Final = TransformKind.VARB
HOLD: Final = TransformKind.HOLD
FNDEF: Final = TransformKind.FUNCTION

TransFunction: TypeAlias = Callable[["Trans", "Motion"], object]

_FIELDS: Final = frozenset({"name", "kind", "value", "motion"})

__all__ = ["CONST", "FNDEF", "HOLD", "T6", "VARB", "Trans"]


class Trans(Trsf):
    """A transform of a program.

    Attributes:
        motion: that in which its function is called; None before the first.
    """

    motion: Motion | None = None

    def __setattr__(self, name: str, value: object) -> None:
        if name not in _FIELDS and not name.startswith("_"):
            raise AttributeError(f"transform {self.name} has no field {name!r} that can be set; t_p.x is one that can")
        super().__setattr__(name, value)

    @property
    def t_n(self) -> TransColumn:
        """First axis."""
        return TransColumn(self, 0)

    @property
    def t_o(self) -> TransColumn:
        """Second axis, the orientation vector."""
        return TransColumn(self, 1)

    @property
    def t_a(self) -> TransColumn:
        """Third axis, the approach vector."""
        return TransColumn(self, 2)

    @property
    def t_p(self) -> TransColumn:
        """Position, mm."""
        return TransColumn(self, 3)


def new_trans(name: str, kind: TransformKind = VARB, function: TransFunction | None = None) -> Trans:
    """An identity.

    Args:
        name: for traces, and the key of the symbol table.
        kind: CONST, VARB, HOLD or FNDEF.
        function: with FNDEF: called with the transform and its motion at each sample; it changes the transform.

    Raises:
        MotionError: no such kind, that is no name or no function, or a function is missing or too many.
    """
    require_name("new_trans", name)
    if function is not None and not callable(function):
        raise MotionError(f"transform {name}: a function is needed, not {function!r}")
    if kind not in (CONST, VARB, HOLD, FNDEF):
        raise MotionError(f"transform {name}: a kind is needed, CONST, VARB, HOLD or FNDEF, not {kind!r}")
    if function is None:
        return _told(Trans(name, kind))

    def call(trans: Any) -> None:
        function(trans, trans.motion)

    return _told(Trans(name, kind, function=call))


def new_trans_tr(name: str, px: float, py: float, pz: float, kind: TransformKind = CONST) -> Trans:
    """A translation, mm."""
    return _made(name, kind, np.eye(3), (px, py, pz))


def new_trans_rotvec(
    name: str, px: float, py: float, pz: float, axis: VectorLike, deg: float, kind: TransformKind = CONST
) -> Trans:
    """A translation, mm, and a rotation about `axis`, degrees. Raises MotionError: the axis has no direction."""
    return _made(name, kind, axis_angle(three("new_trans_rotvec", axis), deg * RAD_PER_DEG), (px, py, pz))


def new_trans_rpy(
    name: str, px: float, py: float, pz: float, roll: float, pitch: float, yaw: float, kind: TransformKind = CONST
) -> Trans:
    """A translation, mm, and roll about z, pitch about y, yaw about x, degrees."""
    return _made(name, kind, rpy(*(np.array([roll, pitch, yaw]) * RAD_PER_DEG).tolist()), (px, py, pz))


def new_trans_eul(
    name: str, px: float, py: float, pz: float, phi: float, theta: float, psi: float, kind: TransformKind = CONST
) -> Trans:
    """A translation, mm, and Euler angles, degrees: about z, the new y, the new z."""
    return _made(name, kind, euler(*(np.array([phi, theta, psi]) * RAD_PER_DEG).tolist()), (px, py, pz))


def new_trans_value(name: str, value: Floats, kind: TransformKind = CONST) -> Trans:
    """A transform of a pose, shape (4, 4), m, as the layers below use them. Raises MotionError: it is none."""
    require_name("transform", name)
    return _told(Trans(name, kind, np.asarray(value, dtype=np.float64)))


def _made(name: str, kind: TransformKind, rotation: Floats, p: VectorLike) -> Trans:
    return new_trans_value(name, transform(rotation, M_PER_MM * three(f"transform {name}", p)), kind)


def _told(trans: Trans) -> Trans:
    if switches.transforms:
        say(trans_line(trans))
    return trans


def trans_assign(trans: Trans, other: Trsf) -> Trans:
    """Give `trans` the value that `other` has now; returns it."""
    _value("trans_assign", trans)
    trans.set(_value("trans_assign", other))
    return trans


def trans_mult(trans: Trans, left: Trsf, right: Trsf) -> Trans:
    """Make `trans` the product of two transforms as they are now; returns it."""
    _value("trans_mult", trans)
    trans.set(_value("trans_mult", left) @ _value("trans_mult", right))
    return trans


def trans_invert(trans: Trans, other: Trsf) -> Trans:
    """Make `trans` the inverse that `other` has now; returns it."""
    _value("trans_invert", trans)
    trans.set(inverse(_value("trans_invert", other)))
    return trans


def trans_rpy(trans: Trsf) -> tuple[float, float, float]:
    """Roll, pitch and yaw, degrees."""
    roll, pitch, yaw = (angle * DEG_PER_RAD for angle in rpy_angles(_value("trans_rpy", trans)[:3, :3]))
    return roll, pitch, yaw


def _value(call: str, given: object) -> Floats:
    if not isinstance(given, Trsf):
        raise MotionError(f"{call}: a transform is needed, not {given!r}")
    return given.value
