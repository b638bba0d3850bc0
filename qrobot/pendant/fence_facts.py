"""Fences of an arm as a page draws them: bodies with their poses, and the capsules that keep off them."""

from __future__ import annotations

from typing import Any

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.fences import Fence, Stand
from qrobot.errors import ConfigError
from qrobot.fences.told_fences import ToldFences
from qrobot.model.transform import rpy
from qrobot.units import RAD_PER_DEG


def fence_facts(told: ToldFences | None, robot: Robot) -> dict[str, Any]:
    """Fences of a deployment or of a log, none at all for an arm without; SI units, base frame.

    Raises:
        ConfigError: the robot file tells no body of the arm.
    """
    if told is None:
        return {"fences": [], "capsules": [], "pairs": [], "self_margin": 0.0}
    if robot.shape is None:
        raise ConfigError(f"fences need the body of the arm: {robot.name} has no [shape] in its robot file")
    capsules = (*robot.shape.capsules, *((told.tool,) if told.tool else ()))
    names = [capsule.name for capsule in capsules]
    return {
        "fences": [_fence(fence) for fence in told.fences],
        "capsules": [capsule.model_dump() for capsule in capsules],
        "pairs": [list(map(names.index, pair)) for pair in robot.shape.apart] if told.self_collision else [],
        "self_margin": told.self_margin_m,
    }


def stand_facts(stand: Stand | None) -> dict[str, Any]:
    """Base frame of an arm in the hall that the arms of a deployment share, None where that is not told."""
    return {"stand": None if stand is None else _pose(stand).ravel().tolist()}


def _pose(of: Fence | Stand) -> Floats:
    T = np.eye(4)
    roll, pitch, yaw = (angle * RAD_PER_DEG for angle in of.rpy_deg)
    T[:3, :3], T[:3, 3] = rpy(roll, pitch, yaw), of.position_m
    return T


def _fence(fence: Fence) -> dict[str, Any]:
    """Kind, sizes (edges of a box; radius, nothing and length of a cylinder) and pose of one fence."""
    size = fence.size_m or (fence.radius_m or 0.0, 0.0, fence.length_m or 0.0)
    return {
        "name": fence.name, "shape": fence.shape, "keep": fence.keep, "bodies": fence.bodies,
        "margin": fence.margin_m, "size": list(size), "T": _pose(fence).ravel().tolist(),
    }  # fmt: skip
