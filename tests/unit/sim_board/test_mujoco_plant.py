"""The MuJoCo plant against the model's own mathematics: frames, gravity, inertia, energy."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from qrobot.config import Robot, load_robot
from qrobot.errors import ConfigError
from qrobot.model.dynamics import dynamics_params, dynamics_work, gravity_torque, inverse_dynamics
from qrobot.model.kinematics import forward, kinematics_params
from qrobot.realtime.jit import lean_kernel
from qrobot.sim_board.mujoco_plant import load_plant, robot_spec
from qrobot.sim_board.plant import Plant, step_plant

DT = 0.00025
PUMA, STANFORD = load_robot("puma560"), load_robot("stanford")
TILTED = PUMA.model_copy(
    update={"geometry": PUMA.geometry.model_copy(update={"gravity_m_s2": np.array([3.0, -4.0, -8.0])})}
)
ROBOTS = pytest.mark.parametrize("robot", [PUMA, STANFORD, TILTED], ids=["puma560", "stanford", "tilted"])


def random_states(robot: Robot, count: int = 50) -> NDArray[np.float64]:
    """Positions within limits, velocities and accelerations. Shape (count, 3, n)."""
    random = np.random.default_rng(5)
    q = random.uniform(robot.limits.q_min, robot.limits.q_max, (count, robot.n))
    return np.stack([q, random.normal(size=q.shape), random.normal(size=q.shape)], axis=1)


@ROBOTS
def test_bodies_stand_where_forward_kinematics_puts_them(robot: Robot) -> None:
    plant, params, T = load_plant(robot, DT), kinematics_params(robot), np.zeros((4, 4))
    for q, _, _ in random_states(robot):
        plant.place(q)
        forward(q, params, T)
        base = np.array([0.0, 0.0, robot.geometry.base_height_m])
        np.testing.assert_allclose(plant.data.xpos[-1], base + T[:3, 3], atol=1e-12)
        np.testing.assert_allclose(plant.data.xmat[-1].reshape(3, 3), T[:3, :3], atol=1e-12)


@ROBOTS
def test_gravity_load_is_the_models(robot: Robot) -> None:
    plant, params, tau = load_plant(robot, DT), dynamics_params(robot), np.zeros(robot.n)
    for q, _, _ in random_states(robot):
        plant.place(q)
        gravity_torque(q, params, dynamics_work(q.size), tau)
        np.testing.assert_allclose(plant.data.qfrc_bias, tau, atol=1e-9)


@ROBOTS
def test_inverse_dynamics_with_the_rotors_is_the_models(robot: Robot) -> None:
    plant, params = load_plant(robot, DT), dynamics_params(robot)
    tau, work, data = np.zeros(robot.n), dynamics_work(robot.n), plant.data
    for q, v, a in random_states(robot):
        plant.place(q)
        data.qvel[:] = v
        mujoco.mj_forward(plant.model, data)
        data.qacc[:] = a
        mujoco.mj_inverse(plant.model, data)
        inverse_dynamics(q, v, a, params, work, tau)
        np.testing.assert_allclose(data.qfrc_inverse, tau, atol=1e-9)


def test_coupled_motors_add_their_rotors_through_the_coupling() -> None:
    """M + C^T diag(G^2 Jm) C; in the wrist this makes M56 a fifth of M55 and more."""
    t = PUMA.transmission
    plant, bare = load_plant(PUMA, DT), robot_spec(PUMA, DT)
    for joint in bare.joints:
        joint.armature = 0.0
    for tendon in bare.tendons:
        tendon.armature = 0.0
    links = bare.compile()
    data = mujoco.MjData(links)
    for q, _, _ in random_states(PUMA, 10):
        plant.place(q)
        data.qpos[:] = q
        mujoco.mj_forward(links, data)
        with_rotors, without = mass_matrix(plant.model, plant.data), mass_matrix(links, data)
        expected = without + t.coupling.T @ np.diag(t.gear**2 * t.rotor_inertia) @ t.coupling
        np.testing.assert_allclose(with_rotors, expected, rtol=1e-9, atol=1e-12)
        assert with_rotors[4, 5] > 0.15 * with_rotors[4, 4]


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> NDArray[np.float64]:
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    return full


@lean_kernel
def steps(plant: Plant, count: int) -> None:
    for _ in range(count):
        step_plant(plant)


def energy(plant: object) -> float:
    model, data = plant.model, plant.data  # type: ignore[attr-defined]
    mujoco.mj_forward(model, data)
    mujoco.mj_energyPos(model, data)
    return float(data.energy[0] + 0.5 * data.qvel @ mass_matrix(model, data) @ data.qvel)


@ROBOTS
def test_a_free_arm_keeps_its_energy(robot: Robot) -> None:
    plant = load_plant(robot, DT)
    plant.place(robot.poses["park"])
    start = energy(plant)
    steps(plant.plant, 2000)
    kinetic = 0.5 * plant.data.qvel @ mass_matrix(plant.model, plant.data) @ plant.data.qvel
    assert kinetic > 1.0
    assert energy(plant) - start == pytest.approx(0.0, abs=2e-3 * kinetic)
    assert plant.warnings == 0


def test_steps_from_compiled_code_are_mujocos_own_bit_for_bit() -> None:
    ours, theirs = load_plant(PUMA, DT), load_plant(PUMA, DT)
    for plant in (ours, theirs):
        plant.place(PUMA.poses["park"])
        plant.plant.torque[:] = [5.0, -30.0, -3.0, 0.1, 0.2, 0.3]
    steps(ours.plant, 500)
    for _ in range(500):
        mujoco.mj_step(theirs.model, theirs.data)
    assert ours.data.qpos.tobytes() == theirs.data.qpos.tobytes()
    assert ours.data.qvel.tobytes() == theirs.data.qvel.tobytes()


def test_an_inertia_no_body_can_have_is_refused_by_name() -> None:
    """The published inertia of the PUMA's link 3 breaks the triangle inequality."""
    inertia = PUMA.links.inertia.copy()
    inertia[2] = [0.066, 0.0125, 0.086]
    robot = PUMA.model_copy(update={"links": PUMA.links.model_copy(update={"inertia": inertia})})
    with pytest.raises(ConfigError, match="puma560 cannot be simulated"):
        load_plant(robot, DT)
