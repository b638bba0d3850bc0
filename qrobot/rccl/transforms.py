"""RCCL's transforms: made and changed in millimetres and degrees (Hayward & Paul 1986, section 3.1).

`newtrans` makes an identity of one of four kinds; the `gentr_` family makes and initialises. Functions that change a
transform return it, and its name is for traces: like `strcpy`, they can be nested. A program's own constructor is an
ordinary function that returns a `Transform`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.coordinate_fields import CoordinateFields
from qrobot.model.orientation import axis_angle, euler
from qrobot.model.transform import inverse, rpy, transform
from qrobot.motion import T6, TransformKind, Trsf
from qrobot.units import M_PER_MM, MM_PER_M, NS_PER_MS, RAD_PER_DEG

VectorArgument: TypeAlias = Sequence[float]
Function: TypeAlias = Callable[["Transform"], object]

const: Final = "const"
varb: Final = "varb"
hold: Final = "hold"

xunit: Final = (1.0, 0.0, 0.0)
yunit: Final = (0.0, 1.0, 0.0)
zunit: Final = (0.0, 0.0, 1.0)

t6: Final = T6
LEAST_SINE: Final = 1e-6  # [A] of the angle between two vectors that span a plane


class Column(CoordinateFields):
    """One column of a transform, its fields read and written in place.

    Args:
        trsf: whose column it is.
        index: 0 to 3, for n, o, a, p.
        scale: from metres to the fields' unit.
    """

    def __init__(self, trsf: Trsf, index: int, scale: float = 1.0) -> None:
        self._trsf, self._index, self._scale = trsf, index, scale

    def __getitem__(self, row: int) -> float:
        return float(self._trsf.value[row, self._index]) * self._scale

    def __setitem__(self, row: int, number: float) -> None:
        value = self._trsf.value.copy()
        value[row, self._index] = number / self._scale
        self._trsf.value = value


class Transform(Trsf):
    """A transform of a program: columns `n`, `o`, `a` (unit vectors) and `p` (mm), each with fields x, y, z.

    Attributes:
        longest_ms: the longest time that the function of a functional one took so far.
    """

    longest_ms = 0.0

    @property
    def n(self) -> Column:
        """First axis."""
        return Column(self, 0)

    @property
    def o(self) -> Column:
        """Second axis, the orientation vector."""
        return Column(self, 1)

    @property
    def a(self) -> Column:
        """Third axis, the approach vector."""
        return Column(self, 2)

    @property
    def p(self) -> Column:
        """Position, mm."""
        return Column(self, 3, MM_PER_M)


def newtrans(name: str, kind: str | Function = varb) -> Transform:
    """An identity.

    Args:
        name: for traces.
        kind: "const", "varb" or "hold"; or a function of a transform, which is then called with it at each sample.

    Raises:
        MotionError: no such kind.
    """
    if callable(kind):
        return Transform(name, TransformKind.FUNCTION, function=timed(kind))
    if kind not in (const, varb, hold):
        raise MotionError(f"transform {name}: kind {kind!r} is none of {const!r}, {varb!r}, {hold!r}, nor a function")
    return Transform(name, TransformKind(kind))


def timed(function: Function) -> Function:
    """The same, its time measured: a program has to know which of its functions is too slow for the sample period."""

    def call(t: Transform) -> None:
        begin_ns = time.perf_counter_ns()
        function(t)
        t.longest_ms = max(t.longest_ms, (time.perf_counter_ns() - begin_ns) / NS_PER_MS)

    return call


def gentr_trsl(name: str, px: float, py: float, pz: float, kind: str = const) -> Transform:
    """A translation, mm."""
    return _made(name, kind, np.eye(3), (px, py, pz))


def gentr_rot(name: str, px: float, py: float, pz: float, v: VectorArgument, a: float, kind: str = const) -> Transform:
    """A translation, mm, and a rotation by `a` degrees about the vector `v`. Raises MotionError: v has no direction."""
    return _made(name, kind, axis_angle(v, a * RAD_PER_DEG), (px, py, pz))


def gentr_eul(
    name: str, px: float, py: float, pz: float, phi: float, theta: float, psi: float, kind: str = const
) -> Transform:
    """A translation, mm, and Euler angles, degrees: about z, the new y, the new z."""
    return _made(name, kind, euler(*(RAD_PER_DEG * np.array([phi, theta, psi])).tolist()), (px, py, pz))


def gentr_rpy(
    name: str, px: float, py: float, pz: float, roll: float, pitch: float, yaw: float, kind: str = const
) -> Transform:
    """A translation, mm, and roll about z, pitch about y, yaw about x, degrees (Paul 1981)."""
    return _made(name, kind, rpy(*(RAD_PER_DEG * np.array([roll, pitch, yaw])).tolist()), (px, py, pz))


def gentr_pao(name: str, p: VectorArgument, a: VectorArgument, o: VectorArgument, kind: str = const) -> Transform:
    """A position `p`, mm, an approach vector `a`, and an orientation vector `o` that is made normal to it.

    Raises:
        MotionError: the two vectors do not span a plane; what is left of their product may be rounding.
    """
    approach, orientation = np.asarray(a, dtype=np.float64), np.asarray(o, dtype=np.float64)
    n = np.cross(orientation, approach)
    if not np.linalg.norm(n) > LEAST_SINE * np.linalg.norm(orientation) * np.linalg.norm(approach):
        raise MotionError(f"transform {name}: approach and orientation vectors must not be parallel, nor zero")
    columns = (n, np.cross(approach, n), approach)
    return _made(name, kind, np.column_stack([column / np.linalg.norm(column) for column in columns]), p)


def made_transform(name: str, kind: str, value: Floats) -> Transform:
    """A transform of that kind and value, shape (4, 4), m. Raises MotionError: no such kind, or it is not rigid."""
    made = newtrans(name, kind)
    made.set(value)
    return made


def _made(name: str, kind: str, rotation: Floats, p: VectorArgument) -> Transform:
    return made_transform(name, kind, transform(rotation, M_PER_MM * np.asarray(p, dtype=np.float64)))


def rot(t: Transform, v: VectorArgument, angle: float) -> Transform:
    """Make `t` a pure rotation by `angle` degrees about `v`."""
    return _set(t, transform(axis_angle(v, angle * RAD_PER_DEG)))


def trsl(t: Transform, px: float, py: float, pz: float) -> Transform:
    """Make `t` a pure translation, mm."""
    return _set(t, transform(translation=M_PER_MM * np.array([px, py, pz])))


def assigntr(t: Transform, other: Trsf) -> Transform:
    """Give `t` the value that `other` has now."""
    return _set(t, other.value)


def trmult(t: Transform, left: Trsf, right: Trsf) -> Transform:
    """Make `t` the product of two transforms as they are now."""
    return _set(t, left.value @ right.value)


def invert(t: Transform, other: Trsf) -> Transform:
    """Make `t` the inverse that `other` has now."""
    return _set(t, inverse(other.value))


def _set(t: Transform, value: Floats) -> Transform:
    t.set(value)
    return t
