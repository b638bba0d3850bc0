"""Orientations as the papers write them: an axis and an angle, Euler angles, roll-pitch-yaw, VAL's O-A-T.

Each makes a rotation, shape (3, 3), of radians; its counterpart reads the angles off again. Where the angles are not
determined (Euler's and O-A-T's outer axes in line, pitch at a right angle) the first of them is read as 0.
"""

from __future__ import annotations

from math import atan2, hypot
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from qrobot.arrays import Floats
from qrobot.config.values import frozen
from qrobot.errors import MotionError
from qrobot.model.transform import rot_y, rot_z, so3_exp

Angles = tuple[float, float, float]

# With O = A = T = 0 a hand points along -y, its fingers in a horizontal plane, o along +x (VAL manuals, 1977-79).
OAT_ZERO: Final[Floats] = frozen(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]))
_IN_LINE: Final = 1e-12


def axis_angle(axis: ArrayLike, angle: float) -> Floats:
    """`axis_angle(k, a) == so3_exp(k a / |k|)`.

    Raises:
        MotionError: the axis has no direction.
    """
    k = np.asarray(axis, dtype=np.float64)
    length = float(np.linalg.norm(k))
    if k.shape != (3,) or not 0.0 < length < np.inf:
        raise MotionError(f"a rotation axis needs a direction in three numbers, not {np.asarray(axis).tolist()}")
    return so3_exp(k * (angle / length))


def euler(phi: float, theta: float, psi: float) -> Floats:
    """`euler(f, t, p) == rot_z(f) @ rot_y(t) @ rot_z(p)` (Paul 1981)."""
    return rot_z(phi) @ rot_y(theta) @ rot_z(psi)


def euler_angles(R: Floats) -> Angles:
    """`euler(*euler_angles(R)) == R`, theta in [0, π]."""
    sine = hypot(R[0, 2], R[1, 2])
    if sine < _IN_LINE:
        return 0.0, atan2(sine, R[2, 2]), atan2(R[1, 0], R[1, 1])
    return atan2(R[1, 2], R[0, 2]), atan2(sine, R[2, 2]), atan2(R[2, 1], -R[2, 0])


def rpy_angles(R: Floats) -> Angles:
    """`rpy(*rpy_angles(R)) == R`, pitch in [-π/2, π/2] (Paul 1981)."""
    cosine = hypot(R[0, 0], R[1, 0])
    if cosine < _IN_LINE:
        return 0.0, atan2(-R[2, 0], cosine), atan2(-R[1, 2], R[1, 1])
    return atan2(R[1, 0], R[0, 0]), atan2(-R[2, 0], cosine), atan2(R[2, 1], R[2, 2])


def oat(o: float, a: float, t: float) -> Floats:
    """`oat(o, a, t) == rot_z(o) @ OAT_ZERO @ rot_y(a) @ rot_z(t)`, the orientation of a VAL location.

    Derived from the words of the VAL manuals (see `OAT_ZERO`), not printed in them.
    """
    return rot_z(o) @ OAT_ZERO @ rot_y(a) @ rot_z(t)


def oat_angles(R: Floats) -> Angles:
    """`oat(*oat_angles(R)) == R`, a in [-π/2, π/2]."""
    cosine = hypot(R[0, 2], R[1, 2])
    if cosine < _IN_LINE:
        return 0.0, atan2(-R[2, 2], cosine), atan2(R[0, 0], R[0, 1])
    return atan2(R[0, 2], -R[1, 2]), atan2(-R[2, 2], cosine), atan2(R[2, 1], -R[2, 0])
