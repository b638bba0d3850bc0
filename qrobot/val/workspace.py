"""Frames of an arm in VAL: BASE, the last link, the flange, TOOL. BASE is where the robot stands in the world."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import MotionError
from qrobot.model.arm import Arm
from qrobot.model.branch import Branch
from qrobot.model.transform import inverse, rot_z, transform
from qrobot.motion import NumericalKinematics, kinematics_of
from qrobot.val.values import JointLocation, Transformation

_WORDS: Final = {"r": "RIGHTY", "l": "LEFTY", "u": "ABOVE", "d": "BELOW", "n": "NOFLIP", "f": "FLIP"}
_AXES: Final = [sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)]


class Workspace:
    """Poses of the tool, and what the arm reaches.

    Args:
        robot: the arm.

    Attributes:
        base: pose of the robot in the world, shape (4, 4).
        tool: pose of the tool on the flange, shape (4, 4).
    """

    def __init__(self, robot: Robot) -> None:
        self.arm = Arm(robot)
        self.base: Floats = np.eye(4)
        self.tool: Floats = np.eye(4)
        kinematics = kinematics_of(self.arm)
        self._searched = kinematics if isinstance(kinematics, NumericalKinematics) else None

    @property
    def T_last_tool(self) -> Floats:  # noqa: N802 (name of the field)
        """Pose of the tool in the last link's frame."""
        return self.arm.T_last_flange @ self.tool

    def tool_at(self, q: Floats) -> Floats:
        """Pose of the tool in the world at joint positions `q` (n,). Shape (4, 4)."""
        return self.base @ self.arm.forward(q) @ self.T_last_tool

    def pose_of(self, location: Transformation | JointLocation) -> Floats:
        """Pose of the tool in the world. Shape (4, 4)."""
        return location.T if isinstance(location, Transformation) else self.tool_at(location.q)

    def robot_pose(self, T: Floats) -> Floats:
        """A pose in the world as one in the robot's base frame. Shape (4, 4)."""
        return inverse(self.base) @ T

    def ways_to(self, location: Transformation | JointLocation) -> list[Floats]:
        """Joint positions (n,) within their range at which the arm is there, one for each configuration.

        Empty for a pose of an arm without a closed form, of which nobody can list the configurations.
        """
        if isinstance(location, JointLocation):
            return [] if self.arm.limits_passed(location.q) else [location.q]
        try:
            return list(self.arm.inverses(self._last_link(location.T), self.arm.robot.poses["park"]).values())
        except MotionError:
            return []

    def reaches(self, location: Transformation | JointLocation) -> bool:
        """Whether the arm gets there, in any configuration."""
        if self._searched is None or isinstance(location, JointLocation):
            return bool(self.ways_to(location))
        return self._searched.reaches(self._last_link(location.T))

    def _last_link(self, T: Floats) -> Floats:
        """Pose of the last link in the robot's base frame with the tool at `T` in the world. Shape (4, 4)."""
        return self.robot_pose(T) @ inverse(self.T_last_tool)

    def other_words(self, T: Floats, q: Floats, branch: Branch) -> str:
        """The fewest words of a configuration in which the arm reaches a pose, as "LEFTY FLIP".

        Args:
            T: pose of the tool in the robot's base frame, shape (4, 4).
            q: joint positions now, shape (n,).
            branch: the configuration that does not get there.

        Returns:
            empty when no other one does, or when the arm has none.
        """
        try:
            ways = self.arm.inverses(T @ inverse(self.T_last_tool), q)
        except MotionError:
            return ""
        words = [_words_between(branch, way) for way in ways if way != branch]
        return " ".join(sorted(words, key=len)[0]) if words else ""

    def branch(self, q: Floats) -> Branch:
        """The configuration at joint positions `q` (n,); RUN for an arm that has none."""
        try:
            return self.arm.branch(q)
        except MotionError:
            return Branch.RUN

    def move_base(self, dx: float, dy: float, dz: float, rotation: float) -> None:
        """The robot stands `dx`, `dy`, `dz` (m) away, turned by `rotation` (rad) about z."""
        self.base = transform(rot_z(rotation), np.array([dx, dy, dz]))


def _words_between(old: Branch, new: Branch) -> list[str]:
    """VAL's words for what differs."""
    return [_WORDS[letter] for before, letter in zip(old.letters, new.letters, strict=True) if letter != before]


def aligned(T: Floats) -> Floats:
    """A pose (4, 4) turned so that its z axis is parallel to the nearest axis of the world, by the shortest turn."""
    z = max(_AXES, key=lambda axis: float(axis @ T[:3, 2]))
    y = T[:3, 1] - (T[:3, 1] @ z) * z
    y /= np.linalg.norm(y)
    return transform(np.column_stack((np.cross(y, z), y, z)), T[:3, 3])
