"""A joint that is turned or slid while something is held: it goes the way that is held, or it stays."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.config import Robot, load_robot
from qrobot.errors import JointLimit
from qrobot.motion import motion_limits
from qrobot.rccl.connect import open_channel
from qrobot.rccl.held_motion import MARGIN, HeldMotion
from qrobot.rccl.offline import OfflineLink
from qrobot.wire import Command, Hello, State

STANFORD = load_robot("stanford")
PERIOD_MS, BEGINS_MS = 28.0, 100.0
PRESS_MS = 600.0
STILL = 1e-9
SPANS = {False: (0.02, 5.0), True: (0.005, 0.55)}  # of a joint that turns, rad, and of one that slides, m


class _Arm(OfflineLink):
    """An ideal arm whose places are kept."""

    def __init__(self, hello: Hello, robot: Robot, start: Floats) -> None:
        super().__init__(hello, robot, start)
        self.places: list[Floats] = []

    def exchange(self, command: Command | None) -> State:
        state = super().exchange(command)
        self.places.append(np.array(state.robot.q))
        return state


def with_range(joint: int, low: float, high: float) -> Robot:
    """A Stanford arm, one of whose joints has another range around its pose `park`."""
    q_min, q_max = STANFORD.limits.q_min.copy(), STANFORD.limits.q_max.copy()
    q_min[joint], q_max[joint] = low, high
    return STANFORD.model_copy(update={"limits": STANFORD.limits.model_copy(update={"q_min": q_min, "q_max": q_max})})


def places_of_a_press(robot: Robot, start: Floats, joint: int, way: float, step: float) -> Floats:
    """Places of all joints while a press is held and afterwards. Shape (k, n)."""
    links: list[_Arm] = []

    def link(hello: Hello) -> _Arm:
        links.append(_Arm(hello, robot, start))
        return links[-1]

    with open_channel(link, robot, PERIOD_MS) as arm:
        begins_ms = arm.time + BEGINS_MS
        motion = HeldMotion(arm, lambda: True if 0.0 <= arm.time - begins_ms < PRESS_MS else None)
        with motion.watched():
            arm.waitas(lambda: motion.held)
            motion.turn_joint(joint, way, 1.0, step)
    return np.array(links[-1].places)


def assert_goes_that_way_or_stays(robot: Robot, start: Floats, joint: int, way: float, step: float) -> None:
    """And goes, where the end of the range is further than the margin; then it comes no nearer than that."""
    places = places_of_a_press(robot, start, joint, way, step)
    assert np.abs(np.delete(places - start, joint, axis=1)).max() < STILL
    gone = way * (places[:, joint] - start[joint])
    assert (np.diff(gone) > -STILL).all()
    limits = robot.limits
    left = limits.q_max[joint] - start[joint] if way > 0.0 else start[joint] - limits.q_min[joint]
    margin = min(MARGIN, 0.1 * (limits.q_max[joint] - limits.q_min[joint]))
    if left <= margin:
        assert gone.max() < STILL
    else:
        assert 0.0 < gone.max() <= left - margin + STILL


@pytest.mark.sampled(12)
@pytest.mark.parametrize("step", [0.0, 0.02], ids=["held", "a step"])
@pytest.mark.parametrize("joint", [0, 2, 4], ids=["turns", "slides", "turns in the wrist"])
@pytest.mark.parametrize("seed", range(8))
def test_whatever_its_range_and_its_place_a_joint_goes_the_way_that_is_held_or_stays(
    seed: int, joint: int, step: float
) -> None:
    random = np.random.default_rng([seed, joint])
    least, most = SPANS[bool(STANFORD.prismatic[joint])]
    span = float(np.exp(random.uniform(np.log(least), np.log(most))))
    start = np.array(STANFORD.poses["park"])
    low = start[joint] - random.uniform(0.0, span)
    robot = with_range(joint, low, low + span)  # one, for a program warms up the motion of each that it meets
    for share in (0.0, 1.0, *random.uniform(0.0, 1.0, 2)):
        start[joint] = low + share * span
        for way in (-1.0, 1.0):
            assert_goes_that_way_or_stays(robot, start, joint, way, step)


@pytest.mark.parametrize("short_of_m", [0.0, 0.003, MARGIN])
def test_an_axis_that_is_parked_at_its_upper_end_does_not_go_down_by_the_key_that_lifts_it(short_of_m: float) -> None:
    start = np.array(STANFORD.poses["park"])
    lift = with_range(2, start[2] - 0.5, start[2] + short_of_m)
    assert np.ptp(places_of_a_press(lift, start, 2, 1.0, 0.0)[:, 2]) < STILL
    assert places_of_a_press(lift, start, 2, -1.0, 0.0)[-1, 2] < start[2] - 0.02


OUT = {1: 0.015, 2: 0.004, 4: -0.02}  # rad or m beyond the upper, or the lower end


def arm_outside(far: Iterable[int]) -> tuple[Robot, Floats]:
    """A Stanford arm some joints of which stand beyond an end of their range, and where it stands."""
    limits, start = STANFORD.limits, np.array(STANFORD.poses["park"])
    q_min, q_max = limits.q_min.copy(), limits.q_max.copy()
    for joint in far:
        (q_max if OUT[joint] > 0.0 else q_min)[joint] = start[joint]
        start[joint] += OUT[joint]
    ranges = limits.model_copy(update={"q_min": q_min, "q_max": q_max})
    return STANFORD.model_copy(update={"limits": ranges}), start


@pytest.mark.parametrize("step", [0.0, 0.03], ids=["held", "a step"])
@pytest.mark.parametrize("joint", range(6))
def test_a_joint_is_moved_while_others_stand_outside_their_range_and_one_of_those_comes_back(
    joint: int, step: float
) -> None:
    robot, start = arm_outside(OUT)
    back = -float(np.sign(OUT[joint])) if joint in OUT else 1.0
    places = places_of_a_press(robot, start, joint, back, step)
    assert np.abs(np.delete(places - start, joint, axis=1)).max() < STILL
    gone = back * (places[:, joint] - start[joint])
    assert (np.diff(gone) > -STILL).all()
    assert gone[-1] > 0.02
    if joint in OUT:
        assert np.ptp(places_of_a_press(robot, start, joint, -back, step)[:, joint]) < STILL  # it goes no farther out


@pytest.mark.parametrize("joint", [0, 3])
def test_an_arm_whose_other_joints_stand_outside_their_range_stops_where_another_does_when_the_key_is_released(
    joint: int,
) -> None:
    ways = []
    for robot, start in (arm_outside(OUT), arm_outside(())):
        ways.append(places_of_a_press(robot, start, joint, 1.0, 0.0)[:, joint] - start[joint])
    assert ways[0][-1] > 0.02
    assert ways[0] == pytest.approx(ways[1], abs=STILL)


@pytest.mark.parametrize("joint", OUT)
def test_a_motion_leaves_no_joint_farther_outside_its_range_than_it_stood(joint: int) -> None:
    robot, start = arm_outside(OUT)
    limits = motion_limits(robot)
    limits.check_position(start, "stays", start)
    with pytest.raises(JointLimit):
        limits.check_position(start, "goes there")
    farther = start.copy()
    farther[joint] += np.sign(OUT[joint]) * 1e-6
    with pytest.raises(JointLimit):
        limits.check_position(farther, "goes out", start)
    limits.check_position(2.0 * start - farther, "comes back", start)
