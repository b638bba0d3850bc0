"""Rigid-body identities that hold at every state: energy, power, linearity, and MuJoCo's independent opinion."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.arrays import Floats
from qrobot.config import Robot, load_robot
from qrobot.model.arm import Arm
from qrobot.model.dynamics import (
    DynamicsParams,
    dynamics_params,
    dynamics_work,
    gravity_torque,
    inverse_dynamics,
    with_payload,
)

ROBOTS = [load_robot("puma560"), load_robot("stanford")]
robots = st.sampled_from(ROBOTS)
six = st.lists(st.floats(-1, 1), min_size=6, max_size=6).map(np.array)


def pose(robot: Robot, share: Floats) -> Floats:
    low, high = robot.limits.q_min, robot.limits.q_max
    return np.asarray(0.5 * (low + high) + 0.5 * share * (high - low))


def torques(q: Floats, v: Floats, a: Floats, params: DynamicsParams) -> Floats:
    tau = np.empty(6)
    inverse_dynamics(q, v, a, params, dynamics_work(6), tau)
    return tau


def gravity(q: Floats, params: DynamicsParams) -> Floats:
    tau = np.empty(6)
    gravity_torque(q, params, dynamics_work(q.size), tau)
    return tau


def potential(robot: Robot, q: Floats) -> float:
    """Potential energy from the definition: the height of each centre of mass, by homogeneous transforms."""
    g, T, energy = robot.geometry, np.eye(4), 0.0
    for i in range(robot.n):
        theta = g.theta_rad[i] + (0.0 if robot.prismatic[i] else q[i])
        d = g.d_m[i] + (q[i] if robot.prismatic[i] else 0.0)
        ca, sa, ct, s = np.cos(g.alpha_rad[i]), np.sin(g.alpha_rad[i]), np.cos(theta), np.sin(theta)
        T = T @ np.array(
            [[ct, -s, 0, g.a_m[i]], [s * ca, ct * ca, -sa, -sa * d], [s * sa, ct * sa, ca, ca * d], [0, 0, 0, 1]]
        )
        energy -= robot.links.mass[i] * float(g.gravity_m_s2 @ (T @ [*robot.links.com[i], 1.0])[:3])
    return energy


def kinetic(q: Floats, v: Floats, params: DynamicsParams) -> float:
    return float(0.5 * v @ (torques(q, np.zeros(6), v, params) - gravity(q, params)))


@given(robots, six, st.integers(0, 5))
def test_gravity_torque_is_the_slope_of_the_potential_energy(robot: Robot, share: Floats, j: int) -> None:
    q, h = pose(robot, share), 1e-5
    step = h * np.eye(6)[j]
    slope = (potential(robot, q + step) - potential(robot, q - step)) / (2 * h)
    assert gravity(q, dynamics_params(robot))[j] == pytest.approx(slope, abs=1e-6)


@given(robots, six)
def test_gravity_alone_is_inverse_dynamics_at_rest(robot: Robot, share: Floats) -> None:
    q, params = pose(robot, share), dynamics_params(robot)
    np.testing.assert_allclose(torques(q, np.zeros(6), np.zeros(6), params), gravity(q, params), atol=1e-12)


@given(robots, six, six, six)
def test_motor_power_is_the_growth_of_energy(robot: Robot, share: Floats, v: Floats, a: Floats) -> None:
    q, params, h = pose(robot, share), dynamics_params(robot), 1e-5

    def energy(t: float) -> float:
        at, speed = q + t * v + 0.5 * t * t * a, v + t * a
        return kinetic(at, speed, params) + potential(robot, at)

    growth = (energy(h) - energy(-h)) / (2 * h)
    assert torques(q, v, a, params) @ v == pytest.approx(growth, abs=1e-5)


@given(robots, six, six, st.floats(0, 5), st.tuples(*[st.floats(-0.2, 0.2)] * 3).map(np.array))
def test_a_payload_pulls_through_the_jacobian(robot: Robot, share: Floats, v: Floats, mass: float, com: Floats) -> None:
    """Gravity of a held point mass is J' m g at the point: what a wrench at the tip asks of the joints."""
    arm, q, params = Arm(robot), pose(robot, share), dynamics_params(robot)
    J, lever = arm.jacobian(q), arm.forward(q)[:3, :3] @ com
    at_point = J[:3] + np.cross(J[3:].T, lever).T
    extra = gravity(q, with_payload(params, mass, com)) - gravity(q, params)
    np.testing.assert_allclose(extra, -at_point.T @ (mass * robot.geometry.gravity_m_s2), atol=1e-9)


def mujoco_model(robot: Robot) -> tuple[Any, Any]:
    """The bare links in MuJoCo: a body per link frame, a joint about or along its z."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.option.gravity = robot.geometry.gravity_m_s2
    body, g = spec.worldbody, robot.geometry
    for i in range(robot.n):
        ca, sa = np.cos(g.alpha_rad[i]), np.sin(g.alpha_rad[i])
        half = 0.5 * g.alpha_rad[i]
        twist, turn = [np.cos(half), np.sin(half), 0, 0], [np.cos(g.theta_rad[i] / 2), 0, 0, np.sin(g.theta_rad[i] / 2)]
        quat = np.empty(4)
        mujoco.mju_mulQuat(quat, np.array(twist), np.array(turn))
        body = body.add_body(pos=[g.a_m[i], -sa * g.d_m[i], ca * g.d_m[i]], quat=quat)
        kind = mujoco.mjtJoint.mjJNT_SLIDE if robot.prismatic[i] else mujoco.mjtJoint.mjJNT_HINGE
        body.add_joint(type=kind, axis=[0, 0, 1])
        body.mass, body.ipos, body.inertia = robot.links.mass[i], robot.links.com[i], robot.links.inertia[i]
        body.explicitinertial = True
    model = spec.compile()
    return model, mujoco.MjData(model)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_mujocos_inverse_dynamics_agrees(robot: Robot) -> None:
    model, data = mujoco_model(robot)
    params = dynamics_params(robot)._replace(armature=np.zeros((6, 6)))
    rng = np.random.default_rng(7)
    for _ in range(100):
        data.qpos[:] = pose(robot, rng.uniform(-1, 1, 6))
        data.qvel[:], data.qacc[:] = rng.uniform(-3, 3, 6), rng.uniform(-5, 5, 6)
        mujoco.mj_inverse(model, data)
        ours = torques(data.qpos.copy(), data.qvel.copy(), data.qacc.copy(), params)
        np.testing.assert_allclose(ours, data.qfrc_inverse, atol=1e-9)
