"""A request in the queue, with what was found out about its goal when it was issued."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion.path.goal_tracker import GoalTracker
from qrobot.motion.request import HERE, MotionMode, MoveRequest
from qrobot.motion.world.equation import Goal
from qrobot.motion.world.kinematics import ArmKinematics


@dataclass(frozen=True, eq=False)
class Following:
    """Demands of the request behind one in the queue on its far end.

    Attributes:
        transition: Ta, samples; 0 when there is no such request.
        leaving: joint velocity with which it leaves the via point, None when that is not known. Shape (n,).
    """

    transition: int = 0
    leaving: Floats | None = None


NO_FOLLOWER: Final = Following()


@dataclass(frozen=True, eq=False)
class QueuedMotion:
    """A request that waits.

    Attributes:
        request: what was asked.
        tracker: the goal of an equation, followed; None for joint positions and for HERE.
        target: joint positions of a goal that stands still and is gone to in joint mode. Shape (n,).
        end: where the joints will be in the end, as far as that can be known. Shape (n,).
        asks: what it asks of the far end of the request before it.
        start: where the arm was thought to begin when its way was looked at; None when it was not. Shape (n,).
    """

    request: MoveRequest
    tracker: GoalTracker | None = None
    target: Floats | None = None
    end: Floats | None = None
    asks: Following = NO_FOLLOWER
    start: Floats | None = None

    @property
    def here(self) -> bool:
        """True for an absolute stop."""
        return self.request.target is HERE

    @property
    def fixed(self) -> bool:
        """True when its goal stands still, and nothing complies on the way."""
        return self.tracker is None or self.tracker.goal.fixed

    @property
    def settled(self) -> bool:
        """True when it can begin: the velocity of its goal is known."""
        return self.tracker is None or self.tracker.settled

    def sample(self, tick: int) -> None:
        """Look where the goal is."""
        if self.tracker is not None:
            self.tracker.sample(tick)


def prepare_motion(request: MoveRequest, start: Floats, kinematics: ArmKinematics | None, tick: int) -> QueuedMotion:
    """Prepare `request` for an arm that will come from about `start` (n,).

    Raises:
        MotionError: a goal of an equation, but the arm's inverse kinematics are not known.
        Unreachable, JointLimit, Singular: a goal that stands still has no solution.
    """
    if request.target is HERE:
        return QueuedMotion(request)
    if isinstance(request.target, np.ndarray):
        return QueuedMotion(request, target=request.target, end=request.target)
    if kinematics is None or not isinstance(request.target, Goal):
        raise MotionError("this arm has no inverse kinematics, so name joint positions")
    tracker = GoalTracker(request.target)
    if not request.target.fixed:
        return QueuedMotion(request, tracker)
    tracker.sample(tick)
    branch = kinematics.branch(start) if request.branch is None else request.branch
    q = kinematics.inverse(tracker.newest.pose, branch, start, singular=True)
    return QueuedMotion(request, tracker, q if request.mode is MotionMode.JOINT else None, q)
