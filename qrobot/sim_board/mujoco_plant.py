"""The arm as a rigid-body plant in MuJoCo, stepped from compiled code.

It, `mujoco_scene` and `held_body` alone import `mujoco`, lazily.

The model is built from the robot file for any serial arm in modified DH: body i sits at
(a, -sin(alpha) d, cos(alpha) d), turned by alpha about x and theta about z, and its joint is the z axis; the joint
variable is the robot file's (VAL for the PUMA), so qpos is q. A motor that turns one joint is that joint's armature;
one that turns several is a fixed tendon with armature, which gives M + C^T diag(G^2 Jm) C. Friction, brakes and motors
are not MuJoCo's: `drive` computes them and applies joint torques. With constraints and all else that is not needed
switched off a step of the PUMA takes half the time it takes with frictionloss. A scene brings contacts with it
(`mujoco_scene`), and the joints of what can move follow those of the arm.

An `mju_error` under a call from compiled code ends the process, so a model is stepped once from Python before use.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.scene import Scene
from qrobot.errors import ConfigError
from qrobot.realtime.jit import lean_kernel
from qrobot.sim_board.mujoco_library import (
    link_library,
    mj_com_pos,
    mj_com_vel,
    mj_factor_mass,
    mj_kinematics,
    mj_make_mass,
    mj_rne,
    mj_solve_mass,
    mj_step,
)
from qrobot.sim_board.mujoco_scene import (
    CRANK,
    FURNITURE,
    TOOL,
    add_furniture,
    add_tool,
    add_wrist_sensor,
    set_contact_options,
)
from qrobot.sim_board.plant import Plant, plant_step

if TYPE_CHECKING:
    import mujoco

EMPTY: Final = Scene()


class PlantMemory:
    """Owner of the MuJoCo objects behind a plant."""

    def __init__(self, robot: Robot, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self.model = model
        self.data = data
        self._n, self._base_height = robot.n, robot.geometry.base_height_m
        self._numbers = np.concatenate([[model.opt.timestep], np.zeros(2 * model.nv)])  # force and acceleration

    @property
    def plant(self) -> Plant:
        """Addresses and views for compiled code; valid while this object lives."""
        model, data, numbers, n = self.model, self.data, self._numbers, self._n
        force, acceleration = numbers[1:].ctypes.data, numbers[1 + model.nv :].ctypes.data
        handles = np.array([model._address, data._address, force, acceleration])
        step = plant_step(_free_step if self._is_free else step_model)
        return Plant(step, handles, numbers, data.qpos[:n], data.qvel[:n], data.qfrc_applied[:n])

    @property
    def wrist(self) -> Floats:
        """Force and torque of the flange on the tool in the last step, in its frame, N and N m. A view, shape (6,).

        Empty without a sensor.
        """
        sensed: Floats = self.data.sensordata
        return sensed

    @property
    def _is_free(self) -> bool:
        """Whether the arm can touch nothing and senses nothing, so that it does not need all that `mj_step` does."""
        import mujoco

        unconstrained = self.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        return bool(unconstrained) and self.model.nsensor == 0

    @property
    def warnings(self) -> int:
        """Number of MuJoCo's warnings (a state that is not finite or huge, ...) since the last `place`."""
        return int(sum(warning.number for warning in self.data.warning))

    def place(self, q: NDArray[np.float64]) -> None:
        """Put the arm at `q` at rest."""
        import mujoco

        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[: self._n] = q
        mujoco.mj_forward(self.model, self.data)

    def contact_force(self) -> Floats:
        """Force of all that touches the tool on it, in the base frame, N, in the last step. Shape (3,)."""
        import mujoco

        total, wrench, tool = np.zeros(3), np.zeros(6), self.model.geom(TOOL).id
        for i in range(self.data.ncon):
            contact = self.data.contact[i]
            mujoco.mj_contactForce(self.model, self.data, i, wrench)
            force = contact.frame.reshape(3, 3).T @ wrench[:3]  # of the first on the second
            total += force if contact.geom[1] == tool else -force
        return total

    def move_scene(self, position: Sequence[float] | Floats) -> None:
        """Put what stands around elsewhere, as `Scene.position_m`, also while the plant runs. Shape (3,), m."""
        self.data.mocap_pos[self.model.body(FURNITURE).mocapid] = np.add(position, [0.0, 0.0, self._base_height])

    @property
    def crank_angle(self) -> float:
        """Angle by which the crank has been turned, rad, counted on beyond a full turn."""
        return float(self.data.joint(CRANK).qpos[0])


def load_plant(
    robot: Robot,
    dt: float,
    gravity_factor: float = 1.0,
    scene: Scene = EMPTY,
    payload_kg: float = 0.0,
    sensed: bool = False,
) -> PlantMemory:
    """Build the plant of `robot` and try it. Raises ConfigError when MuJoCo refuses the robot's masses or inertias."""
    import mujoco

    spec = robot_spec(robot, dt, gravity_factor, scene, payload_kg, sensed)
    with _refusals(robot):
        model = spec.compile()
    memory = PlantMemory(robot, model, mujoco.MjData(model))
    memory.place(robot.poses["zero"] if "zero" in robot.poses else np.zeros(robot.n))
    mujoco.mj_step(model, memory.data)
    if memory.warnings:
        raise ConfigError(f"{robot.name} cannot be simulated: its first step is not finite")
    link_library()
    return memory


def mjcf_text(robot: Robot, dt: float) -> str:
    """The MuJoCo model of a robot as MJCF. Raises ConfigError when MuJoCo refuses its masses or inertias."""
    with _refusals(robot):
        return str(robot_spec(robot, dt).to_xml())


@contextmanager
def _refusals(robot: Robot) -> Iterator[None]:
    """A block in which MuJoCo may refuse a robot's masses or inertias. Raises ConfigError then."""
    try:
        yield
    except ValueError as error:
        raise ConfigError(f"{robot.name} cannot be simulated: {error}") from error


def robot_spec(
    robot: Robot,
    dt: float,
    gravity_factor: float = 1.0,
    scene: Scene = EMPTY,
    payload_kg: float = 0.0,
    sensed: bool = False,
) -> mujoco.MjSpec:
    """The MuJoCo model of a robot with a point mass at its flange; `.to_xml()` gives MJCF.

    The flange carries the scene's tool when there is something to touch, or a force sensor.
    """
    import mujoco

    spec, geometry = mujoco.MjSpec(), robot.geometry
    spec.modelname = robot.name
    spec.compiler.degree = False
    _set_options(spec, dt, geometry.gravity_m_s2 * gravity_factor, scene, sensed)
    body = spec.worldbody.add_body(name="base", pos=[0.0, 0.0, geometry.base_height_m])
    for i in range(robot.n):
        body = _add_link(body, robot, i)
    _add_coupled_motors(spec, robot)
    if payload_kg:
        _add_payload(body, payload_kg, geometry.flange_m)
    if scene.kind != "empty" or sensed:
        add_tool(body, scene.tool, geometry.flange_m)
    if scene.kind != "empty":
        set_contact_options(spec)
        add_furniture(spec, scene, geometry.base_height_m)
    if sensed:
        add_wrist_sensor(spec)
    return spec


def _set_options(spec: mujoco.MjSpec, dt: float, gravity: NDArray[np.float64], scene: Scene, sensed: bool) -> None:
    import mujoco

    off = mujoco.mjtDisableBit
    flags = off.mjDSBL_LIMIT | off.mjDSBL_EQUALITY | off.mjDSBL_SPRING | off.mjDSBL_DAMPER
    flags |= off.mjDSBL_ACTUATION | off.mjDSBL_EULERDAMP | off.mjDSBL_AUTORESET
    if scene.kind != "crank":
        flags |= off.mjDSBL_FRICTIONLOSS
    if scene.kind == "empty":
        flags |= off.mjDSBL_CONSTRAINT | off.mjDSBL_CONTACT
    if not sensed:
        flags |= off.mjDSBL_SENSOR
    spec.option.disableflags = int(flags)
    spec.option.timestep = dt
    spec.option.gravity = gravity
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.jacobian = mujoco.mjtJacobian.mjJAC_DENSE


def _add_link(parent: Any, robot: Robot, i: int) -> Any:
    """Body and joint i below `parent`."""
    import mujoco

    geometry, links = robot.geometry, robot.links
    alpha, a, d = geometry.alpha_rad[i], geometry.a_m[i], geometry.d_m[i]
    body = parent.add_body(name=robot.joint_names[i], explicitinertial=True)
    body.pos = [a, -np.sin(alpha) * d, np.cos(alpha) * d]
    body.quat = _about_x_then_z(alpha, geometry.theta_rad[i])
    body.mass, body.ipos, body.inertia = links.mass[i], links.com[i], links.inertia[i]
    slides = robot.prismatic[i]
    joint = body.add_joint(name=robot.joint_names[i], axis=[0.0, 0.0, 1.0])
    joint.type = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
    if not _turns_several(robot, i):
        joint.armature = robot.transmission.gear[i] ** 2 * robot.transmission.rotor_inertia[i]
    return body


def _add_payload(last_link: Any, mass: float, flange_m: float) -> None:
    """A point mass at the flange."""
    load = last_link.add_body(name="payload", explicitinertial=True, pos=[0.0, 0.0, flange_m])
    load.mass, load.ipos, load.inertia = mass, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]


def _about_x_then_z(alpha: float, theta: float) -> list[float]:
    """Quaternion of Rx(alpha) Rz(theta)."""
    cx, sx, cz, sz = np.cos(alpha / 2), np.sin(alpha / 2), np.cos(theta / 2), np.sin(theta / 2)
    return [cx * cz, sx * cz, -sx * sz, cx * sz]


def _turns_several(robot: Robot, motor: int) -> bool:
    """True when motor i's position depends on other joints than joint i."""
    row = robot.transmission.coupling[motor].copy()
    row[motor] -= 1.0
    return bool(row.any())


def _add_coupled_motors(spec: mujoco.MjSpec, robot: Robot) -> None:
    transmission = robot.transmission
    for motor in range(robot.n):
        if not _turns_several(robot, motor):
            continue
        tendon = spec.add_tendon(name=f"motor_{robot.joint_names[motor]}")
        tendon.armature = transmission.gear[motor] ** 2 * transmission.rotor_inertia[motor]
        for name, coefficient in zip(robot.joint_names, transmission.coupling[motor], strict=True):
            if coefficient != 0.0:
                tendon.wrap_joint(name, coefficient)


@lean_kernel
def step_model(handles: NDArray[np.int64], _constants: Floats, _q: Floats, _v: Floats, _torque: Floats) -> None:
    """Advance by the model's time step; positions, velocities and torques are views of its memory."""
    mj_step(handles[0], handles[1])


@lean_kernel
def _free_step(handles: NDArray[np.int64], numbers: Floats, q: Floats, v: Floats, torque: Floats) -> None:
    """The rest of `mj_step` for hinges and slides that touch nothing, to the same bits in half the time.

    v <- v + dt M(q)^-1 (torque - bias(q, v)),    q <- q + dt v

    The tendons are linear, so their share of M needs what `place` computed once. `handles` ends in the addresses, and
    `numbers` (the time step first) in the places, of forces and accelerations.
    """
    model, data, force, acceleration = handles[0], handles[1], handles[2], handles[3]
    n = q.size
    mj_kinematics(model, data)
    mj_com_pos(model, data)
    mj_make_mass(model, data)
    mj_factor_mass(model, data)
    mj_com_vel(model, data)
    mj_rne(model, data, 0, force)
    for i in range(n):
        numbers[1 + i] = torque[i] - numbers[1 + i]
    mj_solve_mass(model, data, acceleration, force, 1)
    for i in range(n):
        v[i] += numbers[1 + n + i] * numbers[0]
        q[i] += numbers[0] * v[i]
