"""Three-vectors as tuples: in compiled code they live in registers, and nothing is allocated."""

from __future__ import annotations

from qrobot.arrays import Floats
from qrobot.realtime.jit import lean_kernel

Vec = tuple[float, float, float]


@lean_kernel
def row(matrix: Floats, i: int) -> Vec:
    """The first three entries of row i."""
    return matrix[i, 0], matrix[i, 1], matrix[i, 2]


@lean_kernel
def add(u: Vec, v: Vec) -> Vec:
    """u + v."""
    return u[0] + v[0], u[1] + v[1], u[2] + v[2]


@lean_kernel
def scale(k: float, v: Vec) -> Vec:
    """k v."""
    return k * v[0], k * v[1], k * v[2]


@lean_kernel
def cross(u: Vec, v: Vec) -> Vec:
    """u x v."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@lean_kernel
def dot(u: Vec, v: Vec) -> float:
    """u · v."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@lean_kernel
def combine(x: Vec, y: Vec, z: Vec, v: Vec) -> Vec:
    """v[0] x + v[1] y + v[2] z: v carried from a frame with those axes."""
    return (
        v[0] * x[0] + v[1] * y[0] + v[2] * z[0],
        v[0] * x[1] + v[1] * y[1] + v[2] * z[1],
        v[0] * x[2] + v[1] * y[2] + v[2] * z[2],
    )
