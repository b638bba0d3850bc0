"""Fences of an arm as a page draws them: bodies with their poses, and the capsules that keep off them."""

from __future__ import annotations

from typing import Any

import numpy as np

from qrobot.config import Robot
from qrobot.config.deployment import DeployedArm
from qrobot.config.fences import Fence
from qrobot.errors import ConfigError
from qrobot.fences.deployed import deployed_shapes, tool_capsule
from qrobot.model.transform import rpy
from qrobot.units import RAD_PER_DEG


def fence_facts(arm: DeployedArm, robot: Robot) -> dict[str, Any]:
    """Fences of the deployment, none at all for an arm without; SI units, base frame.

    Raises:
        ConfigError: the robot file tells no body of the arm.
    """
    chosen = arm.fences
    if chosen is None:
        return {"fences": [], "capsules": [], "pairs": [], "self_margin": 0.0}
    if robot.shape is None:
        raise ConfigError(f"fences need the body of the arm: {robot.name} has no [shape] in its robot file")
    tool = tool_capsule(arm, robot)
    capsules = (*robot.shape.capsules, *((tool,) if tool else ()))
    names = [capsule.name for capsule in capsules]
    return {
        "fences": [_fence(fence) for fence in deployed_shapes(arm, robot)],
        "capsules": [capsule.model_dump() for capsule in capsules],
        "pairs": [list(map(names.index, pair)) for pair in robot.shape.apart] if chosen.self_collision else [],
        "self_margin": chosen.self_margin_m,
    }


def _fence(fence: Fence) -> dict[str, Any]:
    """Kind, sizes (edges of a box; radius, nothing and length of a cylinder) and pose of one fence."""
    T = np.eye(4)
    roll, pitch, yaw = (angle * RAD_PER_DEG for angle in fence.rpy_deg)
    T[:3, :3], T[:3, 3] = rpy(roll, pitch, yaw), fence.position_m
    size = fence.size_m or (fence.radius_m or 0.0, 0.0, fence.length_m or 0.0)
    return {
        "name": fence.name, "shape": fence.shape, "keep": fence.keep, "bodies": fence.bodies,
        "margin": fence.margin_m, "size": list(size), "T": T.ravel().tolist(),
    }  # fmt: skip
