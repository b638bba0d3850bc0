"""Views of the arm in a log: joint states, a tree of frames, the pose of the tool, and a simple arm to look at.

Messages are those of Foxglove's schemas, `RATE_HZ` of each a second, made by whoever writes the log: the servo knows
nothing of them. Frame `link_j` is frame j of the modified Denavit-Hartenberg rows, `base` their frame 0; `tool` is the
flange, or the tip of a tool beyond it. The arm is drawn from the same rows, a cylinder about each joint's axis and one
to the next frame: no meshes are needed. Fences, tool and payload stand beside it (scene_bodies.py).
"""

from __future__ import annotations

from functools import reduce
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
    PoseInFrame,
    SceneEntity,
    SceneEntityDeletion,
    SceneEntityDeletionType,
    SceneUpdate,
    Timestamp,
)

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.fences.told_fences import ToldFences
from qrobot.log.pace import Pace
from qrobot.log.scene_bodies import (
    BASE,
    PAYLOAD,
    cylinder_message,
    fence_entities,
    payload_entity,
    pose_message,
    quaternion_message,
    vector_message,
)
from qrobot.log.topics import FRAMES_TOPIC, JOINTS_TOPIC, SCENE_TOPIC, TOOL_TOPIC
from qrobot.model.arm_shape import NO_TOOL, ArmCylinder, arm_shape, link_frames, tip_frame
from qrobot.servo.memory.telemetry import Rows
from qrobot.units import NS_PER_S

RATE_HZ: Final = 50
TOOL: Final = "tool"
LINK_COLOUR: Final = (0.85, 0.85, 0.80)
JOINT_COLOUR: Final = (0.20, 0.35, 0.60)
NO_LOAD: Final = [0.0] * 4
Point = tuple[float, float, float]


class ArmView:
    """Says how an arm stands, beside the rows of a log.

    Args:
        context: of the log.
        robot: the arm.
        wall_offset_ns: from the time of a row to the time of the log.
        tool_m: the tip of the tool from the flange, in its frame.
        fences: of the deployment; None for none.
    """

    def __init__(
        self,
        context: Context,
        robot: Robot,
        wall_offset_ns: int,
        tool_m: Point = NO_TOOL,
        fences: ToldFences | None = None,
    ) -> None:
        self._robot, self._offset_ns = robot, wall_offset_ns
        self._tool_m, self._tip = tool_m, tip_frame(robot, tool_m)
        self._links = [f"link_{j + 1}" for j in range(robot.n)]
        self._joints = JointStatesChannel(JOINTS_TOPIC, context=context)
        self._frames = FrameTransformsChannel(FRAMES_TOPIC, context=context)
        self._tool = PoseInFrameChannel(TOOL_TOPIC, context=context)
        self._scene = SceneUpdateChannel(SCENE_TOPIC, context=context)
        self._pace = Pace(RATE_HZ)
        self._fences = fences or ToldFences()
        self._drawn = False
        self._load, self._load_told = NO_LOAD, False  # that was drawn last, and whether in this part

    def begin_part(self) -> None:
        """A new file begins: its first row is shown, and the picture of the arm is in it."""
        self._drawn, self._pace = False, Pace(RATE_HZ)
        self._load_told = False

    def log_rows(self, rows: Rows) -> None:
        """Messages of those of `rows`, shape (m,), whose turn it is."""
        for k in self._pace.due(rows["t_ns"]):
            row = rows[k]
            log_time = int(row["t_ns"]) + self._offset_ns
            if not self._drawn:
                self._drawn = True
                self._scene.log(self._picture(_stamp(log_time)), log_time=log_time)
            self._log_load(row["payload"], log_time)
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
                translation=vector_message(frame[:3, 3]), rotation=quaternion_message(frame),
            )
            for parent, child, frame in zip(names[:-1], names[1:], frames, strict=True)
        ]  # fmt: skip
        self._frames.log(FrameTransforms(transforms=transforms), log_time=log_time)
        pose = pose_message(reduce(np.matmul, frames))
        self._tool.log(PoseInFrame(timestamp=stamp, frame_id=BASE, pose=pose), log_time=log_time)

    def _log_load(self, payload: Floats, log_time: int) -> None:
        """Draw the load that the servo reckons with, when it is another one or in a new part; or take it away."""
        load, stamp = payload[:4].tolist(), _stamp(log_time)
        if load == self._load and (self._load_told or load == NO_LOAD):
            return
        self._load, self._load_told = load, True
        if payload[0] > 0.0:
            update = SceneUpdate(entities=[payload_entity(payload, self._robot.n, stamp)])
        else:
            gone = SceneEntityDeletion(timestamp=stamp, type=SceneEntityDeletionType.MatchingId, id=PAYLOAD)
            update = SceneUpdate(deletions=[gone])
        self._scene.log(update, log_time=log_time)

    def _picture(self, stamp: Timestamp) -> SceneUpdate:
        """The arm: in each frame the link to the next one, and the joint that turns about its z; and the fences."""
        shape = arm_shape(self._robot, self._tool_m)
        entities = []
        for number, frame in enumerate([BASE, *self._links]):
            cylinders = [_cylinder(part) for part in shape if part.frame == number]
            entities.append(
                SceneEntity(timestamp=stamp, frame_id=frame, id=frame, frame_locked=True, cylinders=cylinders)
            )
        return SceneUpdate(entities=[*entities, *fence_entities(self._fences, self._robot.n, stamp)])


def _cylinder(part: ArmCylinder) -> CylinderPrimitive:
    r, g, b = JOINT_COLOUR if part.is_joint else LINK_COLOUR
    return cylinder_message(pose_message(part.T), part.radius, part.length, Color(r=r, g=g, b=b, a=1.0))


def _stamp(t_ns: int) -> Timestamp:
    return Timestamp(t_ns // NS_PER_S, t_ns % NS_PER_S)
