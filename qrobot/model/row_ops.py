"""Products of rigid transforms row by row: a row stays in registers through any number of factors.

A row is (x, y, z, along): three numbers of a rotation and one of a translation. The fourth row of every transform is
0 0 0 1. Nothing is allocated.
"""

from __future__ import annotations

from qrobot.arrays import Floats
from qrobot.realtime.jit import lean_kernel

Row = tuple[float, float, float, float]


@lean_kernel
def unit_row(i: int) -> Row:
    """Row i of the identity."""
    return 1.0 if i == 0 else 0.0, 1.0 if i == 1 else 0.0, 1.0 if i == 2 else 0.0, 0.0


@lean_kernel
def row_of(T: Floats, i: int) -> Row:
    """Row i of a transform (4, 4)."""
    return T[i, 0], T[i, 1], T[i, 2], T[i, 3]


@lean_kernel
def times(row: Row, T: Floats) -> Row:
    """`row @ T`; `T` has shape (4, 4)."""
    x, y, z, along = row
    return (
        x * T[0, 0] + y * T[1, 0] + z * T[2, 0],
        x * T[0, 1] + y * T[1, 1] + z * T[2, 1],
        x * T[0, 2] + y * T[1, 2] + z * T[2, 2],
        x * T[0, 3] + y * T[1, 3] + z * T[2, 3] + along,
    )


@lean_kernel
def times_inverse(row: Row, T: Floats) -> Row:
    """`row @ inverse(T)`; `T` has shape (4, 4)."""
    x, y, z, along = row
    turned_x = x * T[0, 0] + y * T[0, 1] + z * T[0, 2]
    turned_y = x * T[1, 0] + y * T[1, 1] + z * T[1, 2]
    turned_z = x * T[2, 0] + y * T[2, 1] + z * T[2, 2]
    back = turned_x * T[0, 3] + turned_y * T[1, 3] + turned_z * T[2, 3]
    return turned_x, turned_y, turned_z, along - back


@lean_kernel
def store_row(row: Row, i: int, T: Floats) -> None:
    """Make it row i, and the bottom row what it always is. Shape (4, 4)."""
    T[i, 0], T[i, 1], T[i, 2], T[i, 3] = row
    T[3, i] = 0.0
    T[3, 3] = 1.0
