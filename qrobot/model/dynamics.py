"""Torques of a serial arm: gravity, the full rigid-body model, friction.

Each link is given by its mass m, first moment h = m c and inertia I about the origin of its frame (modified DH, Craig),
in which the equations are linear. Torques are those the motors must supply; a joint that slides has a force instead.

Gravity needs no more than one pass outwards, which turns g into the last frame, and one inwards, which gathers mass and
moment and turns g back: no storage, so it runs in the servo cycle as it is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from qrobot.config.robot import Robot
from qrobot.config.values import Floats
from qrobot.model.chain import ChainParams, chain_params, joint_angle, joint_slide, to_link, to_parent
from qrobot.realtime.jit import kernel


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


def with_payload(params: DynamicsParams, mass: float, com: Floats) -> DynamicsParams:
    """The same arm holding a point mass (kg) at `com` in the last link's frame (m, shape (3,))."""
    masses, moment, inertia = params.mass.copy(), params.moment.copy(), params.inertia.copy()
    masses[-1] += mass
    moment[-1] += mass * np.asarray(com)
    inertia[-1] += point_inertia(mass, com)
    return params._replace(mass=masses, moment=moment, inertia=inertia)


@kernel
def gravity_torque(q: Floats, p: DynamicsParams, tau: Floats) -> None:
    """Torques that hold the arm still at `q` against gravity. Shapes (n,), N·m (N)."""
    chain = p.chain
    gx, gy, gz = p.gravity[0], p.gravity[1], p.gravity[2]
    for i in range(q.size):
        angle = joint_angle(q, chain, i)
        gx, gy, gz = to_link(math.cos(angle), math.sin(angle), chain.cos_alpha[i], chain.sin_alpha[i], gx, gy, gz)
    m, hx, hy, hz = 0.0, 0.0, 0.0, 0.0  # of everything outwards of joint i, in frame i
    for i in range(q.size - 1, -1, -1):
        m += p.mass[i]
        hx += p.moment[i, 0]
        hy += p.moment[i, 1]
        hz += p.moment[i, 2]
        tau[i] = -m * gz if chain.prismatic[i] else hy * gx - hx * gy
        angle, slide = joint_angle(q, chain, i), joint_slide(q, chain, i)
        c, s, ca, sa = math.cos(angle), math.sin(angle), chain.cos_alpha[i], chain.sin_alpha[i]
        gx, gy, gz = to_parent(c, s, ca, sa, gx, gy, gz)
        hx, hy, hz = to_parent(c, s, ca, sa, hx, hy, hz)
        hx += m * chain.a[i]
        hy -= m * sa * slide
        hz += m * ca * slide


@kernel
def friction_torque(v: Floats, p: FrictionParams, tau: Floats) -> None:
    """Torques that keep the joints moving at `v` against friction. Shapes (n,).

    Viscous friction plus Coulomb friction of the direction of motion, which grows linearly within `p.velocity` of
    standstill: continuous, zero at rest, and cheaper than a tanh.
    """
    for j in range(v.size):
        share = min(max(v[j] / p.velocity[j], -1.0), 1.0)
        coulomb = p.coulomb_pos[j] if share > 0.0 else p.coulomb_neg[j]
        tau[j] = p.viscous[j] * v[j] + coulomb * share
