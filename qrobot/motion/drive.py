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

from enum import Enum
from math import atan2, cos, hypot, pi, sin

import numpy as np

from qrobot.model.transform import so3_exp_into, so3_log
from qrobot.motion.limits import Floats


class Turn(Enum):
    """How orientations are interpolated in Cartesian mode."""

    ONE_AXIS = "axis"
    TWO_ANGLES = "angles"


def drive(x: Floats, turn: Turn = Turn.ONE_AXIS) -> Floats:
    """`drive_parameters(drive(x)) == x` for turns below π. Shapes (6,), (4, 4)."""
    D = np.eye(4)
    one_axis = turn is Turn.ONE_AXIS
    so3_exp_into((float(x[3]), float(x[4]), float(x[5]) if one_axis else 0.0), D)
    if not one_axis:
        c, s = cos(x[5]), sin(x[5])
        D[:3, 0], D[:3, 1] = c * D[:3, 0] + s * D[:3, 1], c * D[:3, 1] - s * D[:3, 0]
    D[:3, 3] = x[:3]
    return D


def drive_parameters(D: Floats, near: Floats | None = None, turn: Turn = Turn.ONE_AXIS) -> Floats:
    """`drive(drive_parameters(D)) == D`. Shape (6,).

    Of the turns w and w - 2π w/|w| the one that is nearer to that of `near` (6,); so for each angle of two.
    """
    x = np.empty(6)
    x[:3] = D[:3, 3]
    if turn is Turn.TWO_ANGLES:
        _read_two_angles(D, x)
    else:
        x[3:] = so3_log(np.ascontiguousarray(D))
    if near is not None:
        for part in (slice(3, 6),) if turn is Turn.ONE_AXIS else (slice(3, 5), slice(5, 6)):
            x[part] = _nearer(x[part], near[part])
    return x


def _read_two_angles(D: Floats, x: Floats) -> None:
    """Fill w: what turns z into the approach vector, and the turn about that which is left."""
    sine = hypot(D[0, 2], D[1, 2])
    theta = atan2(sine, D[2, 2])
    share = theta / sine if sine > 0.0 else 1.0  # at θ = π any axis will do; x is taken
    x[3], x[4], x[5] = -share * D[1, 2], share * D[0, 2], 0.0
    if sine == 0.0:
        x[3] = theta
    here = drive(x, Turn.TWO_ANGLES)
    x[5] = atan2(here[:3, 1] @ D[:3, 0], here[:3, 0] @ D[:3, 0])


def _nearer(w: Floats, near: Floats) -> Floats:
    angle = float(np.linalg.norm(w))
    if angle < 0.5 * pi:
        return w
    other = w * (1.0 - 2.0 * pi / angle)
    return other if np.linalg.norm(other - near) < np.linalg.norm(w - near) else w
