"""DRIVE: what is left of the way to the goal, seen from the controlled frame there (Hayward & Paul 1986).

    DRIVE(x) = Trans(d) R(w)        x = [d; w], m and rad

At the goal x = 0. On its straight part a motion is x = (1 - s) x_B: the controlled frame moves along a line and turns,
both linearly in s. The goal equation holds exactly at s = 1, even when the frames moved meanwhile. How it turns:

| turn | R(w) | the same as |
|---|---|---|
| `ONE_AXIS` | exp(w) | the drive of Hayward & Paul 1986; the interpolation of quaternions on the shorter arc (ARCL) |
| `TWO_ANGLES` | exp([w1, w2, 0]) Rot(z, w3) | Paul's drive of 1981: the approach vector in a plane, the hand about it |

Either turns at |w| / T rad/s, T the time it takes: the two axes of Paul's drive are always at a right angle.
"""

from __future__ import annotations

import math
from enum import Enum
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.model.row_ops import row_of, store_row, times
from qrobot.model.transform import so3_exp_into, so3_log
from qrobot.realtime.jit import lean_kernel

_NO_AXIS: Final = 1e-9  # [A] rad: a turn, or what an approach vector lacks of π, whose axis is that of rounding
_HALF_TURN: Final = 1e-6  # [A] rad, around π
_COUNTS: Final = 1e-3  # [A] rad, of the π of a half turn


class OrientationInterpolation(Enum):
    """Interpolations of orientation in Cartesian mode."""

    ONE_AXIS = "axis"
    TWO_ANGLES = "angles"


def drive(x: Floats, turn: OrientationInterpolation = OrientationInterpolation.ONE_AXIS) -> Floats:
    """`drive_parameters(drive(x)) == x` for turns below π. Shapes (6,), (4, 4)."""
    D = np.empty((4, 4))
    drive_into(np.array(x, dtype=np.float64), turn is OrientationInterpolation.TWO_ANGLES, D)
    return D


@lean_kernel
def drive_into(x: Floats, two_angles: bool, D: Floats) -> None:
    """`D` is `drive(x)`. Shapes (6,), (4, 4)."""
    so3_exp_into((x[3], x[4], 0.0 if two_angles else x[5]), D)
    for i in range(3):
        D[i, 3], D[3, i] = x[i], 0.0
    D[3, 3] = 1.0
    if two_angles:
        c, s = math.cos(x[5]), math.sin(x[5])
        for i in range(3):
            D[i, 0], D[i, 1] = c * D[i, 0] + s * D[i, 1], c * D[i, 1] - s * D[i, 0]


@lean_kernel
def drive_between(left: Floats, x: Floats, two_angles: bool, right: Floats, D: Floats, T: Floats) -> bool:
    """`T` is `left @ D @ right` with the drive `D` of `x`; true at the goal. Shapes (4, 4) but for (6,) of `x`."""
    drive_into(x, two_angles, D)
    for i in range(3):
        store_row(times(times(row_of(left, i), D), right), i, T)
    at_goal = True
    for i in range(6):
        at_goal = at_goal and x[i] == 0.0
    return at_goal


def drive_parameters(
    D: Floats, near: Floats | None = None, turn: OrientationInterpolation = OrientationInterpolation.ONE_AXIS
) -> Floats:
    """`drive(drive_parameters(D)) == D`. Shape (6,).

    Of the turns w and w - 2π w/|w| the one that is nearer to that of `near` (6,), else the shorter one; so for each
    angle of two. Of two half turns that rounding alone tells apart it is always the same one.
    """
    x = np.empty(6)
    x[:3] = D[:3, 3]
    if turn is OrientationInterpolation.TWO_ANGLES:
        _read_two_angles(D, x)
    else:
        x[3:] = so3_log(D)
    for part in (slice(3, 6),) if turn is OrientationInterpolation.ONE_AXIS else (slice(3, 5), slice(5, 6)):
        x[part] = _one_way(x[part]) if near is None else _nearer(x[part], near[part])
    return x


def _read_two_angles(D: Floats, x: Floats) -> None:
    """Fill w: what turns z into the approach vector, and the turn about that which is left."""
    sine = math.hypot(D[0, 2], D[1, 2])
    theta = math.atan2(sine, D[2, 2])
    share = theta / sine if sine > 0.0 else 1.0  # near θ = π any axis will do: x is taken
    x[3], x[4], x[5] = -share * D[1, 2], share * D[0, 2], 0.0
    if sine < _NO_AXIS and theta > 1.0:
        x[3], x[4] = theta, 0.0
    here = drive(x, OrientationInterpolation.TWO_ANGLES)
    x[5] = math.atan2(here[:3, 1] @ D[:3, 0], here[:3, 0] @ D[:3, 0])


def _nearer(w: Floats, near: Floats) -> Floats:
    other = _other_way(w)
    return other if np.linalg.norm(other - near) < np.linalg.norm(w - near) else w


def _one_way(w: Floats) -> Floats:
    """A half turn by its axis whose first component that counts is positive; any other turn as it is."""
    if float(np.linalg.norm(w)) < math.pi - _HALF_TURN:
        return w
    first = next(component for component in w if abs(component) > _COUNTS)
    return w if first > 0.0 else _other_way(w)


def _other_way(w: Floats) -> Floats:
    """The same turn about the opposite axis; itself where it has no axis."""
    angle = float(np.linalg.norm(w))
    return w if angle < _NO_AXIS else w * (1.0 - 2.0 * math.pi / angle)
