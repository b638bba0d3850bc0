"""Board, drives and plant together: one call per plant step, in lock-step or behind a clock."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.scene import ForceSensor, Scene
from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import PANEL_MICRO, BoardMemory
from qrobot.hwif.bus import check_encoders
from qrobot.hwif.registers import DISCRETE_CALIBRATED, N_ENCODERS
from qrobot.realtime.flat_record import record_of
from qrobot.realtime.jit import lean_kernel
from qrobot.sim_board.analog import Analog, make_analog
from qrobot.sim_board.board import (
    REG_BRAKED,
    REG_DISCRETE,
    REG_POWER,
    REG_PRESSES,
    BoardOptions,
    BoardState,
    accept_operations,
    make_board,
    publish_sample,
    take_sample,
)
from qrobot.sim_board.drive import JointDrives, drive_torque, make_drive
from qrobot.sim_board.encoder import COUNTER_MASK, make_encoders
from qrobot.sim_board.fault_effects import ENC_TURNED, PUSH
from qrobot.sim_board.faults import FaultPlan
from qrobot.sim_board.injection import FaultPanel, apply_faults
from qrobot.sim_board.mismatch import PlantMismatch
from qrobot.sim_board.mujoco_plant import EMPTY, PlantMemory, load_plant
from qrobot.sim_board.plant import Physics, Plant, PlantOwner, step_plant
from qrobot.sim_board.rigid_plant import RigidPlant
from qrobot.sim_board.wrist import Wrist, make_wrist, no_wrist, sense_wrist
from qrobot.units import NS_PER_S

PLANT_HZ: Final = 4000
REST: Final = 1e-12  # joint units per second; slower is standing still


class EmulatorBundle(NamedTuple):
    """Everything a plant step needs, as plain arrays and numbers: an argument for other kernels."""

    board: BoardState
    drive: JointDrives
    plant: Plant
    wrist: Wrist
    counts_per_unit: Floats  # [n] counts per rad (or m) of motor-side position, signed
    q_offset: Floats  # [n] joint position at encoder zero
    shaft: Floats  # [6] encoder shafts, counts from encoder zero
    period_ns: int


@lean_kernel
def turn_shafts(bundle: EmulatorBundle) -> None:
    """Encoder shafts from joint positions: counts of r = C (q - q_offset)."""
    coupling, n = bundle.drive.coupling, bundle.q_offset.size
    for i in range(n):
        r = 0.0
        for j in range(n):
            r += coupling[i, j] * (bundle.plant.q[j] - bundle.q_offset[j])
        bundle.shaft[i] = bundle.counts_per_unit[i] * r


@lean_kernel
def _come_to_rest(v: Floats) -> None:
    """Keep the velocities of a resting arm from decaying into denormal numbers: arithmetic is far slower there."""
    for i in range(v.size):
        if abs(v[i]) < REST:
            v[i] = 0.0


@lean_kernel
def advance(bundle: EmulatorBundle, memory: BoardMemory, now_ns: int, sample_ns: int) -> None:
    """One plant step: apply what was posted until `now_ns`, move the arm, publish the image of `sample_ns`."""
    _move(bundle, memory, now_ns)
    publish_sample(bundle.board, memory, bundle.shaft, sample_ns)
    memory.facts.now_ns = sample_ns


@lean_kernel
def advance_unseen(bundle: EmulatorBundle, memory: BoardMemory, now_ns: int, sample_ns: int) -> None:
    """The same for a step of the past: who controls the arm would take its image for one of the present."""
    _move(bundle, memory, now_ns)
    take_sample(bundle.board, memory, bundle.shaft, sample_ns)


@lean_kernel
def _move(bundle: EmulatorBundle, memory: BoardMemory, now_ns: int) -> None:
    board, plant = bundle.board, bundle.plant
    apply_faults(board, memory, now_ns)
    accept_operations(board, memory, now_ns)
    powered = board.register[REG_POWER] == 1
    _come_to_rest(plant.v)
    drive_torque(bundle.drive, board.amplified, powered, board.brake, plant.v, plant.torque)
    for i in range(plant.torque.size):
        plant.torque[i] += memory.panel.push[i] / PANEL_MICRO + board.upset.knob[PUSH, i]
    step_plant(plant)
    sense_wrist(bundle.wrist, board.analog.external)
    turn_shafts(bundle)


@lean_kernel
def emulator_step(bundle: EmulatorBundle, memory: BoardMemory, t_ns: int) -> None:
    """Lock-step: operations posted by virtual time `t_ns` act at once; the image is that of `t_ns` + one period."""
    advance(bundle, memory, t_ns, t_ns + bundle.period_ns)


@lean_kernel
def emulator_run(bundle: EmulatorBundle, memory: BoardMemory, t_ns: int, steps: int) -> int:
    """Run a number of steps from virtual time `t_ns`; returns the time reached."""
    for _ in range(steps):
        emulator_step(bundle, memory, t_ns)
        t_ns += bundle.period_ns
    return t_ns


class Emulator:
    """An emulated robot in this process: owns the state `bundle` refers to.

    Args:
        robot: the arm.
        mismatch: how the true plant differs from the robot file; default not at all.
        start: name of a pose of the robot file, or joint positions, shape (n,).
        calibrated: counters hold the true position and CALIB is set, as a host left them; otherwise the counters were
            zeroed where the arm stands.
        friction: friction preset of the plant; default the one the robot's controller uses.
        plant_hz: plant and board steps per second.
        options: the board's; default those of the robot file's revision.
        seed: of potentiometer waviness and noise.
        faults: what breaks, from the time a controller is connected on.
        scene: what stands around the arm, and the tool that touches it.
        force_sensor: at the flange, on channels of the converter; with one, the flange carries the scene's tool.
        physics: "mujoco", or "rigid": several times faster, without contact and so without a scene.
        payload_kg: point mass at the flange, of which the controller does not know.
        pots: the joints have potentiometers; without, their ADC channels are free inputs too.
        plant: the arm in a model with others, of the same time step; default one of its own, as the arguments say.

    Raises:
        ConfigError: the robot has more joints than the board has channels, or cannot be simulated, or lacks the pose;
            a scene or a force sensor was asked of a plant without contact; the sensor is on a potentiometer's channel.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        mismatch: PlantMismatch | None = None,
        start: str | Floats = "park",
        calibrated: bool = True,
        friction: str | None = None,
        plant_hz: int = PLANT_HZ,
        options: BoardOptions | None = None,
        seed: int = 0,
        scene: Scene = EMPTY,
        force_sensor: ForceSensor | None = None,
        physics: Physics = "mujoco",
        payload_kg: float = 0.0,
        pots: bool = True,
        faults: FaultPlan | None = None,
        plant: PlantOwner | None = None,
    ) -> None:
        check_encoders(robot.name, robot.n)
        self.robot = robot
        self.mismatch = mismatch or PlantMismatch.nominal(robot.n)
        self._plan = faults or FaultPlan()
        self._panel: FaultPanel | None = None
        period_ns = NS_PER_S // plant_hz
        dt = period_ns / NS_PER_S
        self.plant = plant or _make_plant(
            physics, robot, dt, self.mismatch.gravity, scene, payload_kg, force_sensor is not None
        )
        transmission, default = robot.transmission, BoardOptions(revision_f=robot.board.revision == "F")
        board = record_of(_make_board(robot, options or default, seed, pots, self._plan.seed))
        self.bundle = EmulatorBundle(
            board=board,
            drive=record_of(make_drive(robot, self.mismatch, friction or robot.control.friction_preset, dt)),
            plant=self.plant.plant,
            wrist=_make_wrist(force_sensor, self.plant, board.analog, dt, seed),
            counts_per_unit=1.0 / transmission.rad_per_count,
            q_offset=np.array(transmission.q_offset),
            shaft=np.zeros(N_ENCODERS),
            period_ns=period_ns,
        )
        self._power_up(_pose(robot, start), calibrated)

    def _power_up(self, q: Floats, calibrated: bool) -> None:
        self.plant.place(q)
        turn_shafts(self.bundle)
        board, n = self.bundle.board, self.robot.n
        edge = np.floor(self.bundle.shaft + 0.5).astype(np.int64)
        board.encoders.edge[:] = edge
        board.encoders.shaft[:] = edge
        board.upset.knob[ENC_TURNED, :N_ENCODERS] = self.bundle.shaft
        board.analog.wiper[:] = self.bundle.shaft / board.encoders.counts_per_rev
        if calibrated:
            board.encoders.counter[:n] = edge[:n] + self.robot.transmission.count_offset & COUNTER_MASK
            board.register[REG_DISCRETE] = DISCRETE_CALIBRATED

    def connect(self, memory: BoardMemory, t_ns: int = 0) -> None:
        """Meet controllers through `memory`: state the board's facts and publish the image of `t_ns`."""
        memory.facts.period_ns = self.bundle.period_ns
        memory.facts.joints = self.robot.n
        memory.facts.revision = ord("F" if self.bundle.board.options.revision_f else "E")
        self.bundle.board.register[REG_PRESSES] = memory.panel.presses  # presses of the past
        memory.facts.now_ns = t_ns
        self._panel = FaultPanel(memory)
        self._panel.extend(self._plan)
        publish_sample(self.bundle.board, memory, self.bundle.shaft, t_ns)

    @property
    def faults(self) -> FaultPanel:
        """Panel to inject faults through while it runs. Raises ConfigError before a controller is connected."""
        if self._panel is None:
            raise ConfigError("connect the emulator first: faults stand in the board memory")
        return self._panel

    @property
    def q(self) -> Floats:
        """True joint positions now. Shape (n,)."""
        return self.bundle.plant.q.copy()

    @property
    def v(self) -> Floats:
        """True joint velocities now. Shape (n,)."""
        return self.bundle.plant.v.copy()

    @property
    def torque(self) -> Floats:
        """Torques on the joints during the last step, friction and pushes included. Shape (n,)."""
        return self.bundle.plant.torque.copy()

    @property
    def powered(self) -> bool:
        """Arm power is on."""
        return bool(self.bundle.board.register[REG_POWER])

    @property
    def calibrated(self) -> bool:
        """The CALIB bit is set: a host has loaded the counters."""
        return bool(self.bundle.board.register[REG_DISCRETE] & DISCRETE_CALIBRATED)

    @property
    def counters(self) -> NDArray[np.int64]:
        """Encoder counters, 16 bits. Shape (n,)."""
        return self.bundle.board.encoders.counter[: self.robot.n].copy()

    @property
    def braked(self) -> bool:
        """The brakes are closed."""
        return bool(self.bundle.board.register[REG_BRAKED])


def _make_plant(
    physics: Physics, robot: Robot, dt: float, gravity_factor: float, scene: Scene, payload_kg: float, sensed: bool
) -> PlantOwner:
    if physics == "mujoco":
        return load_plant(robot, dt, gravity_factor, scene, payload_kg, sensed)
    if scene.kind != "empty" or sensed:
        wanted = f"scene {scene.kind!r}" if scene.kind != "empty" else "force sensor"
        raise ConfigError(f"rigid physics knows no contact, hence no {wanted}: use MuJoCo's")
    return RigidPlant(robot, dt, gravity_factor, payload_kg)


def _make_wrist(sensor: ForceSensor | None, plant: PlantOwner, analog: Analog, dt: float, seed: int) -> Wrist:
    if sensor is None or not isinstance(plant, PlantMemory):
        return no_wrist()
    return make_wrist(sensor, plant.wrist, analog, dt, seed)


def _make_board(robot: Robot, options: BoardOptions, seed: int, pots: bool, fault_seed: int) -> BoardState:
    transmission = robot.transmission
    encoders = make_encoders(transmission.counts_per_rev, transmission.index_phase)
    at_zero = transmission.pot_at_zero if pots else np.zeros(0)
    analog = make_analog(at_zero, transmission.pots_per_rev[: at_zero.size], seed, channels=transmission.pot_channels)
    return make_board(encoders, analog, options, fault_seed)


def _pose(robot: Robot, start: str | Floats) -> Floats:
    if not isinstance(start, str):
        return np.asarray(start, dtype=np.float64)
    if start not in robot.poses:
        raise ConfigError(f"{robot.name} has no pose {start!r}, only {', '.join(robot.poses)}")
    return robot.poses[start]
