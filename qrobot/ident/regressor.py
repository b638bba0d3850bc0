"""Torques of any serial arm as linear in its link parameters: tau = Y(q, v, a) theta + armature a.

A link has ten of them (Atkeson, An and Hollerbach 1986): mass m, first moment h = m c and inertia I about the origin of
its frame. The expression of the dynamics is differentiated by them, and what comes out is compiled as any other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import casadi
import numpy as np
from numba import types

from qrobot.arrays import Floats
from qrobot.codegen import CompiledFunction, compile_function
from qrobot.codegen.rigid_body import RigidBody, SerialArm, inverse_dynamics, serial_arm
from qrobot.config import Robot
from qrobot.model.dynamics import dynamics_params
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.pointer import KernelPointer, function_at

PER_LINK: Final = ("m", "hx", "hy", "hz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
OF_GRAVITY: Final = 4  # the first of them: a resting arm shows no inertia

_VECTOR: Final = types.float64[::1]
_SIGNATURE: Final = types.void(_VECTOR, _VECTOR, _VECTOR, _VECTOR)
_row_at = function_at(_SIGNATURE)
_NO_INERTIA: Final = casadi.SX(3, 3)


@dataclass(frozen=True)
class Regressor:
    """Matrix that multiplies the parameters of the links.

    Attributes:
        names: of the parameters, as `m1`, `hx1` ...: kg, kg m, kg m2.
        n: number of joints.
    """

    names: tuple[str, ...]
    n: int
    compiled: CompiledFunction
    pointer: KernelPointer

    def __call__(self, q: Floats, v: Floats | None = None, a: Floats | None = None) -> Floats:
        """Y at positions, velocities and accelerations of shape (m, n); those left out are 0. Shape (m, n, p)."""
        q = np.ascontiguousarray(q, np.float64)
        v, a = (np.zeros_like(q) if x is None else np.ascontiguousarray(x, np.float64) for x in (v, a))
        rows = np.empty((len(q), len(self.names) * self.n))
        fill_rows(self.pointer.address, q, v, a, rows)
        return rows.reshape(len(q), len(self.names), self.n).transpose(0, 2, 1)


@lean_kernel
def fill_rows(address: int, q: Floats, v: Floats, a: Floats, rows: Floats) -> None:
    """Evaluate the compiled expression at each of m states, shape (m, n), into `rows`, shape (m, p n)."""
    for k in range(q.shape[0]):
        _row_at(address)(q[k], v[k], a[k], rows[k])


def gravity_regressor(robot: Robot) -> Regressor:
    """Make the regressor of the torques that hold the arm: mass and first moment of each link."""
    return _regressor(robot, OF_GRAVITY)


def inertial_regressor(robot: Robot) -> Regressor:
    """Make the regressor of all torques but the rotors', which the robot file knows: ten parameters for each link."""
    return _regressor(robot, len(PER_LINK))


def known_parameters(robot: Robot, regressor: Regressor) -> Floats:
    """The robot file's values of a regressor's parameters. Shape (p,)."""
    params = dynamics_params(robot)
    whole = np.column_stack([params.mass, params.moment, params.inertia])
    return np.asarray(whole[:, : len(regressor.names) // robot.n].ravel())


def _regressor(robot: Robot, per_link: int) -> Regressor:
    theta = casadi.SX.sym("theta", per_link, robot.n)
    q, v, a = (casadi.SX.sym(name, robot.n) for name in ("q", "v", "a"))
    still = casadi.SX(robot.n, 1)
    motion = (still, still) if per_link == OF_GRAVITY else (v, a)
    tau = inverse_dynamics(_symbolic(robot, theta), q, *motion, casadi.SX(robot.geometry.gravity_m_s2))
    Y = casadi.densify(casadi.cse(casadi.jacobian(tau, casadi.vec(theta))))
    name = f"{robot.name}_{'gravity' if per_link == OF_GRAVITY else 'inertial'}_regressor"
    compiled = compile_function(casadi.Function(name, [q, v, a], [Y], ["q", "v", "a"], ["Y"]))
    names = tuple(f"{symbol}{i + 1}" for i in range(robot.n) for symbol in PER_LINK[:per_link])
    return Regressor(names, robot.n, compiled, KernelPointer(compiled.kernel, _SIGNATURE))


def _symbolic(robot: Robot, theta: casadi.SX) -> SerialArm:
    """The arm without rotors whose link i has the parameters `theta[:, i]`, inertia left out or not."""
    links = tuple(
        RigidBody(
            theta[0, i], theta[1:4, i], _tensor(theta[OF_GRAVITY:, i]) if theta.rows() > OF_GRAVITY else _NO_INERTIA
        )
        for i in range(robot.n)
    )
    return replace(serial_arm(robot), links=links, armature=np.zeros((robot.n, robot.n)))


def _tensor(six: casadi.SX) -> casadi.SX:
    """Inertia from xx yy zz xy xz yz."""
    xx, yy, zz, xy, xz, yz = casadi.vertsplit(six)
    return casadi.blockcat([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
