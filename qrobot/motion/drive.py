"""DRIVE: what is left of the way to the goal, seen from the controlled frame there (Hayward & Paul 1986).

    DRIVE(x) = Trans(d) Rot(w)        x = [d; w], m and rad

At the goal x = 0. On its straight part a motion is x = (1 - s) x_B: the controlled frame moves along a line and turns
about a fixed axis, both linearly in s. The goal equation holds exactly at s = 1, even when the frames moved meanwhile.
"""

from __future__ import annotations

from math import pi

import numpy as np

from qrobot.model.transform import so3_exp_into, so3_log
from qrobot.motion.limits import Floats


def drive(x: Floats) -> Floats:
    """`drive_parameters(drive(x)) == x` for turns below π. Shapes (6,), (4, 4)."""
    D = np.eye(4)
    so3_exp_into((float(x[3]), float(x[4]), float(x[5])), D)
    D[:3, 3] = x[:3]
    return D


def drive_parameters(D: Floats, near: Floats | None = None) -> Floats:
    """`drive(drive_parameters(D)) == D`. Shape (6,).

    Of the turns w and w - 2π w/|w| the one that is nearer to that of `near` (6,).
    """
    x = np.empty(6)
    x[:3] = D[:3, 3]
    x[3:] = so3_log(np.ascontiguousarray(D))
    if near is not None:
        x[3:] = _nearer(x[3:], near[3:])
    return x


def _nearer(w: Floats, near: Floats) -> Floats:
    angle = float(np.linalg.norm(w))
    if angle < 0.5 * pi:
        return w
    other = w * (1.0 - 2.0 * pi / angle)
    return other if np.linalg.norm(other - near) < np.linalg.norm(w - near) else w
