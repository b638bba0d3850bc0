"""The inverse of any arm: whatever solution it gives is one, and it is the closed form's where there is one."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.errors import JointLimit, MotionError, Singular, Unreachable
from qrobot.model.arm import Arm
from qrobot.model.branch import Branch
from qrobot.motion import (
    T6,
    Duration,
    Equation,
    Generator,
    Goal,
    MotionMode,
    MoveRequest,
    SpeedShare,
    TransformKind,
    Trsf,
    kinematics_of,
    motion_limits,
)
from qrobot.motion.world.numerical_kinematics import NumericalKinematics
from tests.support.drawn_arms import drawn, within
from tests.support.motion import ended, run
from tests.support.puma import const
from tests.support.thorough import examples

ROUNDING = 1e-9
SHARES = st.lists(st.floats(0.02, 0.98), min_size=6, max_size=6).map(np.array)
SMALL = st.lists(st.floats(-0.15, 0.15), min_size=6, max_size=6).map(np.array)


@cache
def packaged(name: str) -> tuple[Arm, NumericalKinematics]:
    arm = Arm(load_robot(name))
    return arm, NumericalKinematics(arm)


@pytest.mark.parametrize("name", ["puma560", "stanford"])
@given(SHARES, SMALL)
@settings(max_examples=examples(60), deadline=None)
def test_near_a_position_it_gives_the_solution_of_the_closed_form(name, shares, off) -> None:
    arm, numerical = packaged(name)
    q = within(arm.robot, shares)
    T, near = arm.forward(q), np.clip(q + off, arm.robot.limits.q_min, arm.robot.limits.q_max)
    try:
        wanted = arm.inverse(T, arm.branch(q), near)
    except Singular:
        return
    least = np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1]
    found = numerical.inverse(T, Branch.RUN, near, singular=True)
    assert numerical.forward(found) == pytest.approx(T, abs=ROUNDING)
    if least > 0.1 and np.abs(off).max() < 0.5 * least:  # no other solution is so near
        assert found == pytest.approx(wanted, abs=1e-7)


@given(st.integers(0, 40), SHARES, SHARES)
@settings(max_examples=examples(120), deadline=None)
def test_a_pose_that_an_arm_can_take_is_reached_from_anywhere_within_its_ranges(seed, shares, from_shares) -> None:
    robot = drawn(seed)
    arm = Arm(robot)
    numerical, T = NumericalKinematics(arm), arm.forward(within(robot, shares))
    found = numerical.inverse(T, Branch.RUN, within(robot, from_shares), singular=True)
    assert arm.forward(found) == pytest.approx(T, abs=ROUNDING)
    assert (robot.limits.q_min <= found).all()
    assert (found <= robot.limits.q_max).all()


@given(st.integers(0, 40), SHARES, SMALL)
@settings(max_examples=examples(60), deadline=None)
def test_a_small_way_gives_a_small_step(seed, shares, off) -> None:
    """Of the first order: what the Jacobian says, where it is not singular."""
    robot = drawn(seed)
    arm, q = Arm(robot), within(robot, 0.2 + 0.6 * shares)
    if np.linalg.svd(arm.jacobian(q), compute_uv=False)[-1] < 0.05:
        return
    found = NumericalKinematics(arm).inverse(arm.forward(q + 1e-3 * off), Branch.RUN, q)
    assert found == pytest.approx(q + 1e-3 * off, abs=ROUNDING)


@pytest.mark.parametrize("axis", range(3))
def test_a_goal_half_a_turn_away_is_reached_or_told_and_never_taken_for_reached(axis: int) -> None:
    """At half a turn the sine of the angle is zero, as it is at the goal."""
    arm, numerical = packaged("puma560")
    free, turn = np.radians([10.0, -60.0, 150.0, 20.0, 40.0, 30.0]), -np.eye(4)
    turn[axis, axis] = turn[3, 3] = 1.0
    goal = arm.forward(free) @ turn
    reached = 0
    for near in (free, np.array(arm.robot.poses["ready"])):
        try:
            found = numerical.inverse(goal, Branch.RUN, near, singular=True)
        except JointLimit:
            continue
        assert numerical.forward(found) == pytest.approx(goal, abs=ROUNDING)
        reached += 1
    assert reached == 2 or axis != 2  # the last joint alone takes half a turn about its axis


def test_what_cannot_be_is_told_for_what_it_is() -> None:
    arm, numerical = packaged("puma560")
    park = np.array(arm.robot.poses["park"])
    far = arm.forward(park)
    far[0, 3] += 5.0
    with pytest.raises(Unreachable, match=r"T6 at \[5\d\d\d.*\] mm: out of the arm's reach"):
        numerical.inverse(far, Branch.RUN, park)
    beyond = np.array(arm.robot.limits.q_max)
    beyond[0] += 0.1
    with pytest.raises(JointLimit, match=r"waist would be at 165\.73 of -160\.\.160 deg"):
        numerical.inverse(arm.forward(beyond), Branch.RUN, beyond - [0.2, 0.1, 0.1, 0.1, 0.1, 0.1])
    straight = park.copy()
    straight[4] = 0.0  # joints 4 and 6 in line
    with pytest.raises(Singular, match="without bound"):
        numerical.inverse(arm.forward(straight), Branch.RUN, straight)
    assert numerical.forward(numerical.inverse(arm.forward(straight), Branch.RUN, straight, True)) == pytest.approx(
        arm.forward(straight), abs=ROUNDING
    )
    for bad in (np.full((4, 4), np.nan), arm.forward(park) @ np.diag([1.0, 1.0, -1.0, 1.0])):
        with pytest.raises(MotionError, match="not a rigid transform"):
            numerical.inverse(bad, Branch.RUN, park, True)
    with pytest.raises(MotionError, match="configuration 'lun': robot 'puma560' has no letters"):
        numerical.inverse(arm.forward(park), Branch.LEFT, park)


@pytest.mark.parametrize("seed", range(5))
def test_the_tool_of_an_arm_without_a_closed_form_goes_along_a_straight_line_within_its_limits(seed: int) -> None:
    robot = drawn(seed)
    arm, q = Arm(robot), within(robot, np.full(6, 0.4))
    kinematics, limits = kinematics_of(arm), motion_limits(robot)
    assert isinstance(kinematics, NumericalKinematics)
    gen, begin = Generator(limits, 0.028, q, kinematics=kinematics), arm.forward(q)
    T = arm.forward(q + 0.1)
    gen.push(MoveRequest("line", line_to(T), SpeedShare(0.5), mode=MotionMode.CARTESIAN))
    path = list(run(gen))
    assert ended(path) == [("line", -1)]
    along = (T - begin)[:3, 3] / np.linalg.norm((T - begin)[:3, 3])
    for output in path:
        way = (arm.forward(output.q) - begin)[:3, 3]
        assert np.linalg.norm(way - along * (along @ way)) < 1e-9
    assert arm.forward(path[-1].q) == pytest.approx(T, abs=ROUNDING)
    rates = np.abs(np.diff([output.q for output in path], axis=0)) / 0.028
    assert (rates <= limits.v_max * (1.0 + ROUNDING)).all()


@pytest.mark.parametrize(
    ("begin_deg", "end_deg"),
    [
        ((51.0, -30.0, 146.0, -95.0, -7.0, 241.0), (44.0, -9.0, 165.0, 51.0, -7.0, -174.0)),
        ((131.0, -13.0, 201.0, 35.0, 71.0, 39.0), (86.0, -45.0, 153.0, -81.0, 94.0, 132.0)),
        ((-21.0, -30.0, 146.0, -23.0, -13.0, -217.0), (-85.0, -52.0, 176.0, 77.0, 23.0, -249.0)),
    ],
)
def test_a_long_line_takes_the_time_and_leads_to_the_joints_that_the_closed_form_tells(begin_deg, end_deg) -> None:
    """Searched from the begin of the line, its end has another solution."""
    arm, numerical = packaged("puma560")
    begin, ends, samples = np.radians(begin_deg), [], []
    for kinematics in (kinematics_of(arm), numerical):
        gen = Generator(motion_limits(arm.robot), 0.028, begin, kinematics=kinematics)
        goal = line_to(arm.forward(np.radians(end_deg)))
        gen.push(MoveRequest("line", goal, Duration(6.0), mode=MotionMode.CARTESIAN))
        ends.append(gen._sequencer.last_end())
        path = list(run(gen))
        assert ended(path) == [("line", -1)]
        assert path[-1].q == pytest.approx(ends[-1], abs=1e-7)
        samples.append(len(path))
    assert ends[0] == pytest.approx(ends[1], abs=1e-7)
    assert samples[0] == samples[1]


def line_to(T: np.ndarray) -> Goal:
    tool = const("TOOL")
    return Equation("P", (T6, tool), (Trsf("PLACE", TransformKind.CONST, T),), tool).goal()
