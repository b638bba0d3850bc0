"""Rigid transforms as 4x4 float64 arrays, rotations as 3x3 ones. Each docstring is the identity the function satisfies.

Frames compose by `@`, and neighbours must match: `T_base_tool = T_base_flange @ T_flange_tool`. Lengths are metres and
angles radians. Functions return new arrays; kernels (`*_into`) fill the last argument and allocate nothing.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from qrobot.arrays import Floats
from qrobot.model.vec3 import Vec
from qrobot.realtime.jit import kernel

Quaternion = tuple[float, float, float, float]
SMALL_ANGLE = 1e-4  # below it a series to third order is exact to the last bit of a float64


def transform(rotation: ArrayLike | None = None, translation: ArrayLike | None = None) -> Floats:
    """`transform(R, t) @ [x, 1] == [R x + t, 1]`; what is left out changes nothing. Shape (4, 4)."""
    T = np.eye(4)
    if rotation is not None:
        T[:3, :3] = rotation
    if translation is not None:
        T[:3, 3] = translation
    return T


def inverse(T: Floats) -> Floats:
    """`inverse(T) @ T == T @ inverse(T) == identity`, of a rigid transform. Shape (4, 4)."""
    out = np.empty((4, 4))
    inverse_into(T, out)
    return out


def rot_x(angle: float) -> Floats:
    """`rot_x(a) @ [0, 1, 0] == [0, cos a, sin a]`. Shape (3, 3)."""
    return so3_exp((angle, 0.0, 0.0))


def rot_y(angle: float) -> Floats:
    """`rot_y(a) @ [0, 0, 1] == [sin a, 0, cos a]`. Shape (3, 3)."""
    return so3_exp((0.0, angle, 0.0))


def rot_z(angle: float) -> Floats:
    """`rot_z(a) @ [1, 0, 0] == [cos a, sin a, 0]`. Shape (3, 3)."""
    return so3_exp((0.0, 0.0, angle))


def rpy(roll: float, pitch: float, yaw: float) -> Floats:
    """`rpy(r, p, y) == rot_z(r) @ rot_y(p) @ rot_x(y)`, roll about z as in Paul 1981. Shape (3, 3)."""
    return rot_z(roll) @ rot_y(pitch) @ rot_x(yaw)


def so3_exp(rotation_vector: ArrayLike) -> Floats:
    """`so3_exp(k θ)` turns by θ about the unit vector k; `so3_exp(so3_log(R)) == R`. Shape (3, 3)."""
    R = np.empty((3, 3))
    x, y, z = (float(part) for part in np.asarray(rotation_vector))
    so3_exp_into((x, y, z), R)
    return R


def so3_log(R: Floats) -> Floats:
    """`so3_log(so3_exp(w)) == w` for |w| < π: the rotation vector of R, also near identity and near π. Shape (3,)."""
    return np.array(so3_log_vec(np.ascontiguousarray(R)))  # the one type for which it is compiled


def is_transform(T: Floats, tolerance: float = 1e-6) -> bool:
    """True if `R' R == identity`, `det R == 1` and the last row is 0 0 0 1, to within `tolerance`; false for NaN."""
    if T.shape != (4, 4) or not np.isfinite(T).all():
        return False
    R = T[:3, :3]
    square = np.abs(R.T @ R - np.eye(3)).max() <= tolerance
    return bool(square and np.linalg.det(R) > 0 and np.abs(T[3] - [0, 0, 0, 1]).max() <= tolerance)


@kernel
def inverse_into(T: Floats, out: Floats) -> None:
    """`T @ out == identity` for a rigid transform; `out` is not `T`. Shapes (4, 4)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = T[j, i]
        out[i, 3] = -(T[0, i] * T[0, 3] + T[1, i] * T[1, 3] + T[2, i] * T[2, 3])
        out[3, i] = 0.0
    out[3, 3] = 1.0


@kernel
def so3_exp_into(w: Vec, R: Floats) -> None:
    """Rodrigues' formula for the rotation vector `w`; fills the upper left 3x3 of `R`."""
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    angle = math.sqrt(square)
    if angle < SMALL_ANGLE:
        sine, versine = 1.0 - square / 6.0, 0.5 - square / 24.0
    else:
        sine, half = math.sin(angle) / angle, math.sin(0.5 * angle) / angle
        versine = 2.0 * half * half
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        R[i, i] = 1.0 - versine * (w[j] * w[j] + w[k] * w[k])
        R[i, j] = versine * w[i] * w[j] - sine * w[k]
        R[j, i] = versine * w[i] * w[j] + sine * w[k]


@kernel
def so3_log_vec(R: Floats) -> Vec:
    """Rotation vector of the upper left 3x3 of `R`, |w| <= π."""
    qw, qx, qy, qz = quaternion(R)
    length = math.sqrt(qx * qx + qy * qy + qz * qz)
    k = 2.0 / qw if length < SMALL_ANGLE * SMALL_ANGLE else 2.0 * math.atan2(length, qw) / length
    return k * qx, k * qy, k * qz


@kernel
def quaternion(R: Floats) -> Quaternion:
    """Unit quaternion w, x, y, z of the upper left 3x3 of `R`, w >= 0.

    Starts from the largest of the four (Shepperd 1978), so that nothing cancels, near π least of all.
    """
    trace = R[0, 0] + R[1, 1] + R[2, 2]
    if trace > max(R[0, 0], R[1, 1], R[2, 2]):
        w, x, y, z = 1.0 + trace, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    elif R[0, 0] >= max(R[1, 1], R[2, 2]):
        w, x, y, z = R[2, 1] - R[1, 2], 1.0 + 2.0 * R[0, 0] - trace, R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]
    elif R[1, 1] >= R[2, 2]:
        w, x, y, z = R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], 1.0 + 2.0 * R[1, 1] - trace, R[1, 2] + R[2, 1]
    else:
        w, x, y, z = R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 1.0 + 2.0 * R[2, 2] - trace
    k = 1.0 / math.sqrt(w * w + x * x + y * y + z * z)
    if w < 0.0:
        k = -k
    return k * w, k * x, k * y, k * z


@kernel
def quaternion_into(q: Quaternion, R: Floats) -> None:
    """`quaternion_into(quaternion(R), R)` leaves the rotation as it was; fills the upper left 3x3."""
    w, x, y, z = q
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)
