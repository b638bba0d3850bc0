"""Cartesian vectors, mm where they are positions: ARCL's type `Vector` (Corke & Kirkham, Table 1)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.coordinate_fields import CoordinateFields
from qrobot.motion import Trsf
from qrobot.rci.arguments import shown
from qrobot.units import MM_PER_M


class CartesianVector(CoordinateFields):
    """Three coordinates x, y and z. There is no other field: a misspelt one is an AttributeError."""

    __slots__ = ("_own",)
    _scale = 1.0  # from what is stored to the unit of the fields

    def __init__(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> None:
        self._own = np.array([x, y, z], dtype=np.float64)

    @property
    def _cells(self) -> Floats:
        return self._own

    def __getitem__(self, row: int) -> float:
        return float(self._cells[row]) * self._scale

    def __setitem__(self, row: int, number: float) -> None:
        if isinstance(number, bool) or not isinstance(number, int | float | np.number):
            raise MotionError(f"a coordinate is a number, not {shown(number)}")
        try:
            self._cells[row] = number / self._scale
        except OverflowError:
            raise MotionError(f"a coordinate is a number, and none so large as {shown(number)}") from None

    def __len__(self) -> int:
        return 3

    def __eq__(self, other: object) -> bool:
        return list(self) == list(other) if isinstance(other, CartesianVector) else NotImplemented

    __hash__ = None  # type: ignore[assignment]  # its fields change

    def __repr__(self) -> str:
        return f"Vector({', '.join(f'{number:g}' for number in self)})"


class TransColumn(CartesianVector):
    """A column of a transform, read and written in place.

    Args:
        trsf: whose column it is.
        index: 0 to 3, for n, o, a and p.
    """

    __slots__ = ("_index", "_scale", "_trsf")

    def __init__(self, trsf: Trsf, index: int) -> None:
        self._trsf, self._index = trsf, index
        self._scale = MM_PER_M if index == 3 else 1.0

    @property
    def _cells(self) -> Floats:
        return self._trsf.value[:3, self._index]


VectorLike: TypeAlias = CartesianVector | Sequence[float]

xunit: Final = CartesianVector(1.0, 0.0, 0.0)
yunit: Final = CartesianVector(0.0, 1.0, 0.0)
zunit: Final = CartesianVector(0.0, 0.0, 1.0)


def new_vector(x: float, y: float, z: float) -> CartesianVector:
    """A vector of three coordinates. Raises MotionError: one is no finite number."""
    return CartesianVector(*three("new_vector", (x, y, z)).tolist())


def require_name(call: str, name: object) -> None:
    """Raise MotionError: what was given to a call is no name."""
    if not isinstance(name, str):
        raise MotionError(f"{call}: a name is a text, not {name!r}")


def three(call: str, given: VectorLike) -> Floats:
    """The coordinates of what was given to a call. Shape (3,). Raises MotionError: it is no vector."""
    try:
        numbers = np.array([float(number) for number in given])
    except (OverflowError, TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise MotionError(f"{call}: a vector of three finite numbers is needed, not {shown(given)}")
    return numbers


def vect_dot(a: VectorLike, b: VectorLike) -> float:
    """The scalar product."""
    return float(three("vect_dot", a) @ three("vect_dot", b))


def vect_cross(a: VectorLike, b: VectorLike) -> CartesianVector:
    """The cross product."""
    return CartesianVector(*np.cross(three("vect_cross", a), three("vect_cross", b)))


def vect_unit(a: VectorLike) -> CartesianVector:
    """The vector of length 1 in the same direction. Raises MotionError: it has none."""
    numbers = three("vect_unit", a)
    if not (length := float(np.linalg.norm(numbers))) > 0.0:
        raise MotionError("vect_unit: the zero vector has no direction")
    return CartesianVector(*(numbers / length))
