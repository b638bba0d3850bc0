"""A simple arm to look at, made of the rows of its table: no meshes are needed.

A cylinder about each joint's axis and one from its frame to the next one; whoever draws it asks here, so that every
picture of an arm is the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.robot import Robot

JOINT_SHARE: Final = 0.13  # of the longest link: radius of a joint [A]
LINK_SHARE: Final = 0.08
NO_TOOL: Final = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ArmCylinder:
    """A cylinder that is fixed to a frame.

    Attributes:
        frame: number of the frame, 0 for the base.
        T: pose of its middle in that frame, its axis along z. Shape (4, 4).
        radius, length: m.
        is_joint: it stands about the axis of a joint, else it is a link.
    """

    frame: int
    T: Floats
    radius: float
    length: float
    is_joint: bool


def link_frames(robot: Robot, q: Sequence[float]) -> list[Floats]:
    """Frame j in frame j-1 for each joint, from n joint positions in rad or m. Shape (4, 4) each."""
    return [_link_frame(robot, j, float(value)) for j, value in enumerate(q)]


def _link_frame(robot: Robot, j: int, value: float) -> Floats:
    """Rx(alpha) Tx(a) Rz(theta) Tz(d); the joint adds to theta when it turns and to d when it slides."""
    geometry, slides = robot.geometry, bool(robot.prismatic[j])
    theta = geometry.theta_rad[j] + (0.0 if slides else value)
    d = geometry.d_m[j] + (value if slides else 0.0)
    ca, sa = np.cos(geometry.alpha_rad[j]), np.sin(geometry.alpha_rad[j])
    ct, st = np.cos(theta), np.sin(theta)
    return np.array([
        [ct, -st, 0.0, geometry.a_m[j]],
        [ca * st, ca * ct, -sa, -sa * d],
        [sa * st, sa * ct, ca, ca * d],
        [0.0, 0.0, 0.0, 1.0],
    ])  # fmt: skip


def tip_frame(robot: Robot, tool_m: Sequence[float] = NO_TOOL) -> Floats:
    """The tip of a tool, given from the flange, in the last frame. Shape (4, 4)."""
    return _placed(np.eye(3), np.array([tool_m[0], tool_m[1], tool_m[2] + robot.geometry.flange_m]))


def arm_shape(robot: Robot, tool_m: Sequence[float] = NO_TOOL) -> list[ArmCylinder]:
    """All cylinders of an arm, base to tool: in each frame the link to the next one, and its joint."""
    ends = [frame[:3, 3] for frame in (*link_frames(robot, [0.0] * robot.n), tip_frame(robot, tool_m))]
    longest = max(float(np.linalg.norm(end)) for end in ends)
    shape = []
    for frame, end in enumerate(ends):
        shape += _link(frame, end, LINK_SHARE * longest)
        if frame:
            shape.append(_joint(frame, JOINT_SHARE * longest * (1.0 - 0.5 * frame / robot.n)))
        elif robot.geometry.base_height_m > 0.0:
            floor = np.array([0.0, 0.0, -robot.geometry.base_height_m])
            shape += _link(frame, floor, 1.2 * JOINT_SHARE * longest)
    return shape


def _link(frame: int, end: Floats, radius: float) -> list[ArmCylinder]:
    """A cylinder from the origin to `end`; none when they are one."""
    length = float(np.linalg.norm(end))
    if length <= radius:
        return []
    return [ArmCylinder(frame, _placed(with_z_along(end / length), end / 2), radius, length, is_joint=False)]


def _joint(frame: int, radius: float) -> ArmCylinder:
    return ArmCylinder(frame, np.eye(4), radius, 2.4 * radius, is_joint=True)


def with_z_along(z: Floats) -> Floats:
    """A rotation whose third column is the unit vector `z`. Shapes (3,), (3, 3)."""
    aside = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _placed(R: Floats, p: Floats) -> Floats:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p
    return T
