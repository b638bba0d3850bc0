"""Dynamics of a serial arm as CasADi expressions.

Written from the equations and independently of `qrobot.model`, so that the two check each other. Each link is given by
mass m, first moment h = m c and inertia I about the origin of its frame (modified DH, Craig). Numbers may be symbols:
unknown parameters to identify, a payload. Twists of whole quarter turns and other zeros vanish from the expressions.

Gravity enters as an acceleration of the base (Luh, Walker and Paul 1980); the mass matrix is built from composite
bodies (Walker and Orin 1982, method 3).

Importing this module loads CasADi.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.config import Robot

SX = Any  # casadi.SX, which has no types
_ZERO = 1e-15  # cos(pi/2) is 6e-17, and stands for 0


@dataclass(frozen=True)
class RigidBody:
    """Mass in kg, first moment in kg m (3), inertia about the frame's origin in kg m2 (3, 3)."""

    mass: SX
    moment: SX
    inertia: SX

    def __add__(self, other: RigidBody) -> RigidBody:
        return RigidBody(self.mass + other.mass, self.moment + other.moment, self.inertia + other.inertia)

    def seen_from(self, turn: SX, origin: SX) -> RigidBody:
        """The same body in the parent frame, in which its own is turned by `turn` (3, 3) and stands at `origin` (3)."""
        moment = turn @ self.moment
        shift = casadi.skew(origin)
        crossed = shift @ casadi.skew(moment)
        inertia = turn @ self.inertia @ turn.T - crossed - crossed.T - self.mass * (shift @ shift)
        return RigidBody(self.mass, moment + self.mass * origin, inertia)


@dataclass(frozen=True)
class SerialArm:
    """Constants of an arm of n joints in the equations of motion.

    Attributes:
        alpha, a, d, theta: modified DH rows, rad and m; the joint adds to theta, or to d if it slides. Shape (n,).
        prismatic: which joints slide. Shape (n,).
        links: their bodies.
        armature: inertia the motors add at the joints. Shape (n, n).
    """

    alpha: Floats
    a: Floats
    d: Floats
    theta: Floats
    prismatic: NDArray[np.bool_]
    links: tuple[RigidBody, ...]
    armature: Floats

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.links)

    def holding(self, mass: SX, at: SX) -> SerialArm:
        """The arm with a point mass (kg) at `at` (m, 3) in its last frame."""
        load = point_body(mass, at)
        return replace(self, links=(*self.links[:-1], self.links[-1] + load))


def serial_arm(robot: Robot) -> SerialArm:
    """The arm of a robot file, rotors included: C^T diag(gear^2 Jm) C."""
    geometry, links, transmission = robot.geometry, robot.links, robot.transmission
    bodies = (
        point_body(mass, com) + RigidBody(0, casadi.SX(3, 1), casadi.diag(casadi.SX(inertia)))
        for mass, com, inertia in zip(links.mass, links.com, links.inertia, strict=True)
    )
    rotors = np.diag(transmission.gear**2 * transmission.rotor_inertia)
    armature = transmission.coupling.T @ rotors @ transmission.coupling
    return SerialArm(
        geometry.alpha_rad, geometry.a_m, geometry.d_m, geometry.theta_rad, robot.prismatic, tuple(bodies), armature
    )


def point_body(mass: SX, at: SX) -> RigidBody:
    """A point mass (kg) at `at` (m, 3)."""
    shift = casadi.skew(casadi.SX(at))
    return RigidBody(mass, mass * casadi.SX(at), -mass * (shift @ shift))


def _exact(value: float) -> float:
    return 0.0 if abs(value) < _ZERO else float(value)


def _frame(arm: SerialArm, q: SX, i: int) -> tuple[SX, SX]:
    """Rotation (3, 3) and origin (3) of frame i in frame i-1: Rx(alpha) Tx(a) Rz(theta) Tz(d)."""
    ca, sa = _exact(np.cos(arm.alpha[i])), _exact(np.sin(arm.alpha[i]))
    theta = arm.theta[i] + (0 if arm.prismatic[i] else q[i])
    d = arm.d[i] + (q[i] if arm.prismatic[i] else 0)
    c, s = _cosine_sine(casadi.SX(theta))
    turn = casadi.blockcat([[c, -s, 0], [ca * s, ca * c, -sa], [sa * s, sa * c, ca]])
    return turn, casadi.vertcat(arm.a[i], -sa * d, ca * d)


def _cosine_sine(angle: SX) -> tuple[SX, SX]:
    if angle.is_constant():
        return _exact(np.cos(float(angle))), _exact(np.sin(float(angle)))
    return casadi.cos(angle), casadi.sin(angle)


def last_frame(arm: SerialArm, q: SX) -> tuple[SX, SX]:
    """Rotation (3, 3) and origin (3) of the last frame in the base frame."""
    turn, origin = _frame(arm, q, 0)
    for i in range(1, arm.n):
        next_turn, next_origin = _frame(arm, q, i)
        origin, turn = origin + turn @ next_origin, turn @ next_turn
    return turn, origin


def inverse_dynamics(arm: SerialArm, q: SX, v: SX, a: SX, gravity: SX) -> SX:
    """Torques (n) for velocities `v` and accelerations `a` at `q` under `gravity` (3), rotors included."""
    frames = [_frame(arm, q, i) for i in range(arm.n)]
    forces = _link_forces(arm, frames, v, a, gravity)
    force, torque, tau = casadi.SX(3, 1), casadi.SX(3, 1), casadi.SX(arm.n, 1)
    for i in reversed(range(arm.n)):
        force, torque = force + forces[i][0], torque + forces[i][1]
        tau[i] = force[2] if arm.prismatic[i] else torque[2]
        turn, origin = frames[i]
        force, torque = turn @ force, turn @ torque
        torque += casadi.cross(origin, force)
    return tau + casadi.SX(arm.armature) @ a


def _link_forces(arm: SerialArm, frames: list[tuple[SX, SX]], v: SX, a: SX, gravity: SX) -> list[tuple[SX, SX]]:
    """Force and torque about the origin of its frame that each link's motion takes."""
    cross = casadi.cross
    omega, alpha, accel = casadi.SX(3, 1), casadi.SX(3, 1), -gravity
    forces = []
    for i, (turn, origin) in enumerate(frames):
        accel = turn.T @ (accel + cross(alpha, origin) + cross(omega, cross(omega, origin)))
        omega, alpha = turn.T @ omega, turn.T @ alpha
        rate, push = casadi.vertcat(0, 0, v[i]), casadi.vertcat(0, 0, a[i])
        if arm.prismatic[i]:
            accel += push + 2 * cross(omega, rate)
        else:
            alpha, omega = alpha + push + cross(omega, rate), omega + rate
        link = arm.links[i]
        force = link.mass * accel + cross(alpha, link.moment) + cross(omega, cross(omega, link.moment))
        torque = link.inertia @ alpha + cross(link.moment, accel) + cross(omega, link.inertia @ omega)
        forces.append((force, torque))
    return forces


def mass_matrix(arm: SerialArm, q: SX) -> SX:
    """M (n, n), rotors included."""
    M, outer = casadi.SX(arm.armature), RigidBody(0, casadi.SX(3, 1), casadi.SX(3, 3))
    frames = [_frame(arm, q, i) for i in range(arm.n)]
    axis = casadi.SX([0, 0, 1])
    for j in reversed(range(arm.n)):
        outer = outer + arm.links[j]
        # What a unit acceleration of joint j alone takes, passed inwards from joint to joint.
        if arm.prismatic[j]:
            force, torque = outer.mass * axis, casadi.cross(outer.moment, axis)
        else:
            force, torque = casadi.cross(axis, outer.moment), outer.inertia @ axis
        for i in range(j, -1, -1):
            M[i, j] += force[2] if arm.prismatic[i] else torque[2]
            M[j, i] = M[i, j]
            turn, origin = frames[i]
            force, torque = turn @ force, turn @ torque
            torque += casadi.cross(origin, force)
        outer = outer.seen_from(*frames[j])
    return M


def forward_dynamics(arm: SerialArm, q: SX, v: SX, tau: SX, gravity: SX) -> SX:
    """Accelerations (n) under joint torques `tau`."""
    bias = inverse_dynamics(arm, q, v, casadi.SX(arm.n, 1), gravity)
    return solve_positive(mass_matrix(arm, q), tau - bias)


def euler_step(robot: Robot) -> casadi.Function:
    """One semi-implicit Euler step of a robot with a point mass at its flange, for `sim_board.plant.Plant.step`.

    Inputs: `handles` (0, a place other plants need), `constants` (time step in s, gravity (3) in m/s2, payload in kg),
    and `q`, `v`, `torque` (n). Outputs: `q_next`, `v_next`.
    """
    handles, constants = casadi.SX.sym("handles", 0), casadi.SX.sym("constants", 5)
    q, v, torque = (casadi.SX.sym(name, robot.n) for name in ("q", "v", "torque"))
    dt, gravity, payload = constants[0], constants[1:4], constants[4]
    arm = serial_arm(robot).holding(payload, [0.0, 0.0, robot.geometry.flange_m])
    v_next = v + dt * forward_dynamics(arm, q, v, torque, gravity)
    results = casadi.cse([q + dt * v_next, v_next])
    names = ["handles", "constants", "q", "v", "torque"], ["q_next", "v_next"]
    return casadi.Function(f"{robot.name}_step", [handles, constants, q, v, torque], results, *names)


def solve_positive(M: SX, b: SX) -> SX:
    """x of M x = b for a symmetric positive definite M (n, n), as L D L^T written out.

    The last unknown is eliminated first: the inertias at an arm's tip depend on least, often on nothing.
    """
    n = M.shape[0]
    M, x, inverse = casadi.SX(M), casadi.SX(b), casadi.SX(n, 1)
    for j in reversed(range(n)):
        inverse[j] = 1 / M[j, j]
        for i in range(j):
            factor = M[j, i] * inverse[j]
            x[i] -= factor * x[j]
            for k in range(i + 1):
                M[i, k] -= factor * M[j, k]
    for j in range(n):
        for i in range(j):
            x[j] -= M[j, i] * x[i]
        x[j] *= inverse[j]
    return x
