"""Distances of an arm from its fences the slow way: many points of each capsule, and poses of the plain kinematics."""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.fences import Fence
from qrobot.config.robot import Robot
from qrobot.config.shape import Capsule
from qrobot.model.arm_shape import link_frames
from qrobot.model.transform import rpy

POINTS = 4001  # of an axis


def axis_points(robot: Robot, capsule: Capsule, q: Floats, points: int = POINTS) -> Floats:
    """Points of the axis of a capsule in the base frame. Shape (points, 3)."""
    T = np.eye(4)
    for step in link_frames(robot, q.tolist())[: capsule.link]:
        T = T @ step
    share = np.linspace(0.0, 1.0, points)[:, None]
    local = (1.0 - share) * np.array(capsule.from_m) + share * np.array(capsule.to_m)
    axis: Floats = local @ T[:3, :3].T + T[:3, 3]
    return axis


def outside(fence: Fence, points: Floats) -> Floats:
    """Signed distance of points (k, 3) from the body of a fence, from its definition. Shape (k,)."""
    roll, pitch, yaw = np.radians(fence.rpy_deg)
    local = (points - np.array(fence.position_m)) @ rpy(roll, pitch, yaw)
    if fence.shape == "plane":
        return np.asarray(local[:, 2])
    if fence.shape == "box":
        half = np.array(fence.size_m) / 2
        nearest = np.clip(local, -half, half)
        depth = (half - np.abs(local)).min(axis=1)
    else:
        radial = np.hypot(local[:, 0], local[:, 1])
        scale = np.minimum(1.0, fence.radius_m / np.maximum(radial, 1e-300))
        z = np.clip(local[:, 2], -fence.length_m / 2, fence.length_m / 2)
        nearest = np.column_stack((local[:, 0] * scale, local[:, 1] * scale, z))
        depth = np.minimum(fence.radius_m - radial, fence.length_m / 2 - np.abs(local[:, 2]))
    away = np.linalg.norm(local - nearest, axis=1)
    return np.where(depth > 0.0, -depth, away)


def distance(robot: Robot, capsule: Capsule, fence: Fence, q: Floats) -> float:
    """Distance of one capsule from a fence, m."""
    apart = outside(fence, axis_points(robot, capsule, q))
    return float((-apart.max() if fence.keep == "in" else apart.min()) - capsule.radius_m)


def apart(robot: Robot, one: Capsule, other: Capsule, q: Floats) -> float:
    """Distance of two capsules, m."""
    a, b = axis_points(robot, one, q, 301), axis_points(robot, other, q, 301)
    between = np.linalg.norm(a[:, None, :] - b[None, :, :], axis=2).min()
    return float(between - one.radius_m - other.radius_m)
