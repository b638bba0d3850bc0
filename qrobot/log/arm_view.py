"""Views of the arm in a log: joint states, a tree of frames, the pose of the tool, and a simple arm to look at.

Messages are those of Foxglove's schemas, `RATE_HZ` of each a second, made by whoever writes the log: the servo knows
nothing of them. Frame `link_j` is frame j of the modified Denavit-Hartenberg rows, `base` their frame 0; `tool` is the
flange, or the tip of a tool beyond it. The arm is drawn from the same rows, a cylinder about each joint's axis and one
to the next frame: no meshes are needed.
"""

from __future__ import annotations

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
from qrobot.model.arm_shape import NO_TOOL, ArmCylinder, arm_shape, link_frames, tip_frame
from qrobot.servo.memory.telemetry import Rows
from qrobot.units import NS_PER_S

RATE_HZ: Final = 50
quaternion: Final = getattr(frames_of.quaternion, "py_func", frames_of.quaternion)  # to compile it takes longer
BASE: Final = "base"
TOOL: Final = "tool"
LINK_COLOUR: Final = (0.85, 0.85, 0.80)
JOINT_COLOUR: Final = (0.20, 0.35, 0.60)
Point = tuple[float, float, float]


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
        self._tool_m, self._tip = tool_m, tip_frame(robot, tool_m)
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
        shape = arm_shape(self._robot, self._tool_m)
        entities = []
        for number, frame in enumerate([BASE, *self._links]):
            cylinders = [_cylinder(part) for part in shape if part.frame == number]
            entities.append(
                SceneEntity(timestamp=stamp, frame_id=frame, id=frame, frame_locked=True, cylinders=cylinders)
            )
        return SceneUpdate(entities=entities)


def _cylinder(part: ArmCylinder) -> CylinderPrimitive:
    size = Vector3(x=2.0 * part.radius, y=2.0 * part.radius, z=part.length)
    r, g, b = JOINT_COLOUR if part.is_joint else LINK_COLOUR
    colour = Color(r=r, g=g, b=b, a=1.0)
    return CylinderPrimitive(pose=_pose(part.T), size=size, bottom_scale=1.0, top_scale=1.0, color=colour)


def _stamp(t_ns: int) -> Timestamp:
    return Timestamp(t_ns // NS_PER_S, t_ns % NS_PER_S)


def _vector(place: Floats) -> Vector3:
    return Vector3(x=float(place[0]), y=float(place[1]), z=float(place[2]))


def _quaternion(frame: Floats) -> Quaternion:
    w, x, y, z = quaternion(frame)
    return Quaternion(x=x, y=y, z=z, w=w)


def _pose(frame: Floats) -> Pose:
    return Pose(position=_vector(frame[:3, 3]), orientation=_quaternion(frame))
