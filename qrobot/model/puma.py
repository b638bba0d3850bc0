"""Closed-form inverse kinematics of the PUMA family, by named branch.

Paul's equations (Paul 1981; Paul, Shimano & Mayer 1981) in his angles, with the sines and cosines carried along instead
of taken again, so that a solution costs six arc tangents. In VAL angles, which this project uses inside,

    q_val = q_paul + (180, 180, 180, 0, 0, 180) deg,    a3_val = -a3_paul,

and the base and wrist frames are the same. Every angle is then moved by whole turns into the joint's range, to the
place nearest to where the arm is. Kernels give a status; what they fill in at a singular pose is a solution too.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final

from qrobot.arrays import Floats, Ints
from qrobot.model.branch import Branch
from qrobot.model.kinematics import KinematicsParams
from qrobot.realtime.arctangent import angle_of
from qrobot.realtime.jit import lean_kernel


class InverseStatus(IntEnum):
    """Outcome of an inverse solution."""

    OK = 0
    UNREACHABLE = 1
    SHOULDER_SINGULAR = 2  # the wrist on the shoulder's cylinder: left and right are one
    ELBOW_SINGULAR = 3  # the arm stretched or folded: up and down are one
    WRIST_SINGULAR = 4  # joints 4 and 6 in line: only their sum is determined, joint 4 stays where it was
    JOINT_LIMIT = 5  # no turn brings some joint into its range


OK: Final = int(InverseStatus.OK)
UNREACHABLE: Final = int(InverseStatus.UNREACHABLE)
SHOULDER_SINGULAR: Final = int(InverseStatus.SHOULDER_SINGULAR)
ELBOW_SINGULAR: Final = int(InverseStatus.ELBOW_SINGULAR)
WRIST_SINGULAR: Final = int(InverseStatus.WRIST_SINGULAR)
JOINT_LIMIT: Final = int(InverseStatus.JOINT_LIMIT)
LEFT: Final = int(Branch.LEFT)
DOWN: Final = int(Branch.DOWN)
FLIP: Final = int(Branch.FLIP)

# What rounding can hide: 1 um of reach (squared), 1 urad of elbow and of wrist angle.
REACH_SLACK_M2: Final = 1e-12
COSINE_SLACK: Final = 5e-13
WRIST_SLACK: Final = 1e-6
TURN: Final = 2.0 * math.pi
PER_TURN: Final = 1.0 / TURN

Sincos = tuple[float, float]  # sine, cosine
STRAIGHT: Final[Sincos] = (0.0, 1.0)


@lean_kernel
def puma_inverse(T: Floats, p: KinematicsParams, branch: int, q_near: Floats, q: Floats) -> int:
    """Joint angles of `branch` that put the wrist at `T`, nearest to `q_near` by whole turns.

    Shapes (4, 4), (6,), (6,); VAL angles. `q` is untouched when the pose is unreachable.

    Returns:
        A `InverseStatus`.
    """
    waist_status, waist, reach = _waist(T, p, branch)
    status, straight = _solve(T, p, branch, waist_status, waist, reach, q_near, q)
    if status == UNREACHABLE:
        return status
    if branch & FLIP:
        _flip(q, straight, q)
    return _settled(status, straight, wrap_into_range(q, p, q_near))


@lean_kernel
def puma_inverse_all(T: Floats, p: KinematicsParams, q_near: Floats, q: Floats, status: Ints) -> None:
    """All eight branches, row i being `Branch(i)`. Shapes (4, 4), (6,), (8, 6), (8,).

    The same numbers as `puma_inverse` gives branch by branch: two elbows share a waist, two wrists an arm.
    """
    for side in range(2):
        waist_status, waist, reach = _waist(T, p, side)
        for arm in range(side, FLIP, DOWN):
            row, flipped = q[arm], q[arm + FLIP]
            found, straight = _solve(T, p, arm, waist_status, waist, reach, q_near, row)
            status[arm] = status[arm + FLIP] = found
            if found != UNREACHABLE:
                fits = _wrap(row, p, q_near, 0, 3)
                _flip(row, straight, flipped)
                status[arm] = _settled(found, straight, fits & _wrap(row, p, q_near, 3, 6))
                status[arm + FLIP] = _settled(found, straight, fits & _wrap(flipped, p, q_near, 3, 6))


@lean_kernel
def _solve(
    T: Floats,
    p: KinematicsParams,
    branch: int,
    waist_status: int,
    waist: Sincos,
    reach: float,
    q_near: Floats,
    q: Floats,
) -> tuple[int, bool]:
    """Fill in VAL angles (6,) without flip, each somewhere on its circle; `q` is untouched when out of reach.

    Returns:
        What is wrong, but for a straight wrist, and whether the wrist is straight.
    """
    if waist_status == UNREACHABLE:
        return UNREACHABLE, False
    status, shoulder, elbow = _arm(reach, T[2, 3], p, branch)
    if status == UNREACHABLE:
        return UNREACHABLE, False
    straight, q4, q5, q6 = _wrist(T, waist, shoulder, elbow, q_near[3])
    q[0] = angle_of(-waist[0], -waist[1])  # VAL is Paul plus half a turn
    q[1] = angle_of(-shoulder[0], -shoulder[1])
    q[2] = angle_of(-elbow[0], -elbow[1])
    q[3], q[4], q[5] = q4, q5, q6 + math.pi
    return status if waist_status == OK else waist_status, straight


@lean_kernel
def _flip(q: Floats, straight: bool, flipped: Floats) -> None:
    """The other wrist of the same arm, which a straight one has not. Shapes (6,), may be one array."""
    for j in range(6):
        flipped[j] = q[j]
    if not straight:
        flipped[3], flipped[4], flipped[5] = q[3] + math.pi, -q[4], q[5] - math.pi


@lean_kernel
def _settled(status: int, straight: bool, in_range: bool) -> int:
    """The first thing that is wrong with a solution."""
    if status != OK:
        return status
    if straight:
        return WRIST_SINGULAR
    return OK if in_range else JOINT_LIMIT


@lean_kernel
def puma_branch(q: Floats, p: KinematicsParams) -> int:
    """The branch on which the arm stands at `q` (6,), VAL angles; where two meet, right, up and no-flip."""
    a, d = p.chain.a, p.chain.d
    reach = -math.cos(q[1]) * a[2] - math.cos(q[1] + q[2]) * a[3] - math.sin(q[1] + q[2]) * d[3]
    height = math.cos(q[1] + q[2]) * d[3] - math.sin(q[1] + q[2]) * a[3] - math.sin(q[1]) * a[2]
    left = reach < 0.0
    above = height * math.cos(q[1]) - reach * math.sin(q[1])  # of the elbow over the line from shoulder to wrist
    branch = LEFT if left else 0
    if (above < 0.0) != left:
        branch |= DOWN
    if math.sin(q[4]) < 0.0:
        branch |= FLIP
    return branch


@lean_kernel
def _waist(T: Floats, p: KinematicsParams, branch: int) -> tuple[int, Sincos, float]:
    """Status, joint 1, and how far the wrist is out in the plane of the arm (Paul's V114, negative on the left)."""
    x, y, d3 = T[0, 3], T[1, 3], p.chain.d[1] + p.chain.d[2]
    square = x * x + y * y
    reach2 = square - d3 * d3
    if not reach2 > -REACH_SLACK_M2:
        return UNREACHABLE, STRAIGHT, 0.0
    side = -1.0 if branch & LEFT else 1.0
    reach = side * math.sqrt(max(reach2, 0.0))
    status = SHOULDER_SINGULAR if reach2 < REACH_SLACK_M2 else OK
    return status, ((y * reach + x * d3) / square, (x * reach - y * d3) / square), reach


@lean_kernel
def _arm(reach: float, z: float, p: KinematicsParams, branch: int) -> tuple[int, Sincos, Sincos]:
    """Status and (sine, cosine) of Paul's joints 2 and 3 that put the wrist there in the plane of the arm."""
    side = -1.0 if branch & LEFT else 1.0
    above = -side if branch & DOWN else side
    return _bend(reach, z, p.chain.a[2], -p.chain.a[3], p.chain.d[3], above)


@lean_kernel
def _bend(reach: float, z: float, a2: float, a3: float, d4: float, above: float) -> tuple[int, Sincos, Sincos]:
    """Status and joints 2 and 3, of the triangle of upper arm, forearm and line to the wrist; psi at the shoulder."""
    line2, forearm2 = reach * reach + z * z, a3 * a3 + d4 * d4
    if line2 < REACH_SLACK_M2:  # folded onto itself, which no elbow does
        return UNREACHABLE, STRAIGHT, STRAIGHT
    line = math.sqrt(line2)
    cos_psi = (a2 * a2 - forearm2 + line2) / (2.0 * a2 * line)
    if not abs(cos_psi) <= 1.0 + COSINE_SLACK:
        return UNREACHABLE, STRAIGHT, STRAIGHT
    sin_psi = above * math.sqrt(max(1.0 - cos_psi * cos_psi, 0.0))
    s2, c2 = (z * cos_psi + reach * sin_psi) / line, (reach * cos_psi - z * sin_psi) / line
    along, across = c2 * reach + s2 * z - a2, c2 * z - s2 * reach
    status = ELBOW_SINGULAR if abs(cos_psi) > 1.0 - COSINE_SLACK else OK
    return status, (s2, c2), ((a3 * across - d4 * along) / forearm2, (a3 * along + d4 * across) / forearm2)


@lean_kernel
def _wrist(
    T: Floats, waist: Sincos, shoulder: Sincos, elbow: Sincos, q4_near: float
) -> tuple[bool, float, float, float]:
    """Whether the wrist is straight, and Paul's joints 4, 5 and 6 without flip (joint 5 not negative).

    From the wrist's orientation; V113 and so on are Paul's names.
    """
    s1, c1 = waist
    s23 = shoulder[0] * elbow[1] + shoulder[1] * elbow[0]
    c23 = shoulder[1] * elbow[1] - shoulder[0] * elbow[0]
    v113, v323 = c1 * T[0, 2] + s1 * T[1, 2], c1 * T[1, 2] - s1 * T[0, 2]
    v313 = c23 * v113 + s23 * T[2, 2]
    s5 = math.sqrt(v313 * v313 + v323 * v323)
    c5 = c23 * T[2, 2] - s23 * v113
    straight = s5 < WRIST_SLACK
    if straight:
        s4, c4 = math.sin(q4_near), math.cos(q4_near)
    else:
        s4, c4 = -v323 / s5, -v313 / s5
    v112, v132 = c1 * T[0, 1] + s1 * T[1, 1], s1 * T[0, 1] - c1 * T[1, 1]
    v312, v332 = c23 * v112 + s23 * T[2, 1], c23 * T[2, 1] - s23 * v112
    v412, v432 = c4 * v312 - s4 * v132, s4 * v312 + c4 * v132
    s6, c6 = -c5 * v412 - s5 * v332, -v432
    return straight, angle_of(s4, c4), angle_of(s5, c5), angle_of(s6, c6)


@lean_kernel
def wrap_into_range(q: Floats, p: KinematicsParams, q_near: Floats) -> bool:
    """Move each turning joint by whole turns into its range, nearest to `q_near`; false if one has no place there.

    Such a joint is left at the turn nearest to `q_near`. Shapes (n,).
    """
    return _wrap(q, p, q_near, 0, q.size)


@lean_kernel
def _wrap(q: Floats, p: KinematicsParams, q_near: Floats, first: int, end: int) -> bool:
    """`wrap_into_range` of joints `first` to `end` - 1. No jump depends on an angle: half would be guessed wrong."""
    fits = True
    for j in range(first, end):
        low, high = p.q_min[j], p.q_max[j]
        if not p.chain.prismatic[j]:
            angle = q[j] + TURN * math.floor((q_near[j] - q[j]) * PER_TURN + 0.5)
            back = (angle > high) & (angle - TURN >= low)
            on = (angle < low) & (angle + TURN <= high)
            q[j] = angle + ((TURN if on else 0.0) - (TURN if back else 0.0))
        fits = fits & (low <= q[j]) & (q[j] <= high)
    return fits


@lean_kernel
def nearest_solution(q: Floats, status: Ints, q_near: Floats) -> int:
    """The row of `q` (8, 6) with status OK whose largest joint step from `q_near` is smallest, or -1."""
    best, smallest = -1, math.inf
    for branch in range(status.size):
        if status[branch] != OK:
            continue
        step = 0.0
        for j in range(q_near.size):
            step = max(step, abs(q[branch, j] - q_near[j]))
        if step < smallest:
            best, smallest = branch, step
    return best
