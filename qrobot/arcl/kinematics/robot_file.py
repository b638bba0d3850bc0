"""Kinematics of a robot file: the PUMA family and the Stanford arm in closed form, any other arm by steps.

The PUMA stands in Paul's convention, as ARCL's programs see it: READY is (0, 90, -90, 0, 0, 0) degrees with T6 upright
at x 20.3 mm, and its "zero angle position is a righty" (the comment of Corke's Puma560 model: "Paul's value of link
twist ... to be consistent with ARCL"). The Stanford arm's robot file is in Paul's convention already.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from qrobot.arcl.kinematics.jacobian import inverse_jacobian
from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import ConfigError, JointLimit, MotionError, Singular, Unreachable
from qrobot.model.arm import Arm
from qrobot.model.branch import Branch
from qrobot.model.paul import PAUL_OFFSET, T_PAUL_VAL
from qrobot.model.transform import inverse
from qrobot.motion import ArmKinematics, kinematics_of, motion_limits
from qrobot.units import MM_PER_M

_TURNED: Final = np.array([1.0, 1.0, -1.0, 1.0, 1.0, -1.0])  # which half turn: ranges as published for Paul's angles


class RobotFileKinematics:
    """See `ManipulatorKinematics`.

    Args:
        robot: the arm.
        zero: joint positions of the robot file at this layer's zero. Shape (n,).
        T_base_file: pose of the robot file's base frame in this layer's. Shape (4, 4).

    Raises:
        ConfigError: the arm has fewer joints than a pose needs.
    """

    def __init__(self, robot: Robot, zero: Floats, T_base_file: Floats) -> None:
        self._arm = Arm(robot)
        self._engine = _engine_kinematics(self._arm)
        self._free = _engine_kinematics(Arm(without_ranges(robot)))  # tells which joint a limit is about
        self._T_base_file, self._T_file_base = T_base_file, inverse(T_base_file)
        self.name = robot.name
        self.structure = "".join("P" if slides else "R" for slides in robot.prismatic)
        self.zero = zero
        limits = motion_limits(robot)
        self.limits = replace(limits, q_min=limits.q_min - zero, q_max=limits.q_max - zero)

    def forward(self, q: Floats) -> Floats:
        """See `ManipulatorKinematics.forward`."""
        T: Floats = self._T_base_file @ self._engine.forward(q + self.zero)
        return T

    def branch(self, q: Floats) -> Branch:
        """See `ManipulatorKinematics.branch`."""
        return self._engine.branch(q + self.zero)

    def inverse(self, T: Floats, branch: Branch, near: Floats, singular: bool = False) -> Floats:
        """See `ManipulatorKinematics.inverse`."""
        try:
            return self._engine.inverse(self._T_file_base @ T, Branch(branch), near + self.zero, singular) - self.zero
        except JointLimit:
            passed, other = self._limits_passed(T, branch, near), self._way_out(T, branch, near)
            raise JointLimit(f"{_told(T, branch)}: {passed}{other}") from None
        except (Unreachable, Singular) as error:
            raise type(error)(f"{_told(T, branch)}: {str(error).partition(' mm: ')[2]}") from None

    def near_singular(self, q: Floats) -> bool:
        """See `ManipulatorKinematics.near_singular`."""
        return self._engine.near_singular(q + self.zero)

    def jacobian(self, q: Floats) -> Floats:
        """See `ManipulatorKinematics.jacobian`."""
        R, J = self._T_base_file[:3, :3], self._arm.jacobian(q + self.zero)
        return np.vstack((R @ J[:3], R @ J[3:]))

    def jacobian_inverse(self, q: Floats) -> Floats:
        """See `ManipulatorKinematics.jacobian_inverse`."""
        return inverse_jacobian(self.jacobian(q))

    def _limits_passed(self, T: Floats, branch: Branch, near: Floats) -> str:
        """Name the joint that leaves its range, in this layer's angles."""
        free = self._free.inverse(self._T_file_base @ T, Branch(branch), near + self.zero, True) - self.zero
        middle = 0.5 * (self.limits.q_min + self.limits.q_max)
        turns = np.where(self.limits.prismatic, 0.0, np.round((free - middle) / (2.0 * np.pi)))
        try:
            self.limits.check_position(free - turns * 2.0 * np.pi, "solution")
        except JointLimit as error:
            return str(error).partition(": ")[2]
        return "a joint would leave its range"

    def _way_out(self, T: Floats, branch: Branch, near: Floats) -> str:
        """A configuration in which the arm gets there, with the fewest letters changed, in words; "" for none."""
        try:
            there = self._arm.inverses(self._T_file_base @ T, near + self.zero)
        except MotionError:
            return ""
        nearest = min(there, key=lambda each: (int(each) ^ int(branch)).bit_count(), default=None)
        return "" if nearest is None else f"; configuration {nearest.letters!r} gets there"


def _told(T: Floats, branch: Branch) -> str:
    return f"configuration {Branch(branch).letters!r}, T6 at {np.round(T[:3, 3] * MM_PER_M, 1).tolist()} mm"


def without_ranges(robot: Robot) -> Robot:
    """The same robot with two turns more at either end of the range of each revolute joint."""
    room = np.where(robot.prismatic, 0.0, 4.0 * np.pi)
    limits = robot.limits.model_copy(update={"q_min": robot.limits.q_min - room, "q_max": robot.limits.q_max + room})
    return robot.model_copy(update={"limits": limits})


def _engine_kinematics(arm: Arm) -> ArmKinematics:
    if (found := kinematics_of(arm)) is None:
        raise ConfigError(f"{arm.robot.name}: ARCL moves arms that can take any pose, with six joints or more")
    return found


def puma_kinematics(robot: Robot) -> RobotFileKinematics:
    """An arm of the PUMA family in Paul's convention."""
    return RobotFileKinematics(robot, -PAUL_OFFSET * _TURNED, T_PAUL_VAL)


def file_kinematics(robot: Robot) -> RobotFileKinematics:
    """An arm in the convention of its robot file."""
    return RobotFileKinematics(robot, np.zeros(robot.n), np.eye(4))
