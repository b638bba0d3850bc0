"""Make the swings or the runs of a plan, through the library every program uses: on a running arm, or in lock-step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.ident.excitation import Excitation, FourierRun
from qrobot.ident.plan import READY, TRAVEL_SPEED, ExcitationPlan, Swing
from qrobot.rccl.channel import Channel
from qrobot.rccl.position import Position
from qrobot.rccl.setpoints import Setpoints
from qrobot.units import M_PER_MM, MS_PER_S, RAD_PER_DEG
from qrobot.wire.vocabulary import DEFAULT_PERIOD_US

MoveProgress = Callable[[int, Swing | FourierRun], None]

US_PER_S: Final = 1e6


def perform(
    arm: Channel,
    robot: Robot,
    plan: ExcitationPlan | Excitation,
    progress: MoveProgress = lambda _number, _move: None,
    first: int = 0,
) -> None:
    """Make the moves of a plan with an arm under control, from wherever it stands, and go to `ready` at the end.

    Args:
        arm: under control.
        robot: its file.
        plan: made for it.
        progress: called before each swing or run with its number, from 0.
        first: number of that to begin with, to go on where a recording broke off.
    """
    arm.setmode("joint")
    arm.setjvel(share=TRAVEL_SPEED)
    arm.move(arm.pose(READY))
    moves: Sequence[Swing | FourierRun] = plan.moves
    for number, move in enumerate(moves[first:], first):
        progress(number, move)
        if isinstance(move, Swing):
            _swing(arm, robot, move)
        else:
            _run(arm, robot, move)
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


def _run(arm: Channel, robot: Robot, run: FourierRun) -> None:
    arm.sample(DEFAULT_PERIOD_US / US_PER_S * MS_PER_S)
    if run.by_ready:
        arm.move(arm.pose(READY))
    arm.move(_position(arm, robot, run.name, run.motion.start))
    arm.waitfor(arm.completed)
    arm.play(setpoints_of(robot, run), run.name)
    arm.waitfor(arm.completed)


def setpoints_of(robot: Robot, run: FourierRun) -> Setpoints:
    """A run, sample by sample."""
    period_s = DEFAULT_PERIOD_US / US_PER_S
    t = period_s * np.arange(1 + int(np.ceil(run.motion.seconds / period_s)))
    return Setpoints(robot.name, DEFAULT_PERIOD_US, run.motion.at(np.minimum(t, run.motion.seconds)).q)


def _position(arm: Channel, robot: Robot, name: str, q: Floats) -> Position:
    return arm.jposition(name, (q / np.where(robot.prismatic, M_PER_MM, RAD_PER_DEG)).tolist())
