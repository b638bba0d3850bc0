"""Bodies of a scene in Foxglove's schema beside the arm itself: fences, the tool, and what the hand carries.

A fence is a body in the frame of the base that one can look through; its name, and whether the arm keeps out of it or
stays in it, stand beside it, so that nobody has to know the colours. The tool is the capsule that keeps off the fences.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    Pose,
    Quaternion,
    SceneEntity,
    SpherePrimitive,
    TextPrimitive,
    Timestamp,
    Vector3,
)

from qrobot.arrays import Floats
from qrobot.config.fences import Fence
from qrobot.config.shape import Capsule
from qrobot.fences.told_fences import ToldFences
from qrobot.model import transform as frames_of
from qrobot.model.arm_shape import with_z_along
from qrobot.model.transform import rpy, transform
from qrobot.units import RAD_PER_DEG

quaternion: Final = getattr(frames_of.quaternion, "py_func", frames_of.quaternion)  # to compile it takes longer
BASE: Final = "base"
PAYLOAD: Final = "payload"
COLOURS: Final = {"out": (0.67, 0.20, 0.47, 0.30), "in": (0.13, 0.53, 0.20, 0.12)}
TOOL_COLOUR: Final = (0.80, 0.55, 0.20, 1.0)
PAYLOAD_COLOUR: Final = (0.20, 0.55, 0.60, 0.7)
TEXT_COLOUR: Final = (0.5, 0.5, 0.5, 1.0)
PLANE_M: Final = 4.0  # [A] edge of the plate that is drawn of a plane
PLATE_M: Final = 0.002  # [A] and its thickness
TEXT_M: Final = 0.04  # [A] height of a line
DENSITY: Final = 2700.0  # [A] kg/m3, aluminium: the size of a load whose shape nobody tells


def fence_entities(told: ToldFences, links: int, stamp: Timestamp) -> list[SceneEntity]:
    """The fences of an arm of so many links, and its tool where they know one."""
    tool = [] if told.tool is None else [_tool(told.tool, links, stamp)]
    return [*(_fence(fence, stamp) for fence in told.fences), *tool]


def payload_entity(payload: Floats, links: int, stamp: Timestamp) -> SceneEntity:
    """A ball of the load's weight about its centre of mass, by a row of telemetry: mass, first moments. kg, m."""
    mass, centre = float(payload[0]), payload[1:4] / payload[0]
    size = 2.0 * (3.0 * mass / (4.0 * np.pi * DENSITY)) ** (1.0 / 3.0)
    ball = SpherePrimitive(
        pose=pose_message(transform(None, centre)), size=Vector3(x=size, y=size, z=size), color=_colour(PAYLOAD_COLOUR)
    )
    return SceneEntity(
        timestamp=stamp, frame_id=f"link_{links}", id=PAYLOAD, frame_locked=True, spheres=[ball],
        texts=[_text(f"{mass:.3g} kg", centre)],
    )  # fmt: skip


def _fence(fence: Fence, stamp: Timestamp) -> SceneEntity:
    roll, pitch, yaw = (angle * RAD_PER_DEG for angle in fence.rpy_deg)
    pose = pose_message(transform(rpy(roll, pitch, yaw), np.array(fence.position_m)))
    colour = _colour(COLOURS[fence.keep])
    cubes: list[CubePrimitive] = []
    cylinders: list[CylinderPrimitive] = []
    if fence.shape == "cylinder":
        cylinders.append(cylinder_message(pose, fence.radius_m or 0.0, fence.length_m or 0.0, colour))
    else:
        x, y, z = fence.size_m or (PLANE_M, PLANE_M, PLATE_M)
        cubes.append(CubePrimitive(pose=pose, size=Vector3(x=x, y=y, z=z), color=colour))
    label = _text(f"{fence.name}: keep {fence.keep}", np.array(fence.position_m))
    return SceneEntity(
        timestamp=stamp, frame_id=BASE, id=f"fence {fence.name}", frame_locked=True, cubes=cubes, cylinders=cylinders,
        texts=[label],
    )  # fmt: skip


def _tool(tool: Capsule, links: int, stamp: Timestamp) -> SceneEntity:
    begin, end = np.array(tool.from_m), np.array(tool.to_m)
    length, colour = float(np.linalg.norm(end - begin)), _colour(TOOL_COLOUR)
    turn = np.eye(3) if length == 0.0 else with_z_along((end - begin) / length)
    rod = cylinder_message(pose_message(transform(turn, (begin + end) / 2.0)), tool.radius_m, length, colour)
    wide = 2.0 * tool.radius_m
    balls = [
        SpherePrimitive(pose=pose_message(transform(None, at)), size=Vector3(x=wide, y=wide, z=wide), color=colour)
        for at in (begin, end)
    ]
    return SceneEntity(
        timestamp=stamp, frame_id=f"link_{links}", id=tool.name, frame_locked=True, cylinders=[rod], spheres=balls
    )


def cylinder_message(pose: Pose, radius: float, length: float, colour: Color) -> CylinderPrimitive:
    """A cylinder along z of its pose. m."""
    size = Vector3(x=2.0 * radius, y=2.0 * radius, z=length)
    return CylinderPrimitive(pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=colour)


def vector_message(place: Floats) -> Vector3:
    """A place. Shape (3,)."""
    return Vector3(x=float(place[0]), y=float(place[1]), z=float(place[2]))


def quaternion_message(frame: Floats) -> Quaternion:
    """The rotation of a frame. Shape (4, 4)."""
    w, x, y, z = quaternion(frame)
    return Quaternion(x=x, y=y, z=z, w=w)


def pose_message(frame: Floats) -> Pose:
    """A frame. Shape (4, 4)."""
    return Pose(position=vector_message(frame[:3, 3]), orientation=quaternion_message(frame))


def _colour(rgba: tuple[float, float, float, float]) -> Color:
    r, g, b, a = rgba
    return Color(r=r, g=g, b=b, a=a)


def _text(text: str, place: Floats) -> TextPrimitive:
    return TextPrimitive(
        pose=pose_message(transform(None, place)), billboard=True, font_size=TEXT_M, scale_invariant=False,
        color=_colour(TEXT_COLOUR), text=text,
    )  # fmt: skip
