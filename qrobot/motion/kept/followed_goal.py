"""The goal that an arm stayed with when the servo stopped it: where the arm would be with it now."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.motion.generator import Generator
from qrobot.motion.world.equation import Goal
from qrobot.motion.world.kinematics import ArmKinematics

STILL: Final = 1e-9  # m, and of axes: what moves less from one sample to the next stands


class FollowedGoal:
    """A goal that is looked at while the arm is away from it.

    Args:
        goal: that was followed.
        kinematics: of the arm.
        q: setpoint with which the arm was there last. Shape (n,).
        tick: number of that sample.

    Attributes:
        still: it has not moved since the sample before.
    """

    def __init__(self, goal: Goal, kinematics: ArmKinematics, q: Floats, tick: int) -> None:
        self.still = False
        self._goal, self._kinematics, self._q, self._tick = goal, kinematics, q, tick
        self._pose = goal.pose(tick)

    def look(self, tick: int) -> None:
        """See where it is at sample `tick`."""
        if tick > self._tick:
            pose = self._goal.pose(tick)
            self.still = bool(np.abs(pose - self._pose).max() < STILL)
            self._pose, self._tick = pose, tick

    @property
    def q(self) -> Floats:
        """Joints of the arm that is there, in the configuration it had. Shape (n,). Raises Unreachable, JointLimit."""
        return self._kinematics.inverse(self._pose, self._kinematics.branch(self._q), self._q)

    def hand_over(self, generator: Generator) -> Generator:
        """The same generator, of an arm that is there, which follows from now on."""
        generator.follow(self._goal)
        return generator


def followed_goal(generator: Generator, kinematics: ArmKinematics | None, tick: int) -> FollowedGoal | None:
    """The goal that an arm stays with, None when it has motions to do, gives way, or follows nothing."""
    goal = generator.goal
    if goal is None or kinematics is None or generator.busy or goal.compliance is not None:
        return None
    return FollowedGoal(goal, kinematics, generator.newest, tick)
