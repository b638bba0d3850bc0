"""Forward kinematics and Jacobian of any serial arm, as kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.robot import Robot
from qrobot.model.chain import ChainParams, chain_params, link_origin, link_turn, to_parent
from qrobot.model.vec3 import Vec, add, combine, cross
from qrobot.realtime.jit import lean_kernel


class KinematicsParams(NamedTuple):
    """Geometry and range of n joints for the kernels.

    Attributes:
        chain: the link frames.
        q_min, q_max: joint range, rad (m). Shape (n,).
    """

    chain: ChainParams
    q_min: Floats
    q_max: Floats


def kinematics_params(robot: Robot) -> KinematicsParams:
    """Collect the kinematics of `robot` for the kernels; fresh, writable arrays of one Numba type."""
    return KinematicsParams(chain_params(robot), np.array(robot.limits.q_min), np.array(robot.limits.q_max))


@lean_kernel
def forward(q: Floats, p: KinematicsParams, T: Floats) -> None:
    """Pose of the last frame (a PUMA's wrist centre) in the base frame. Shapes (n,), (4, 4)."""
    x, y, origin = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(q.size - 1, -1, -1):
        turn = link_turn(q, p.chain, i)
        x, y = to_parent(turn, x), to_parent(turn, y)
        origin = add(to_parent(turn, origin), link_origin(q, p.chain, i))
    z = cross(x, y)
    for i in range(3):
        T[i, 0], T[i, 1], T[i, 2], T[i, 3] = x[i], y[i], z[i], origin[i]
        T[3, i] = 0.0
    T[3, 3] = 1.0


@lean_kernel
def jacobian(q: Floats, p: KinematicsParams, J: Floats) -> None:
    """Velocity of the last frame's origin (rows 0-2) and angular velocity (rows 3-5), both in the base frame.

    `[v; w] = J qd`. Shapes (n,), (6, n).
    """
    x, y, z, origin = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    for i in range(q.size):
        turn = link_turn(q, p.chain, i)
        origin = add(origin, combine(x, y, z, link_origin(q, p.chain, i)))
        columns = x, y, z
        x = combine(columns[0], columns[1], columns[2], to_parent(turn, (1.0, 0.0, 0.0)))
        y = combine(columns[0], columns[1], columns[2], to_parent(turn, (0.0, 1.0, 0.0)))
        z = cross(x, y)
        for axis in range(3):
            J[axis, i], J[3 + axis, i] = origin[axis], z[axis]
    for i in range(q.size):
        _fill_column(J, i, p.chain.prismatic[i], origin)


@lean_kernel
def _fill_column(J: Floats, i: int, prismatic: bool, tip: Vec) -> None:
    """Column i from (origin, axis) of joint i to (velocity, angular velocity) of the tip per unit of joint speed."""
    axis = (J[3, i], J[4, i], J[5, i])
    arm = (tip[0] - J[0, i], tip[1] - J[1, i], tip[2] - J[2, i])
    velocity = axis if prismatic else cross(axis, arm)
    for row in range(3):
        J[row, i] = velocity[row]
        if prismatic:
            J[3 + row, i] = 0.0
