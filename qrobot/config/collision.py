"""Thresholds of a collision that an arm takes: its robot file's are the largest."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Final

from qrobot.config.robot import Robot

NO_TORQUES: Final = "the drives of this arm close the position loop, and nobody knows their torques"


def torque_objection(thresholds: Sequence[float], reaction: int, torques_known: bool) -> str:
    """Reason for which an arm cannot tell collisions, and react to them, as asked; "" when it can.

    Args:
        reaction: a `CollisionReaction`; 0, with no threshold above 0, asks for nothing.
        torques_known: of its joints.
    """
    return NO_TORQUES if (any(thresholds) or reaction) and not torques_known else ""


def threshold_objection(robot: Robot, thresholds: Sequence[float]) -> str:
    """Reason for which `robot` cannot tell collisions by `thresholds`, N m (N), 0 for its file's; "" when it can."""
    if len(thresholds) != robot.n:
        return f"{len(thresholds)} thresholds for {robot.n} joints"
    most = robot.guard.unexplained_torque_or_default.tolist()
    for j, (threshold, allowed) in enumerate(zip(thresholds, most, strict=True)):
        if not (isfinite(threshold) and threshold >= 0.0):
            return f"threshold of joint {j + 1}: {threshold:g} is no torque, N m (N), above 0"
        if threshold > allowed:
            return (
                f"threshold of joint {j + 1}: {threshold:g} is more than unexplained_torque of the robot file, "
                f"{allowed:g}; collisions can only be told sooner"
            )
    return ""
