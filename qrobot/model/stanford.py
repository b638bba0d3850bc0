"""Closed-form inverse kinematics of the Stanford arm: waist, shoulder, a boom that slides, a wrist of three joints.

After Paul's equations of it ("Modelling, trajectory calculation and servoing of a computer controlled arm", AIM-177,
1972). In the modified DH frames of the robot file, with r the boom's horizontal reach, negative on the left:

    p = d1 z + d2 (-s1, c1, 0) + (c1 r, s1 r, d3 c2),  r = d3 s2        R36 = Rz(q4) Ry(q5) Rz(q6)

There is no elbow, so of the letters of a configuration only l/r and n/f say something. Kernels give a status; what they
fill in at a singular pose is a solution too.
"""

from __future__ import annotations

import math

from qrobot.arrays import Floats, Ints
from qrobot.model.kinematics import KinematicsParams
from qrobot.model.puma import (
    DOWN,
    FLIP,
    JOINT_LIMIT,
    LEFT,
    OK,
    REACH_SLACK_M2,
    SHOULDER_SINGULAR,
    UNREACHABLE,
    WRIST_SINGULAR,
    WRIST_SLACK,
    wrap_into_range,
)
from qrobot.realtime.jit import lean_kernel


@lean_kernel
def stanford_inverse(T: Floats, p: KinematicsParams, branch: int, q_near: Floats, q: Floats) -> int:
    """Joint positions of `branch` that put the wrist at `T`, nearest to `q_near` by whole turns.

    Shapes (4, 4), (6,), (6,); rad, and m for the boom. `q` is untouched when the pose is unreachable, as every one is
    with the elbow down.

    Returns:
        A `model.puma.Status`.
    """
    x, y, z, d2 = T[0, 3], T[1, 3], T[2, 3] - p.chain.d[0], p.chain.d[1]
    reach2 = x * x + y * y - d2 * d2
    if branch & DOWN or not reach2 > -REACH_SLACK_M2:
        return UNREACHABLE
    reach = math.sqrt(max(reach2, 0.0))
    if branch & LEFT:
        reach = -reach
    q[0] = math.atan2(y, x) - math.atan2(d2, reach)
    q[1] = math.atan2(reach, z)
    q[2] = math.hypot(reach, z)
    straight = _wrist(T, branch, q_near[3], q)
    in_range = wrap_into_range(q, p, q_near)
    if reach2 < REACH_SLACK_M2:
        return SHOULDER_SINGULAR
    if straight:
        return WRIST_SINGULAR
    return OK if in_range else JOINT_LIMIT


@lean_kernel
def stanford_inverse_all(T: Floats, p: KinematicsParams, q_near: Floats, q: Floats, status: Ints) -> None:
    """All branches, row i being `Branch(i)`. Shapes (4, 4), (6,), (8, 6), (8,)."""
    for branch in range(8):
        status[branch] = stanford_inverse(T, p, branch, q_near, q[branch])


@lean_kernel
def stanford_branch(q: Floats, _p: KinematicsParams) -> int:
    """The branch on which the arm stands at `q` (6,); where two meet, right and no-flip."""
    branch = LEFT if math.sin(q[1]) < 0.0 else 0
    return branch | FLIP if math.sin(q[4]) < 0.0 else branch


@lean_kernel
def _wrist(T: Floats, branch: int, q4_near: float, q: Floats) -> bool:
    """Fill in joints 4, 5 and 6 from the wrist's orientation; whether it is straight, when joint 4 stays near."""
    c1, s1, c2, s2 = math.cos(q[0]), math.sin(q[0]), math.cos(q[1]), math.sin(q[1])
    # Columns of T in the boom's frame R03 = Rz(q1) Ry(q2) Rz(-90 deg), whose axes are:
    # x = (s1, -c1, 0), y = (c1 c2, s1 c2, -s2), z = (c1 s2, s1 s2, c2)
    ax, ay = s1 * T[0, 2] - c1 * T[1, 2], c1 * c2 * T[0, 2] + s1 * c2 * T[1, 2] - s2 * T[2, 2]
    az = c1 * s2 * T[0, 2] + s1 * s2 * T[1, 2] + c2 * T[2, 2]
    nz = c1 * s2 * T[0, 0] + s1 * s2 * T[1, 0] + c2 * T[2, 0]
    oz = c1 * s2 * T[0, 1] + s1 * s2 * T[1, 1] + c2 * T[2, 1]
    s5 = math.hypot(ax, ay)
    if s5 < WRIST_SLACK:
        ox, oy = s1 * T[0, 1] - c1 * T[1, 1], c1 * c2 * T[0, 1] + s1 * c2 * T[1, 1] - s2 * T[2, 1]
        q[3], q[4] = q4_near, math.atan2(s5, az)
        q[5] = math.atan2(-ox, oy) - q4_near if az > 0.0 else math.atan2(ox, oy) + q4_near
        return True
    sign = -1.0 if branch & FLIP else 1.0
    q[3] = math.atan2(sign * ay, sign * ax)
    q[4] = math.atan2(sign * s5, az)
    q[5] = math.atan2(sign * oz, -sign * nz)
    return False
