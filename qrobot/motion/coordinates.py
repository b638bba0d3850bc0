"""Coordinates in which a segment is a straight line, and how they become joint positions.

Every segment, of whatever kind, is a straight line to its goal with transitions at its ends, in the coordinates of one
of three charts:

| chart | coordinates | used for |
|---|---|---|
| `JointCoordinates` | joint positions | joint mode to a goal that stands still, and stops |
| `GoalRelativeJoints` | joint positions less those of the goal | joint mode to a goal that moves |
| `DriveCoordinates` | parameters of DRIVE | Cartesian mode |

In the last two the goal is the origin, wherever it is at the moment: a motion that has come to it stays with it. With
`GoalRelativeJoints` a goal whose joints move at constant speed is met by the joint path that the linear extrapolation
of the papers gives (A-29); for any other the extrapolation is made anew at each sample.
"""

from __future__ import annotations

from typing import Final, Protocol

import numpy as np

from qrobot.arrays import Floats
from qrobot.model.branch import Branch
from qrobot.motion.drive_transform import OrientationInterpolation, drive_between, drive_parameters
from qrobot.motion.equation import Goal
from qrobot.motion.goal_tracker import GoalSample, GoalTracker
from qrobot.motion.kinematics import Reach
from qrobot.motion.setpoint_history import History, motion_of


class Coordinates(Protocol):
    """Coordinates, shape (m,)."""

    fixed: bool
    """They depend on nothing that moves."""

    goal: Goal | None
    """What they are relative to, None when they are relative to nothing."""

    def sample(self, tick: int) -> None:
        """Look where the goal is at sample `tick`."""

    def joints(self, x: Floats) -> Floats:
        """Joint positions (n,) of coordinates, at the newest sample. Raises Unreachable, JointLimit, Singular."""

    def look(self, x: Floats, near: Floats) -> Floats:
        """As `joints`, anywhere on the way, without going there; the arm would come from `near` (n,)."""

    def trace(self, points: History) -> History:
        """Coordinates of joint positions, as far as the goal was seen at their samples."""


class JointCoordinates:
    """Joint positions themselves."""

    fixed = True
    goal: Goal | None = None

    def sample(self, tick: int) -> None:
        """Nothing to look at."""

    def joints(self, x: Floats) -> Floats:
        """They are the coordinates."""
        return x

    def look(self, x: Floats, near: Floats) -> Floats:  # noqa: ARG002 (see Chart)
        """They are the coordinates."""
        return x

    def trace(self, points: History) -> History:
        """They are the coordinates."""
        return points


JOINTS: Final = JointCoordinates()


class GoalRelativeJoints:
    """Joint positions less those of a goal.

    Args:
        aim: the goal.
        reach: kinematics.
        branch: configuration at the goal.
        near: joint positions at the goal when it was solved last. Shape (n,).
    """

    fixed = False

    def __init__(self, aim: GoalTracker, reach: Reach, branch: Branch, near: Floats) -> None:
        self.goal: Goal | None = aim.goal
        self._aim, self._reach, self._branch, self._near = aim, reach, branch, near

    def sample(self, tick: int) -> None:
        """See `Coordinates.sample`."""
        self._aim.sample(tick)

    def joints(self, x: Floats) -> Floats:
        """See `Coordinates.joints`."""
        self._near = self._solve(self._aim.newest)
        return self._near + x

    def look(self, x: Floats, near: Floats) -> Floats:  # noqa: ARG002 (the goal alone is solved for)
        """See `Coordinates.look`."""
        return self._solve(self._aim.newest) + x

    def trace(self, points: History) -> History:
        """See `Coordinates.trace`."""
        seen = ((tick, q, self._aim.frames(tick)) for tick, q in points)
        return [(tick, q - self._solve(frames)) for tick, q, frames in seen if frames is not None]

    def _solve(self, frames: GoalSample) -> Floats:
        return self._reach.inverse(frames.pose, self._branch, self._near, singular=True)


class DriveCoordinates:
    """Parameters of DRIVE.

    Args:
        aim: the goal.
        reach: kinematics.
        branch: configuration all the way.
        near: where the arm is. Shape (n,).
        turn: how orientations are interpolated.
    """

    def __init__(
        self,
        aim: GoalTracker,
        reach: Reach,
        branch: Branch,
        near: Floats,
        turn: OrientationInterpolation = OrientationInterpolation.ONE_AXIS,
    ) -> None:
        self.goal: Goal | None = aim.goal
        self.fixed = aim.goal.fixed
        self._aim, self._reach, self._branch, self._near = aim, reach, branch, near
        self._turn = turn

    def sample(self, tick: int) -> None:
        """See `Coordinates.sample`."""
        self._aim.sample(tick)

    def joints(self, x: Floats) -> Floats:
        """See `Coordinates.joints`."""
        self._near = self.look(x, self._near)
        return self._near

    def look(self, x: Floats, near: Floats) -> Floats:
        """See `Coordinates.look`."""
        frames = self._aim.newest
        t6, d = np.empty((4, 4)), np.empty((4, 4))
        at_goal = drive_between(frames.left, x, self._turn is OrientationInterpolation.TWO_ANGLES, frames.right, d, t6)
        return self._reach.inverse(t6, self._branch, near, singular=at_goal)

    def trace(self, points: History) -> History:
        """See `Coordinates.trace`."""
        found: list[tuple[int, Floats]] = []
        for tick, q in points:
            if (frames := self._aim.frames(tick)) is not None:
                near = found[-1][1] if found else None
                left = frames.drive_to(self._reach.forward(q))
                found.append((tick, drive_parameters(left, near, self._turn)))
        return found


def measured(chart: Coordinates, points: History, period_s: float) -> Floats:
    """State (3, m) of joint setpoints in the coordinates of `chart`: the velocity is relative to the goal's.

    What the papers call the measured velocity at the start of a transition.
    """
    return motion_of(chart.trace(points), period_s)
