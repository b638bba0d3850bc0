"""Unit quaternions, and quaternions with a vector: ARCL's types `Quat` and `QuatVect` (Corke & Kirkham, Table 1)."""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot

import numpy as np

from qrobot.arcl.trans import CONST, Trans, new_trans_value
from qrobot.arcl.vectors import CartesianVector, VectorLike, three
from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.orientation import axis_angle
from qrobot.model.transform import quaternion, quaternion_into, so3_exp, so3_log, transform
from qrobot.motion import TransformKind, Trsf
from qrobot.units import M_PER_MM, MM_PER_M, RAD_PER_DEG


@dataclass(frozen=True)
class Quat:
    """An orientation: a unit quaternion with the scalar part `s`, from 0 on, and the vector part `x`, `y`, `z`."""

    s: float
    x: float
    y: float
    z: float

    @property
    def rotation(self) -> Floats:
        """The same orientation as a rotation matrix. Shape (3, 3)."""
        R = np.empty((3, 3))
        quaternion_into((self.s, self.x, self.y, self.z), R)
        return R


@dataclass(frozen=True, eq=False)
class QuatVect:
    """A pose: an orientation `q` and a position `v`, mm."""

    q: Quat
    v: CartesianVector


def quat_of(R: Floats) -> Quat:
    """The quaternion of a rotation matrix, shape (3, 3)."""
    return Quat(*quaternion(np.ascontiguousarray(R, dtype=np.float64)))


def new_quat(s: float, x: float, y: float, z: float) -> Quat:
    """A quaternion, brought to length 1 and to a positive scalar part. Raises MotionError: it has no length."""
    length = hypot(s, x, y, z)
    if not 0.0 < length < np.inf:
        raise MotionError(f"new_quat: four finite numbers are needed, not all 0, not {s}, {x}, {y}, {z}")
    k = 1.0 / length if s >= 0.0 else -1.0 / length
    return Quat(k * s, k * x, k * y, k * z)


def new_quat_rotvec(axis: VectorLike, deg: float) -> Quat:
    """The turn about `axis` by `deg` degrees. Raises MotionError: the axis has no direction."""
    return quat_of(axis_angle(three("new_quat_rotvec", axis), deg * RAD_PER_DEG))


def quat_mult(left: Quat, right: Quat) -> Quat:
    """First `right`, then `left`."""
    return quat_of(left.rotation @ right.rotation)


def quat_invert(q: Quat) -> Quat:
    """The turn back."""
    return Quat(q.s, -q.x, -q.y, -q.z)


def quat_interp(begin: Quat, end: Quat, share: float) -> Quat:
    """The orientation `share` (0 to 1) of the way, about one axis and on the shorter arc, as motions turn."""
    R = begin.rotation
    return quat_of(R @ so3_exp(share * so3_log(R.T @ end.rotation)))


def quatvect_of(trans: Trsf) -> QuatVect:
    """The pose of a transform."""
    return QuatVect(quat_of(trans.value[:3, :3]), CartesianVector(*(trans.value[:3, 3] * MM_PER_M)))


def new_trans_quatvect(name: str, pose: QuatVect, kind: TransformKind = CONST) -> Trans:
    """The transform of a pose."""
    return new_trans_value(name, transform(pose.q.rotation, M_PER_MM * three(name, pose.v)), kind)
