"""Views of the arm in a log: joint states, a tree of frames, the pose of the tool, and a simple arm to look at.

Messages are those of Foxglove's schemas, `RATE_HZ` of each a second, made by whoever writes the log: the servo knows
nothing of them. Frame `link_j` is frame j of the modified Denavit-Hartenberg rows, `base` their frame 0; `tool` is the
flange, or the tip of a tool beyond it. The arm is drawn from the same rows, a cylinder about each joint's axis and one
to the next frame: no meshes are needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from foxglove import Context
from foxglove.channels import FrameTransformsChannel, JointStatesChannel, PoseInFrameChannel, SceneUpdateChannel
from foxglove.messages import (
    Color,
    CylinderPrimitive,
    FrameTransform,
    FrameTransforms,
    JointState,
    JointStates,
    Pose,
    PoseInFrame,
    Quaternion,
    SceneEntity,
    SceneUpdate,
    Timestamp,
    Vector3,
)

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.log.pace import Pace
from qrobot.log.topics import FRAMES_TOPIC, JOINTS_TOPIC, SCENE_TOPIC, TOOL_TOPIC
from qrobot.model import transform as frames_of
from qrobot.model.transform import transform
from qrobot.servo.memory.telemetry import Rows
from qrobot.units import NS_PER_S

RATE_HZ: Final = 50
quaternion: Final = getattr(frames_of.quaternion, "py_func", frames_of.quaternion)  # to compile it takes longer
BASE: Final = "base"
TOOL: Final = "tool"
JOINT_SHARE: Final = 0.13  # of the longest link: radius of a joint [A]
LINK_SHARE: Final = 0.08
LINK_COLOUR: Final = (0.85, 0.85, 0.80)
JOINT_COLOUR: Final = (0.20, 0.35, 0.60)
Point = tuple[float, float, float]
NO_TOOL: Final[Point] = (0.0, 0.0, 0.0)


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


class ArmView:
    """Says how an arm stands, beside the rows of a log.

    Args:
        context: of the log.
        robot: the arm.
        wall_offset_ns: from the time of a row to the time of the log.
        tool_m: the tip of the tool from the flange, in its frame.
    """

    def __init__(self, context: Context, robot: Robot, wall_offset_ns: int, tool_m: Point = NO_TOOL) -> None:
        self._robot, self._offset_ns = robot, wall_offset_ns
        self._tip = transform(np.eye(3), [tool_m[0], tool_m[1], tool_m[2] + robot.geometry.flange_m])
        self._links = [f"link_{j + 1}" for j in range(robot.n)]
        self._joints = JointStatesChannel(JOINTS_TOPIC, context=context)
        self._frames = FrameTransformsChannel(FRAMES_TOPIC, context=context)
        self._tool = PoseInFrameChannel(TOOL_TOPIC, context=context)
        self._scene = SceneUpdateChannel(SCENE_TOPIC, context=context)
        self._pace = Pace(RATE_HZ)
        self._drawn = False

    def begin_part(self) -> None:
        """A new file begins: its first row is shown, and the picture of the arm is in it."""
        self._drawn, self._pace = False, Pace(RATE_HZ)

    def log_rows(self, rows: Rows) -> None:
        """Messages of those of `rows`, shape (m,), whose turn it is."""
        for k in self._pace.due(rows["t_ns"]):
            row = rows[k]
            log_time = int(row["t_ns"]) + self._offset_ns
            if not self._drawn:
                self._drawn = True
                self._scene.log(self._picture(_stamp(log_time)), log_time=log_time)
            self._log_row(row["q"].tolist(), row["v"].tolist(), row["tau"].tolist(), log_time)

    def _log_row(self, q: list[float], v: list[float], tau: list[float], log_time: int) -> None:
        stamp, frames = _stamp(log_time), [*link_frames(self._robot, q), self._tip]
        joints = [
            JointState(name=name, position=q[j], velocity=v[j], effort=tau[j])
            for j, name in enumerate(self._robot.joint_names)
        ]
        self._joints.log(JointStates(timestamp=stamp, joints=joints), log_time=log_time)
        names = [BASE, *self._links, TOOL]
        transforms = [
            FrameTransform(
                timestamp=stamp, parent_frame_id=parent, child_frame_id=child,
                translation=_vector(frame[:3, 3]), rotation=_quaternion(frame),
            )
            for parent, child, frame in zip(names[:-1], names[1:], frames, strict=True)
        ]  # fmt: skip
        self._frames.log(FrameTransforms(transforms=transforms), log_time=log_time)
        pose = _pose(np.linalg.multi_dot(frames))
        self._tool.log(PoseInFrame(timestamp=stamp, frame_id=BASE, pose=pose), log_time=log_time)

    def _picture(self, stamp: Timestamp) -> SceneUpdate:
        """The arm: in each frame the link to the next one, and the joint about whose axis z it turns."""
        ends = [frame[:3, 3] for frame in (*link_frames(self._robot, [0.0] * self._robot.n), self._tip)]
        longest = max(float(np.linalg.norm(end)) for end in ends)
        entities = []
        for j, (frame, end) in enumerate(zip([BASE, *self._links], ends, strict=True)):
            cylinders = _link(end, LINK_SHARE * longest)
            if j:
                cylinders.append(_joint(JOINT_SHARE * longest * (1.0 - 0.5 * j / self._robot.n)))
            elif self._robot.geometry.base_height_m > 0.0:
                floor = np.array([0.0, 0.0, -self._robot.geometry.base_height_m])
                cylinders += _link(floor, 1.2 * JOINT_SHARE * longest)
            entities.append(
                SceneEntity(timestamp=stamp, frame_id=frame, id=frame, frame_locked=True, cylinders=cylinders)
            )
        return SceneUpdate(entities=entities)


def _link(end: Floats, radius: float) -> list[CylinderPrimitive]:
    """A cylinder from the origin to `end`; none when they are one."""
    length = float(np.linalg.norm(end))
    if length <= radius:
        return []
    return [_cylinder(transform(_with_z_along(end / length), end / 2), radius, length, LINK_COLOUR)]


def _with_z_along(z: Floats) -> Floats:
    """A rotation whose third column is the unit vector `z`."""
    aside = np.eye(3)[int(np.argmin(np.abs(z)))]
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _joint(radius: float) -> CylinderPrimitive:
    return _cylinder(np.eye(4), radius, 2.4 * radius, JOINT_COLOUR)


def _cylinder(place: Floats, radius: float, length: float, colour: Point) -> CylinderPrimitive:
    size = Vector3(x=2.0 * radius, y=2.0 * radius, z=length)
    r, g, b = colour
    colour_of = Color(r=r, g=g, b=b, a=1.0)
    return CylinderPrimitive(pose=_pose(place), size=size, bottom_scale=1.0, top_scale=1.0, color=colour_of)


def _stamp(t_ns: int) -> Timestamp:
    return Timestamp(t_ns // NS_PER_S, t_ns % NS_PER_S)


def _vector(place: Floats) -> Vector3:
    return Vector3(x=float(place[0]), y=float(place[1]), z=float(place[2]))


def _quaternion(frame: Floats) -> Quaternion:
    w, x, y, z = quaternion(frame)
    return Quaternion(x=x, y=y, z=z, w=w)


def _pose(frame: Floats) -> Pose:
    return Pose(position=_vector(frame[:3, 3]), orientation=_quaternion(frame))
