"""Torques of a serial arm: gravity, the full rigid-body model, friction.

Each link is given by its mass m, first moment h = m c and inertia I about the origin of its frame (modified DH, Craig),
in which the equations are linear. Torques are those the motors must supply; a joint that slides has a force instead.

Gravity needs no more than one pass outwards, which turns g into the last frame, and one inwards, which gathers mass and
moment and turns g back. Sines and cosines come first, all in one loop: the processor then works on several at once
instead of waiting for each in turn, which halves the time in the servo cycle.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.robot import Robot
from qrobot.model.chain import ChainParams, LinkRotation, chain_params, link_origin, link_turn, to_link, to_parent
from qrobot.model.vec3 import Vec, add, cross, row, scale
from qrobot.realtime.jit import lean_kernel


class DynamicsParams(NamedTuple):
    """Rigid-body model of n links for the kernels.

    Attributes:
        chain: the link frames.
        mass: kg. Shape (n,).
        moment: first moment m c in the link frame, kg·m. Shape (n, 3).
        inertia: about the link frame's origin, kg·m², as xx yy zz xy xz yz of the tensor. Shape (n, 6).
        armature: motor rotors seen from the joints, C^T diag(gear² Jm) C. Shape (n, n).
        gravity: in the base frame, m/s². Shape (3,).
    """

    chain: ChainParams
    mass: Floats
    moment: Floats
    inertia: Floats
    armature: Floats
    gravity: Floats


class FrictionParams(NamedTuple):
    """Joint friction for the kernels; shapes (n,), N·m (or N) and rad/s (or m/s)."""

    viscous: Floats
    coulomb_pos: Floats
    coulomb_neg: Floats
    velocity: Floats


def dynamics_params(robot: Robot) -> DynamicsParams:
    """Collect the rigid-body model of `robot` for the kernels; fresh, writable arrays of one Numba type."""
    t, links = robot.transmission, robot.links
    inertia = np.zeros((robot.n, 6))
    inertia[:, :3] = links.inertia
    for i in range(robot.n):
        inertia[i] += point_inertia(links.mass[i], links.com[i])
    return DynamicsParams(
        chain=chain_params(robot),
        mass=np.array(links.mass),
        moment=links.mass[:, None] * links.com,
        inertia=inertia,
        armature=t.coupling.T @ np.diag(t.gear**2 * t.rotor_inertia) @ t.coupling,
        gravity=np.array(robot.geometry.gravity_m_s2),
    )


def friction_params(robot: Robot, preset: str | None = None) -> FrictionParams:
    """Collect a friction preset of `robot`, by default the one its control section names."""
    friction = robot.friction[preset or robot.control.friction_preset]
    return FrictionParams(
        viscous=np.array(friction.viscous),
        coulomb_pos=np.array(friction.coulomb_pos),
        coulomb_neg=np.array(friction.coulomb_neg),
        velocity=np.array(robot.control.friction_velocity),
    )


def point_inertia(mass: float, at: Floats) -> Floats:
    """Inertia about the origin of a point mass (kg) at `at` (m), as xx yy zz xy xz yz of the tensor. Shape (6,)."""
    x, y, z = at
    return mass * np.array([y * y + z * z, x * x + z * z, x * x + y * y, -x * y, -x * z, -y * z])


def with_payload(params: DynamicsParams, mass: float, com: Floats, own: Floats | None = None) -> DynamicsParams:
    """The same arm holding a mass (kg) at `com` in the last link's frame (m, shape (3,)).

    `own` is its inertia about `com`, kg m^2, as xx yy zz xy xz yz, shape (6,); a point mass has none.
    """
    masses, moment, inertia = params.mass.copy(), params.moment.copy(), params.inertia.copy()
    masses[-1] += mass
    moment[-1] += mass * np.asarray(com)
    inertia[-1] += point_inertia(mass, com)
    inertia[-1] += 0.0 if own is None else np.asarray(own)
    return params._replace(mass=masses, moment=moment, inertia=inertia)


def dynamics_work(n: int) -> Floats:
    """Scratch space: angular velocity, angular and linear acceleration of each link, then its turn. Shape (4n, 3)."""
    return np.zeros((4 * n, 3))


@lean_kernel
def _turn_links(q: Floats, p: DynamicsParams, work: Floats) -> None:
    """Cosine and sine of each link's angle."""
    for i in range(q.size):
        cosine, sine, _, _ = link_turn(q, p.chain, i)
        work[3 * q.size + i, 0], work[3 * q.size + i, 1] = cosine, sine


@lean_kernel
def _turn(p: DynamicsParams, work: Floats, i: int) -> LinkRotation:
    """`link_turn` as `_turn_links` has left it."""
    at = 3 * p.mass.size + i
    return work[at, 0], work[at, 1], p.chain.cos_alpha[i], p.chain.sin_alpha[i]


@lean_kernel
def gravity_torque(q: Floats, p: DynamicsParams, work: Floats, tau: Floats) -> None:
    """Torques that hold the arm still at `q` against gravity. Shapes (n,), N·m (N)."""
    _turn_links(q, p, work)
    g = (p.gravity[0], p.gravity[1], p.gravity[2])
    for i in range(q.size):
        g = to_link(_turn(p, work, i), g)
    mass, moment = 0.0, (0.0, 0.0, 0.0)  # of everything outwards of joint i, in frame i
    for i in range(q.size - 1, -1, -1):
        mass += p.mass[i]
        moment = add(moment, row(p.moment, i))
        tau[i] = -mass * g[2] if p.chain.prismatic[i] else moment[1] * g[0] - moment[0] * g[1]
        turn = _turn(p, work, i)
        g = to_parent(turn, g)
        moment = add(to_parent(turn, moment), scale(mass, link_origin(q, p.chain, i)))


@lean_kernel
def inverse_dynamics(q: Floats, v: Floats, a: Floats, p: DynamicsParams, work: Floats, tau: Floats) -> None:
    """Torques for velocities `v` and accelerations `a` at `q`: recursive Newton-Euler, rotors included. Shapes (n,).

    The rotors count with the inertia they add at the joints (`p.armature`), not with their gyroscopic torques.
    """
    _turn_links(q, p, work)
    _move_links(q, v, a, p, work)
    _gather_forces(q, p, work, tau)
    for i in range(q.size):
        for j in range(q.size):
            tau[i] += p.armature[i, j] * a[j]


@lean_kernel
def _move_links(q: Floats, v: Floats, a: Floats, p: DynamicsParams, work: Floats) -> None:
    """Outwards: motion of each link in its own frame, with the base accelerating against gravity."""
    still = (0.0, 0.0, 0.0)
    omega, alpha, accel = still, still, (-p.gravity[0], -p.gravity[1], -p.gravity[2])
    for i in range(q.size):
        turn, origin = _turn(p, work, i), link_origin(q, p.chain, i)
        accel = to_link(turn, add(accel, add(cross(alpha, origin), cross(omega, cross(omega, origin)))))
        omega, alpha = to_link(turn, omega), to_link(turn, alpha)
        rate, push = (0.0, 0.0, v[i]), (0.0, 0.0, a[i])
        if p.chain.prismatic[i]:
            accel = add(accel, add(push, scale(2.0, cross(omega, rate))))
        else:
            alpha = add(alpha, add(push, cross(omega, rate)))
            omega = add(omega, rate)
        for axis in range(3):
            work[3 * i, axis], work[3 * i + 1, axis], work[3 * i + 2, axis] = omega[axis], alpha[axis], accel[axis]


@lean_kernel
def _gather_forces(q: Floats, p: DynamicsParams, work: Floats, tau: Floats) -> None:
    """Inwards: force and torque that each joint passes on to everything outwards of it."""
    force, torque = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(q.size - 1, -1, -1):
        omega, alpha, accel = row(work, 3 * i), row(work, 3 * i + 1), row(work, 3 * i + 2)
        moment = row(p.moment, i)
        force = add(force, add(scale(p.mass[i], accel), cross(alpha, moment)))
        force = add(force, cross(omega, cross(omega, moment)))
        torque = add(torque, add(_times_inertia(p, i, alpha), cross(moment, accel)))
        torque = add(torque, cross(omega, _times_inertia(p, i, omega)))
        tau[i] = force[2] if p.chain.prismatic[i] else torque[2]
        turn = _turn(p, work, i)
        force = to_parent(turn, force)
        torque = add(to_parent(turn, torque), cross(link_origin(q, p.chain, i), force))


@lean_kernel
def _times_inertia(p: DynamicsParams, i: int, v: Vec) -> Vec:
    xx, yy, zz = p.inertia[i, 0], p.inertia[i, 1], p.inertia[i, 2]
    xy, xz, yz = p.inertia[i, 3], p.inertia[i, 4], p.inertia[i, 5]
    return xx * v[0] + xy * v[1] + xz * v[2], xy * v[0] + yy * v[1] + yz * v[2], xz * v[0] + yz * v[1] + zz * v[2]


@lean_kernel
def friction_torque(v: Floats, p: FrictionParams, tau: Floats) -> None:
    """Torques that keep the joints moving at `v` against friction. Shapes (n,).

    Viscous friction plus Coulomb friction of the direction of motion, which grows linearly within `p.velocity` of
    standstill: continuous, zero at rest, and cheaper than a tanh.
    """
    for j in range(v.size):
        share = min(max(v[j] / p.velocity[j], -1.0), 1.0)
        coulomb = p.coulomb_pos[j] if share > 0.0 else p.coulomb_neg[j]
        tau[j] = p.viscous[j] * v[j] + coulomb * share
