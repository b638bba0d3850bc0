"""Small displacements, forces and Jacobians: ARCL's types `Diff`, `Force` and `Jacob` (Corke & Kirkham, Table 1).

A Diff is in mm and degrees, a Force in N and N m, a Jacob in m and rad; each belongs to a frame, and moves to another
one of the same rigid body. The work of a force along a displacement is the same in both.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arcl.kinematics.jacobian import inverse_jacobian
from qrobot.arcl.trans import CONST, Trans, new_trans_value
from qrobot.arcl.vectors import CartesianVector, three
from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.differential import twist_to_child, wrench_to_parent
from qrobot.model.transform import so3_exp, so3_log, transform
from qrobot.motion import Trsf
from qrobot.units import DEG_PER_RAD, M_PER_MM, MM_PER_M, RAD_PER_DEG

_ROWS: Final = 6


@dataclass(frozen=True, eq=False)
class Diff:
    """A small displacement: `d` along the axes of a frame, mm, and `r` about them, degrees."""

    d: CartesianVector
    r: CartesianVector

    @property
    def twist(self) -> Floats:
        """The same in m and rad. Shape (6,)."""
        return np.concatenate((three("Diff", self.d) * M_PER_MM, three("Diff", self.r) * RAD_PER_DEG))


@dataclass(frozen=True, eq=False)
class Force:
    """A force `f` along the axes of a frame, N, and a moment `m` about them, N m."""

    f: CartesianVector
    m: CartesianVector

    @property
    def wrench(self) -> Floats:
        """All six numbers. Shape (6,)."""
        return np.concatenate((three("Force", self.f), three("Force", self.m)))


def new_diff(dx: float, dy: float, dz: float, rx: float, ry: float, rz: float) -> Diff:
    """A small displacement, mm and degrees."""
    return Diff(CartesianVector(dx, dy, dz), CartesianVector(rx, ry, rz))


def new_force(fx: float, fy: float, fz: float, mx: float, my: float, mz: float) -> Force:
    """A force and a moment, N and N m."""
    return Force(CartesianVector(fx, fy, fz), CartesianVector(mx, my, mz))


def diff_of(trans: Trsf) -> Diff:
    """`new_trans_diff` of it is the transform again: its displacement and rotation vector, of up to 180 degrees.

    For small turns that is the differential rotation of Paul (1981), to first order; of a half turn the axis may point
    either way.
    """
    return new_diff(*(trans.value[:3, 3] * MM_PER_M), *(so3_log(trans.value) * DEG_PER_RAD))


def new_trans_diff(name: str, diff: Diff) -> Trans:
    """The transform of a displacement; its rotation is a whole one, of any size."""
    twist = diff.twist
    return new_trans_value(name, transform(so3_exp(twist[3:]), twist[:3]), CONST)


def diff_in(trans: Trsf, diff: Diff) -> Diff:
    """The same displacement of one body seen in the frame that `trans` leads to."""
    seen = twist_to_child(trans.value, diff.twist)
    return new_diff(*(seen[:3] * MM_PER_M), *(seen[3:] * DEG_PER_RAD))


def force_from(trans: Trsf, force: Force) -> Force:
    """The force, given in the frame that `trans` leads to, seen in the frame that it comes from."""
    return new_force(*wrench_to_parent(trans.value, force.wrench))


@dataclass(frozen=True, eq=False)
class Jacob:
    """A Jacobian matrix: `[v; w] = matrix @ joint rates`, m and rad. Shape (6, n)."""

    matrix: Floats

    def __post_init__(self) -> None:
        if not isinstance(self.matrix, np.ndarray) or self.matrix.ndim != 2 or self.matrix.shape[0] != _ROWS:
            raise MotionError(f"Jacob: a matrix of six rows is needed, as of aki.jacobian, not {self.matrix!r}")

    def velocity(self, rates: Floats) -> Floats:
        """Velocity and angular velocity of T6 in the base, at joint rates (n,) in rad/s (m/s). Shape (6,)."""
        velocity: Floats = self.matrix @ np.asarray(rates, dtype=np.float64)
        return velocity

    def torques(self, force: Force) -> Floats:
        """Joint torques that exert `force` at T6, along the axes of the base. Shape (n,), N m (N)."""
        torques: Floats = self.matrix.T @ force.wrench
        return torques

    def inverse(self) -> Floats:
        """Joint rates per velocity. Shape (n, 6). Raises Singular, MotionError: there are not six joints."""
        return inverse_jacobian(self.matrix)
