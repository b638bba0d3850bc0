"""Where a stop that is under way will end: a motion that is asked for meanwhile is judged and solved from there."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.model.branch import Branch
from qrobot.motion import (
    T6,
    Duration,
    Equation,
    Generator,
    MotionLimits,
    MotionMode,
    MoveRequest,
    SpeedShare,
    Termination,
    ToolSpeed,
    TransformKind,
    Trsf,
)
from tests.support.puma import LIMITS, PARK, PERIOD_S, arm, at_park, kinematics, puma_generator, shift

WAY = shift(y=0.08, turn=0.2)
SPEED = ToolSpeed(0.2, 1.0)
Motion = Callable[[], Generator]


class OnARail:
    """Kinematics of the PUMA with a seventh joint, which moves nothing and stays where it is."""

    def __init__(self) -> None:
        self._puma = kinematics()

    def forward(self, q: Floats) -> Floats:
        return self._puma.forward(q[:6])

    def branch(self, q: Floats) -> Branch:
        return self._puma.branch(q[:6])

    def inverse(self, T: Floats, branch: Branch, near: Floats, singular: bool = False) -> Floats:
        return np.append(self._puma.inverse(T, branch, near[:6], singular), near[6])

    def near_singular(self, q: Floats) -> bool:
        return self._puma.near_singular(q[:6])


def straight_line() -> Generator:
    motion = puma_generator()
    motion.push(MoveRequest("P", at_park(WAY).goal(), SPEED, mode=MotionMode.CARTESIAN))
    return motion


def to_a_goal_that_may_move() -> Generator:
    motion = puma_generator()
    goal = at_park(Trsf("B", TransformKind.VARB, WAY.value)).goal()
    motion.push(MoveRequest("P", goal, SPEED, mode=MotionMode.CARTESIAN))
    return motion


def with_seven_joints() -> Generator:
    fields = ("q_min", "q_max", "v_max", "a_max", "a_stop", "prismatic")
    of_joints = {name: np.append(getattr(LIMITS, name), getattr(LIMITS, name)[0]) for name in fields}
    limits = MotionLimits(**of_joints, names=(*LIMITS.names, "rail"))
    motion = Generator(limits, PERIOD_S, np.append(PARK, 0.1), kinematics=OnARail())
    motion.push(MoveRequest("P", at_park(WAY).goal(), SPEED, mode=MotionMode.CARTESIAN))
    return motion


def joint_path() -> Generator:
    motion = puma_generator()
    motion.push(MoveRequest("P", PARK + 0.1, SpeedShare(0.3)))
    return motion


def stop(motion: Generator) -> None:
    motion.stop()


def abort(motion: Generator) -> None:
    motion.abort(Termination.SINGULAR)


def goes_on(motion: Generator, samples: int = 400) -> Floats:
    """Where the arm has come to rest, or is after so many samples."""
    tick = motion._trajectory.tick
    for _ in range(samples):
        tick += 1
        motion.update(tick)
        if not motion.busy:
            break
    return motion.newest


@pytest.mark.parametrize("interrupt", [stop, abort])
@pytest.mark.parametrize("motion", [straight_line, to_a_goal_that_may_move, with_seven_joints, joint_path])
def test_an_arm_rests_where_its_stop_was_to_end_whenever_it_begins(motion: Motion, interrupt) -> None:
    """In all samples of a motion, and of its transition to rest."""
    whole, length = motion(), 0
    while whole.busy:
        length += 1
        whole.update(length)
    for when in range(1, length):
        arm_in_motion = motion()
        for tick in range(1, when + 1):
            arm_in_motion.update(tick)
        interrupt(arm_in_motion)
        end = arm_in_motion._sequencer.last_end()
        assert goes_on(arm_in_motion) == pytest.approx(end, abs=1e-9), when


@pytest.mark.parametrize("seconds", [3.0, 20.0, 100.0])
def test_a_stop_that_takes_longer_than_the_line_ends_where_that_does(seconds: float) -> None:
    """On the line joint 6 turns from -45 to 150 degrees: of those places the nearest one to its begin is -210."""
    begin, goal = (PARK + np.radians([waist, 0, 0, 0, 0, flange]) for waist, flange in ((-22.5, -45), (22.5, 150)))
    place = Trsf("PLACE", TransformKind.CONST, arm().forward(goal))
    for when in range(1, 100, 14):
        motion = puma_generator(begin)
        motion.push(
            MoveRequest("P", Equation("P", (T6,), (place,), T6).goal(), Duration(3.0), mode=MotionMode.CARTESIAN)
        )
        for tick in range(1, when + 1):
            motion.update(tick)
        motion.stop(seconds)
        end = motion._sequencer.last_end()
        assert goes_on(motion, 4000) == pytest.approx(end, abs=1e-9), when


@pytest.mark.parametrize("turn", [3.14, -3.14])
def test_a_goal_that_is_asked_for_in_a_stop_is_reached_in_the_turn_nearest_to_where_that_ends(turn: float) -> None:
    """By a wrist that can take the goal in two turns: nearly half a turn on one way, and a little more the other."""
    for when in range(4, 24, 2):
        motion = straight_line()
        for tick in range(1, when + 1):
            motion.update(tick)
        motion.stop()
        there = goes_on(motion.copy()) + turn * np.eye(6)[5]
        goal = Equation("Q", (T6,), (Trsf("THERE", TransformKind.CONST, arm().forward(there)),), T6).goal()
        motion.push(MoveRequest("Q", goal, SpeedShare(0.5)))
        assert goes_on(motion) == pytest.approx(there, abs=1e-6), when
