"""Fences as a deployment tells them, with those of the arm's scene, and the tool as a part of the arm's body."""

from __future__ import annotations

from typing import Final

from qrobot.config.deployment import DeployedArm
from qrobot.config.fences import Fence
from qrobot.config.robot import Robot
from qrobot.config.scene import Scene
from qrobot.config.shape import Capsule
from qrobot.units import MM_PER_M

_TABLE_M: Final = (0.6, 1.0, 0.04)  # of the emulated table top, see `sim_board.mujoco_scene`


def deployed_shapes(arm: DeployedArm, robot: Robot) -> tuple[Fence, ...]:
    """The fences that a deployment tells, and those of the arm's scene where it asks for them."""
    if arm.fences is None:
        return ()
    return (*arm.fences.shape, *(_scene_fences(arm.board.scene, robot) if arm.fences.scene else ()))


def tool_capsule(arm: DeployedArm, robot: Robot) -> Capsule | None:
    """The tool as a capsule of the last link, from the flange to the tip; None without one."""
    return None if arm.fences is None else tool_of(robot, arm.servo.tool_mm, arm.fences.tool_radius_m)


def tool_of(robot: Robot, tool_mm: tuple[float, float, float], radius_m: float) -> Capsule | None:
    """A tool whose tip is `tool_mm` from the flange; None without one, or for an arm that tells no body."""
    if robot.shape is None or not any(tool_mm):
        return None
    flange = robot.geometry.flange_m
    x, y, z = (value / MM_PER_M for value in tool_mm)
    ends = {"from_m": (0.0, 0.0, flange), "to_m": (x, y, z + flange)}
    return Capsule(name="tool", link=robot.n, radius_m=radius_m, **ends)


def _scene_fences(scene: Scene, robot: Robot) -> list[Fence]:
    """Floor and furniture of the emulated arm's surroundings, as shapes to keep out of."""
    if scene.kind == "empty":
        return []
    fences = [Fence(name="floor", shape="plane", position_m=(0.0, 0.0, -robot.geometry.base_height_m), bodies="all")]
    size = _furniture_size(scene)
    if size is not None:
        x, y, z = scene.position_m
        fences.append(Fence(name="furniture", shape="box", size_m=size, position_m=(x, y, z - size[2] / 2)))
    return fences


def _furniture_size(scene: Scene) -> tuple[float, float, float] | None:
    """Edges of a box around what stands there, its top at the scene's position; None for a bare floor."""
    if scene.kind == "table":
        return _TABLE_M
    if scene.kind == "floor":
        return None
    reach = scene.tool.radius_m + scene.clearance_m + 0.06 + (scene.crank_radius_m if scene.kind == "crank" else 0.0)
    return 2 * reach, 2 * reach, scene.depth_m + 0.02
