"""A request in the queue, with what was found out about its goal when it was issued."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion.equation import Goal
from qrobot.motion.goal_tracker import GoalTracker
from qrobot.motion.kinematics import Reach
from qrobot.motion.request import HERE, MotionMode, MoveRequest


@dataclass(frozen=True, eq=False)
class Following:
    """What the request behind one in the queue asks of its far end.

    Attributes:
        transition: Ta, samples; 0 when there is no such request.
        leaving: joint velocity with which it leaves the corner, None when that is not known. Shape (n,).
    """

    transition: int = 0
    leaving: Floats | None = None


NOTHING: Final = Following()


@dataclass(frozen=True, eq=False)
class QueuedMotion:
    """A request that waits.

    Attributes:
        request: what was asked.
        aim: the goal of an equation, followed; None for joint positions and for HERE.
        target: joint positions of a goal that stands still and is gone to in joint mode. Shape (n,).
        end: where the joints will be in the end, as far as that can be known. Shape (n,).
        asks: what it asks of the far end of the request before it.
    """

    request: MoveRequest
    aim: GoalTracker | None = None
    target: Floats | None = None
    end: Floats | None = None
    asks: Following = NOTHING

    @property
    def here(self) -> bool:
        """It is an absolute stop."""
        return self.request.target is HERE

    @property
    def settled(self) -> bool:
        """It can begin: the velocity of its goal is known."""
        return self.aim is None or self.aim.settled

    def sample(self, tick: int) -> None:
        """Look where the goal is."""
        if self.aim is not None:
            self.aim.sample(tick)


def prepare_motion(request: MoveRequest, start: Floats, reach: Reach | None, tick: int) -> QueuedMotion:
    """Prepare `request` for an arm that will come from about `start` (n,).

    Raises:
        MotionError: a goal of an equation, but the arm's inverse kinematics are not known.
        Unreachable, JointLimit, Singular: a goal that stands still has no solution.
    """
    if request.target is HERE:
        return QueuedMotion(request)
    if isinstance(request.target, np.ndarray):
        return QueuedMotion(request, target=request.target, end=request.target)
    if reach is None or not isinstance(request.target, Goal):
        raise MotionError("this arm has no inverse kinematics, so name joint positions")
    aim = GoalTracker(request.target)
    if not request.target.fixed:
        return QueuedMotion(request, aim)
    aim.sample(tick)
    branch = reach.branch(start) if request.branch is None else request.branch
    q = reach.inverse(aim.newest.pose, branch, start, singular=True)
    return QueuedMotion(request, aim, q if request.mode is MotionMode.JOINT else None, q)
