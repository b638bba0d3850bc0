"""Make the swings of a plan, through the library every program uses: on a running arm, or in lock-step."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config import Robot
from qrobot.ident.plan import READY, TRAVEL_SPEED, Plan, Swing
from qrobot.rccl.channel import Channel
from qrobot.rccl.position import Position
from qrobot.units import M_PER_MM, RAD_PER_DEG

Floats = NDArray[np.float64]
Progress = Callable[[int, Swing], None]

MS_PER_S: Final = 1000.0


def perform(
    arm: Channel,
    robot: Robot,
    plan: Plan,
    progress: Progress = lambda _number, _swing: None,
    first: int = 0,
) -> None:
    """Make the swings with an arm under control, from wherever it stands, and go to `ready` at the end.

    Args:
        arm: under control.
        robot: its file.
        plan: made for it.
        progress: called before each swing with its number, from 0.
        first: number of the swing to begin with, to go on where a recording broke off.
    """
    arm.setmode("joint")
    arm.setjvel(share=TRAVEL_SPEED)
    arm.move(arm.pose(READY))
    for number, swing in enumerate(plan.swings[first:], first):
        progress(number, swing)
        _swing(arm, robot, swing)
    arm.move(arm.pose(READY))
    arm.waitfor(arm.completed)


def _swing(arm: Channel, robot: Robot, swing: Swing) -> None:
    low, high = (_position(arm, robot, swing.name, q) for q in (swing.low, swing.high))
    if swing.by_ready:
        arm.move(arm.pose(READY))
    arm.move(low)
    arm.waitfor(arm.completed)
    for goal in (high, low):
        arm.setime(swing.turn_s * MS_PER_S, swing.seconds * MS_PER_S)
        arm.move(goal)
    arm.waitfor(arm.completed)


def _position(arm: Channel, robot: Robot, name: str, q: Floats) -> Position:
    return arm.jposition(name, (q / np.where(robot.prismatic, M_PER_MM, RAD_PER_DEG)).tolist())
