"""Coordinates in which a segment is a straight line, and how they become joint positions.

Every segment, of whatever kind, is a straight line to its goal with transitions at its ends, in the coordinates of one
of three kinds of motion coordinates:

| class | coordinates | used for |
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
from qrobot.motion.path.goal_tracker import GoalSample, GoalTracker
from qrobot.motion.path.setpoint_history import History, motion_of
from qrobot.motion.world.drive_transform import OrientationInterpolation, drive_between, drive_parameters
from qrobot.motion.world.equation import Goal
from qrobot.motion.world.kinematics import ArmKinematics


class Coordinates(Protocol):
    """Coordinates, shape (m,)."""

    fixed: bool
    """They depend on nothing that moves."""

    goal: Goal | None
    """What they are relative to, None when they are relative to nothing."""

    def sample(self, tick: int) -> None:
        """Look where the goal is at sample `tick`."""

    def solve_next(self, x: Floats) -> Floats:
        """Joint positions (n,) of coordinates, at the newest sample. Raises Unreachable, JointLimit, Singular."""

    def solve_at(self, x: Floats, near: Floats) -> Floats:
        """Solve as `solve_next` does, anywhere on the way, without going there; the arm would come from `near` (n,)."""

    def from_joints(self, points: History, near: Floats) -> History:
        """Coordinates of joint positions, as far as the goal was seen at their samples.

        Where several are of one place those are meant that are nearest to `near` (m,).
        """


class JointCoordinates:
    """Joint positions themselves."""

    fixed = True
    goal: Goal | None = None

    def sample(self, tick: int) -> None:
        """Do nothing: joints do not depend on anything that has to be sampled."""

    def solve_next(self, x: Floats) -> Floats:
        """Return them: joints are the coordinates."""
        return x

    def solve_at(self, x: Floats, near: Floats) -> Floats:  # noqa: ARG002 (see Coordinates)
        """Return them: joints are the coordinates."""
        return x

    def from_joints(self, points: History, near: Floats) -> History:  # noqa: ARG002 (see Coordinates)
        """Return them: joints are the coordinates."""
        return points


JOINTS: Final = JointCoordinates()


class GoalRelativeJoints:
    """Joint positions less those of a goal.

    Args:
        tracker: the goal.
        kinematics: kinematics.
        branch: configuration at the goal.
        near: joint positions at the goal when it was solved last. Shape (n,).
    """

    fixed = False

    def __init__(self, tracker: GoalTracker, kinematics: ArmKinematics, branch: Branch, near: Floats) -> None:
        self.goal: Goal | None = tracker.goal
        self._tracker, self._kinematics, self._branch, self._near = tracker, kinematics, branch, near

    def sample(self, tick: int) -> None:
        """See `Coordinates.sample`."""
        self._tracker.sample(tick)

    def solve_next(self, x: Floats) -> Floats:
        """See `Coordinates.solve_next`."""
        self._near = self._solve(self._tracker.newest)
        return self._near + x

    def solve_at(self, x: Floats, near: Floats) -> Floats:  # noqa: ARG002 (the goal alone is solved for)
        """See `Coordinates.solve_at`."""
        return self._solve(self._tracker.newest) + x

    def from_joints(self, points: History, near: Floats) -> History:  # noqa: ARG002 (there is one of each)
        """See `Coordinates.from_joints`."""
        sample = ((tick, q, self._tracker.sample_at(tick)) for tick, q in points)
        return [(tick, q - self._solve(goal)) for tick, q, goal in sample if goal is not None]

    def _solve(self, goal: GoalSample) -> Floats:
        return self._kinematics.inverse(goal.pose, self._branch, self._near, singular=True)


class DriveCoordinates:
    """Parameters of DRIVE.

    Args:
        tracker: the goal.
        kinematics: kinematics.
        branch: configuration all the way.
        near: where the arm is. Shape (n,).
        turn: how orientations are interpolated.
    """

    def __init__(
        self,
        tracker: GoalTracker,
        kinematics: ArmKinematics,
        branch: Branch,
        near: Floats,
        turn: OrientationInterpolation = OrientationInterpolation.ONE_AXIS,
    ) -> None:
        self.goal: Goal | None = tracker.goal
        self.fixed = tracker.goal.fixed
        self._tracker, self._kinematics, self._branch, self._near = tracker, kinematics, branch, near
        self._turn = turn

    def sample(self, tick: int) -> None:
        """See `Coordinates.sample`."""
        self._tracker.sample(tick)

    def solve_next(self, x: Floats) -> Floats:
        """See `Coordinates.solve_next`."""
        self._near = self.solve_at(x, self._near)
        return self._near

    def solve_at(self, x: Floats, near: Floats) -> Floats:
        """See `Coordinates.solve_at`."""
        goal = self._tracker.newest
        t6, d = np.empty((4, 4)), np.empty((4, 4))
        at_goal = drive_between(goal.left, x, self._turn is OrientationInterpolation.TWO_ANGLES, goal.right, d, t6)
        return self._kinematics.inverse(t6, self._branch, near, singular=at_goal)

    def from_joints(self, points: History, near: Floats) -> History:
        """See `Coordinates.from_joints`."""
        found: list[tuple[float, Floats]] = []
        for tick, q in points:
            if (goal := self._tracker.sample_at(tick)) is not None:
                left = goal.drive_to(self._kinematics.forward(q))
                near = drive_parameters(left, near, self._turn)
                found.append((tick, near))
        return found


def measured(coordinates: Coordinates, points: History, near: Floats, period_s: float) -> Floats:
    """State (3, m) of joint setpoints in the coordinates of `coordinates`: the velocity is relative to the goal's.

    What the papers call the measured velocity at the start of a transition. Orientations are read off as the arm comes
    to them on its way past `near` (m,): a via point half a turn before its goal is so on the same side of it as they.
    """
    return motion_of(coordinates.from_joints(points, near), period_s)
