"""The robots that a task can be connected to, and what a task knows of its own at joint level (section 4.3.7).

A STATE carries positions, velocities and torques in joint units, as doubles. Encoder counts and DAC words are not on
the wire: they follow from those by the gears, couplings and offsets of the robot file, to the last count, because the
servo came to its positions from counts by the same numbers. Kinematics and dynamics are no part of RCI.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from qrobot.arrays import Floats, Ints
from qrobot.config import Robot, load_robot, robot_path
from qrobot.config.robot import Transmission
from qrobot.errors import ConfigError
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.in_force import fences_for
from qrobot.model.transmission import (
    counts_to_joint,
    dac_to_motor_torque,
    joint_to_counts,
    motor_to_torque,
    torque_to_dac,
    transmission_params,
)
from qrobot.motion import MotionLimits, motion_limits
from qrobot.rci.tcp import address_text
from qrobot.wire import RobotState


@dataclass(frozen=True)
class RawWords:
    """One sample as the board has it: counters, offset included, and DAC words. Shapes (n,)."""

    encoder_counts: Ints
    dac: Ints


class RobotData:
    """Parameters of one robot at joint level.

    Args:
        robot: its file.
        fences: that tasks of this program keep off, None for none.

    Attributes:
        limits: range, speed and acceleration of the joints, joint units.
        tau_max: largest joint torques, N m or N. Shape (n,).
        calibration: what the robot file knows of encoders, index pulses and potentiometers.
    """

    def __init__(self, robot: Robot, fences: FenceSet | None = None) -> None:
        self.robot, self.fences = robot, fences
        self.limits: MotionLimits = motion_limits(robot)
        self.tau_max: Floats = robot.guard.tau_max
        self.calibration: Transmission = robot.transmission
        self._transmission = transmission_params(robot)

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.robot.n

    def raw(self, how: RobotState) -> RawWords:
        """Encoder counts of a sample, and the DAC words of its torques."""
        return RawWords(self.counts(how.q), self.dac(how.tau))

    def counts(self, q: Sequence[float]) -> Ints:
        """Encoder counts at joint positions. Shape (n,)."""
        counts = np.empty(self.n, np.int64)
        joint_to_counts(self._joints(q), self._transmission, counts)
        return counts

    def joints(self, counts: Sequence[int]) -> Floats:
        """Joint positions at encoder counts, rad or m. Shape (n,)."""
        q = np.empty(self.n)
        counts_to_joint(self._whole(counts), self._transmission, q)
        return q

    def dac(self, tau: Sequence[float]) -> Ints:
        """DAC words that exert joint torques: 12-bit offset binary, 0x800 for none. Shape (n,)."""
        motor, words = np.empty(self.n), np.empty(self.n, np.int64)
        torque_to_dac(self._joints(tau), self._transmission, motor, words)
        return words

    def torques(self, dac: Sequence[int]) -> Floats:
        """Joint torques that DAC words exert, N m or N. Shape (n,)."""
        motor, tau = np.empty(self.n), np.empty(self.n)
        dac_to_motor_torque(self._whole(dac), self._transmission, motor)
        motor_to_torque(motor, self._transmission, tau)
        return tau

    def _joints(self, values: Sequence[float]) -> Floats:
        return self._checked(np.array(values, dtype=np.float64))

    def _whole(self, values: Sequence[int]) -> Ints:
        given = np.asarray(values)
        if given.dtype.kind not in "iu":
            raise ConfigError(f"{self.robot.name}: whole numbers needed, not {values}")
        return self._checked(given.astype(np.int64))

    def _checked(self, values: np.ndarray) -> np.ndarray:
        if values.shape != (self.n,):
            raise ConfigError(f"{self.robot.name} has {self.n} joints; {values.size} numbers were given")
        return values


@dataclass(frozen=True)
class KnownRobot:
    """An entry of the data base.

    Attributes:
        name: by which tasks ask for it; "" for one that is known by its bridge alone.
        file: robot file, or name of a packaged one.
        bridge: where its bridge is, "" for where the program's is.
    """

    name: str
    file: str
    bridge: str = ""

    @property
    def place(self) -> str:
        """Address of its bridge in full, "" for that of the program's. Raises ConfigError: that is no address."""
        return address_text(self.bridge) if self.bridge else ""

    def data(self) -> RobotData:
        """Its parameters; fences are those of the arm for which the program was started. Raises ConfigError."""
        robot = load_robot(self.file)
        return RobotData(robot, fences_for(robot.name, self.place))


class RobotTable:
    """The robots that tasks can be connected to by name: the packaged ones, and those that a program adds."""

    def __init__(self) -> None:
        self._added: dict[str, KnownRobot] = {}

    def add(self, robot: KnownRobot) -> None:
        """Know a robot by another name, or at another bridge. Raises ConfigError: there is no such robot file."""
        robot_path(robot.file)
        self._added[robot.name] = robot

    def find(self, name: str) -> KnownRobot | None:
        """The robot of that name, None when there is none."""
        if name in self._added:
            return self._added[name]
        try:
            robot_path(name)
        except ConfigError:
            return None
        return KnownRobot(name, name)
