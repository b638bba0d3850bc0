"""An arm drawn in three dimensions by Matplotlib: its cylinders with light on them, above a floor."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Final

import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.axes3d import Axes3D

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.model.arm_shape import ArmCylinder, arm_shape, link_frames, tip_frame

LINK_COLOUR: Final = (0.84, 0.83, 0.78)
JOINT_COLOUR: Final = (0.16, 0.38, 0.62)
SIDES: Final = 16  # of a cylinder
LIGHT: Final = np.array([0.35, -0.55, 0.75])


class SolidArm:
    """The faces of an arm's cylinders, wherever its joints are."""

    def __init__(self, robot: Robot) -> None:
        self.robot, self._tip = robot, tip_frame(robot)
        self._parts = [(part, *_cylinder_faces(part)) for part in arm_shape(robot)]

    @cached_property
    def floor_m(self) -> float:
        """Height of the floor in the base frame."""
        return -self.robot.geometry.base_height_m

    def frames(self, q: Sequence[float] | Floats) -> list[Floats]:
        """Base frame and each link's frame in it. Shapes (4, 4)."""
        frames = [np.eye(4)]
        for link in link_frames(self.robot, [float(x) for x in q]):
            frames.append(frames[-1] @ link)
        return frames

    def tip(self, q: Sequence[float] | Floats) -> Floats:
        """The tip of the tool in the base frame, m. Shape (3,)."""
        tip: Floats = (self.frames(q)[-1] @ self._tip)[:3, 3]
        return tip

    def faces(self, q: Sequence[float] | Floats, tint: Sequence[float] | None = None) -> tuple[Floats, Floats]:
        """Corners of all faces, shape (faces, 4, 3), and their colours in this light, shape (faces, 3)."""
        frames = self.frames(q)
        corners, colours = [], []
        for part, faces, normals in self._parts:
            R, p = frames[part.frame][:3, :3], frames[part.frame][:3, 3]
            bright = 0.62 + 0.38 * np.clip(normals @ R.T @ (LIGHT / np.linalg.norm(LIGHT)), -0.6, 1.0)
            corners.append(faces @ R.T + p)
            colours.append(np.outer(bright, tint or (JOINT_COLOUR if part.is_joint else LINK_COLOUR)))
        return np.concatenate(corners), np.clip(np.concatenate(colours), 0.0, 1.0)


def _cylinder_faces(part: ArmCylinder) -> tuple[Floats, Floats]:
    """Faces of a cylinder in its link's frame: corners (faces, 4, 3) and outward normals (faces, 3)."""
    angle = np.arange(SIDES + 1) * 2.0 * np.pi / SIDES
    rim = part.radius * np.column_stack([np.cos(angle), np.sin(angle)])
    half = 0.5 * part.length
    below, above = (np.column_stack([rim, np.full(SIDES + 1, z)]) for z in (-half, half))
    sides = np.stack([below[:-1], below[1:], above[1:], above[:-1]], axis=1)
    middle = 0.5 * (angle[:-1] + angle[1:])
    caps = [np.stack([end[:-1], end[1:], 0.0 * end[1:] + [0, 0, z], 0.0 * end[1:] + [0, 0, z]], axis=1)
            for end, z in ((below, -half), (above, half))]  # fmt: skip
    outward = np.column_stack([np.cos(middle), np.sin(middle), np.zeros(SIDES)])
    normals = np.concatenate([outward, np.tile([0.0, 0.0, -1.0], (SIDES, 1)), np.tile([0.0, 0.0, 1.0], (SIDES, 1))])
    R, p = part.T[:3, :3], part.T[:3, 3]
    return np.concatenate([sides, *caps]) @ R.T + p, normals @ R.T


def solid_faces(space: Axes3D, alpha: float) -> Poly3DCollection:
    """A body without faces yet."""
    faces = Poly3DCollection([np.zeros((4, 3))], alpha=alpha, linewidths=0.0)
    space.add_collection3d(faces)
    return faces


def put_faces(solid: Poly3DCollection, faces: Floats, colours: Floats) -> None:
    """Move faces, shape (faces, 4, 3), and colour them."""
    solid.set_visible(bool(len(faces)))
    if len(faces):
        solid.set_verts(list(faces))
        solid.set_facecolor(colours)
        solid.set_edgecolor(colours)


def set_up_space(space: Axes3D, arm: SolidArm, way: Floats) -> None:
    """Floor, view and limits that hold the arm and the way of its tool. Shape of `way` (k, 3)."""
    reach = np.vstack([way, *(frame[:3, 3] for frame in arm.frames(arm.robot.poses["ready"])), np.zeros(3)])
    low, high = reach.min(axis=0), reach.max(axis=0)
    low[2] = arm.floor_m
    half = 0.5 * float((high - low).max()) * 1.02
    middle = 0.5 * (low + high)
    space.set_xlim(middle[0] - half, middle[0] + half)
    space.set_ylim(middle[1] - half, middle[1] + half)
    space.set_zlim(low[2], low[2] + 2.0 * half)
    space.set_box_aspect((1.0, 1.0, 1.0), zoom=1.35)
    space.view_init(elev=18.0, azim=-52.0)
    space.set_axis_off()
    for line in np.linspace(-half, half, 9):
        x, y, z = middle[0], middle[1], low[2]
        space.plot([x - half, x + half], [y + line, y + line], [z, z], color="#cccccc", linewidth=0.6)
        space.plot([x + line, x + line], [y - half, y + half], [z, z], color="#cccccc", linewidth=0.6)
