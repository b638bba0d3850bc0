"""The rigid-body plant: MuJoCo's motion to rounding, energy kept, refused where no body could be."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from qrobot.config import Robot, load_robot
from qrobot.config.robot import Joints
from qrobot.config.scene import Scene
from qrobot.errors import ConfigError
from qrobot.model.dynamics import dynamics_params
from qrobot.realtime.jit import lean_kernel
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mujoco_plant import load_plant
from qrobot.sim_board.plant import Plant, PlantOwner, step_plant
from qrobot.sim_board.rigid_plant import RigidPlant
from tests.support.dynamics import model_mass_matrix, potential_gain

DT = 0.00025
PUMA, STANFORD = load_robot("puma560"), load_robot("stanford")
TILTED = PUMA.model_copy(
    update={"geometry": PUMA.geometry.model_copy(update={"gravity_m_s2": np.array([3.0, -4.0, -8.0])})}
)
ROBOTS = pytest.mark.parametrize("robot", [PUMA, STANFORD, TILTED], ids=["puma560", "stanford", "tilted"])


@lean_kernel
def steps(plant: Plant, count: int) -> None:
    for _ in range(count):
        step_plant(plant)


def both(robot: Robot, **choices: float) -> tuple[PlantOwner, PlantOwner]:
    return RigidPlant(robot, DT, **choices), load_plant(robot, DT, **choices)


@pytest.mark.sampled(3)
@ROBOTS
@pytest.mark.parametrize("payload_kg", [0.0, 2.5])
def test_one_step_from_anywhere_is_mujocos(robot: Robot, payload_kg: float) -> None:
    random, owners = np.random.default_rng(1), both(robot, payload_kg=payload_kg, gravity_factor=1.05)
    for _ in range(50):
        q = random.uniform(robot.limits.q_min, robot.limits.q_max)
        v, torque = random.normal(size=robot.n), random.normal(size=robot.n) * robot.guard.tau_max
        for owner in owners:
            owner.place(q)
            owner.plant.v[:], owner.plant.torque[:] = v, torque
            steps(owner.plant, 1)
        ours, theirs = (owner.plant for owner in owners)
        np.testing.assert_allclose(ours.v, theirs.v, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(ours.q, theirs.q, rtol=1e-13, atol=1e-15)


@ROBOTS
def test_two_seconds_under_random_torques_are_mujocos(robot: Robot) -> None:
    """The torques change every 10 ms and are small enough that the arm does not tumble."""
    random, owners = np.random.default_rng(2), both(robot)
    for owner in owners:
        owner.place(robot.poses["ready"])
    for _ in range(200):
        torque = 0.05 * random.normal(size=robot.n) * robot.guard.tau_max
        for owner in owners:
            owner.plant.torque[:] = torque
            steps(owner.plant, 40)
    ours, theirs = (owner.plant for owner in owners)
    assert (np.abs(ours.q - robot.poses["ready"]) > 0.05).any()
    np.testing.assert_allclose(ours.q, theirs.q, atol=1e-8)


def total_energy(robot: Robot, plant: Plant, start: NDArray[np.float64]) -> tuple[float, float]:
    """Kinetic energy, and the gain of potential energy since `start`, J; from the control-side model."""
    params = dynamics_params(robot)
    return float(0.5 * plant.v @ model_mass_matrix(params, plant.q) @ plant.v), potential_gain(params, start, plant.q)


@ROBOTS
def test_a_free_arm_keeps_its_energy(robot: Robot) -> None:
    owner, start = RigidPlant(robot, DT), robot.poses["park"]
    owner.place(start)
    steps(owner.plant, 2000)
    kinetic, potential = total_energy(robot, owner.plant, start)
    assert kinetic > 1.0
    assert kinetic + potential == pytest.approx(0.0, abs=2e-3 * kinetic)


def test_half_the_time_step_makes_half_the_error_of_energy() -> None:
    """Semi-implicit Euler is of first order."""
    errors = []
    for dt in (DT, DT / 2):
        owner = RigidPlant(PUMA, dt)
        owner.place(PUMA.poses["park"])
        steps(owner.plant, round(0.4 / dt))
        errors.append(sum(total_energy(PUMA, owner.plant, PUMA.poses["park"])))
    assert errors[1] / errors[0] == pytest.approx(0.5, abs=0.05)


def test_placing_an_arm_forgets_its_past() -> None:
    owner, results = RigidPlant(PUMA, DT), set()
    for _ in range(2):
        owner.place(PUMA.poses["park"])
        owner.plant.torque[:] = 3.0
        steps(owner.plant, 100)
        results.add(owner.plant.q.tobytes() + owner.plant.v.tobytes())
    assert len(results) == 1


def test_an_arm_of_three_joints_is_an_arm() -> None:
    """The PUMA's first three joints, the rest cut off: falls as MuJoCo's does."""
    robot = first_joints(PUMA, 3)
    owners = both(robot)
    for owner in owners:
        owner.place(np.array([0.0, -0.3, 1.0]))
        steps(owner.plant, 1000)
    ours, theirs = (owner.plant for owner in owners)
    assert abs(ours.v[1]) > 1.0
    np.testing.assert_allclose(ours.q, theirs.q, atol=1e-10)


def first_joints(robot: Robot, n: int) -> Robot:
    """A robot that ends at joint n."""

    def cut(section: object) -> object:
        arrays = {
            name: value[:n, :n] if name == "coupling" else value[:n]
            for name, value in vars(section).items()
            if isinstance(value, np.ndarray) and name != "gravity_m_s2"
        }
        return section.model_copy(update=arrays)  # type: ignore[attr-defined]

    joints = Joints(names=robot.joint_names[:n], kinds=robot.joints.kinds[:n])
    sections = {name: cut(getattr(robot, name)) for name in ("geometry", "transmission", "links", "limits", "guard")}
    poses = {name: pose[:n] for name, pose in robot.poses.items()}
    short = robot.pose_section.model_construct(_fields_set=set(poses), **poses)
    short.__pydantic_extra__ = poses
    return robot.model_copy(update={"name": f"{robot.name}_{n}", "joints": joints, "pose_section": short, **sections})


def test_an_inertia_no_body_can_have_is_refused_by_name() -> None:
    """The published inertia of the PUMA's link 3 breaks the triangle inequality."""
    inertia = PUMA.links.inertia.copy()
    inertia[2] = [0.066, 0.0125, 0.086]
    robot = PUMA.model_copy(update={"links": PUMA.links.model_copy(update={"inertia": inertia})})
    with pytest.raises(ConfigError, match=f"puma560 cannot be simulated: links of {PUMA.joint_names[2]} have"):
        RigidPlant(robot, DT)


def test_an_arm_without_mass_or_rotors_is_refused() -> None:
    t, links = PUMA.transmission, PUMA.links
    bare = PUMA.model_copy(
        update={
            "transmission": t.model_copy(update={"rotor_inertia": 0.0 * t.rotor_inertia}),
            "links": links.model_copy(update={"mass": 0.0 * links.mass, "inertia": 0.0 * links.inertia}),
        }
    )
    with pytest.raises(ConfigError, match="its first step is not finite"):
        RigidPlant(bare, DT)


def test_physics_without_contact_has_no_scene() -> None:
    with pytest.raises(ConfigError, match="no scene 'table': use MuJoCo's"):
        Emulator(PUMA, physics="rigid", scene=Scene(kind="table"))
