"""Fences as they are told to people and to logs: the bodies in force and what of the arm keeps off them."""

from __future__ import annotations

from pydantic import Field

from qrobot.config.deployment import DeployedArm
from qrobot.config.document import Table
from qrobot.config.fences import Fence
from qrobot.config.robot import Robot
from qrobot.config.shape import Capsule
from qrobot.fences.deployed import deployed_shapes, tool_capsule


class ToldFences(Table):
    """Fences of one arm: those of its deployment and of its scene, poses in the base frame, SI units.

    Attributes:
        fences: that the arm keeps out of, or inside which it stays.
        self_collision: it keeps off its own body too, by `self_margin_m`.
        tool: what the last link carries, as a capsule; None for nothing.
    """

    fences: tuple[Fence, ...] = Field(default=(), strict=False)
    self_collision: bool = False
    self_margin_m: float = 0.0
    tool: Capsule | None = None


def told_fences(arm: DeployedArm, robot: Robot) -> ToldFences | None:
    """The fences that a deployment puts round an arm; None when it tells none."""
    if arm.fences is None:
        return None
    chosen = arm.fences
    return ToldFences(
        fences=deployed_shapes(arm, robot),
        self_collision=chosen.self_collision,
        self_margin_m=chosen.self_margin_m,
        tool=tool_capsule(arm, robot),
    )
