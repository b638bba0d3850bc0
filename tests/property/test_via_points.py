"""Motions that follow each other, with times that rise and fall: Paul's path exactly, and never a stop on the way."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from qrobot.errors import MotionError
from qrobot.model.transform import inverse, so3_log
from qrobot.motion import Duration, MotionMode, MoveRequest, OrientationInterpolation, SpeedShare, Termination
from tests.support.motion import LIMITS, PERIOD_S, ended, generator, run
from tests.support.paul import paul_path, samples_of, stretched
from tests.support.puma import PARK, TOOL, Conveyor, arm, at_park, puma_generator, shift
from tests.support.thorough import examples

DONE = Termination.COMPLETED
TIMES_S = st.floats(0.0, 0.4), st.floats(0.05, 2.0)
GENTLE = np.array([0.15, 0.045])  # speeds for which one sample is transition enough: 2 * 0.15 * 0.75 / 0.028 < 9
WAYS = st.tuples(st.floats(-0.4, 0.4), st.floats(-0.12, 0.12))


def timed(ways, gentle: np.ndarray):
    """Way, Ta and T of a segment that is no faster than `gentle`."""

    def at_ease(way, ta, ts):
        way = np.array(way)
        return way, ta, max(ts, float((np.abs(way) / gentle).max()) + PERIOD_S)

    return st.builds(at_ease, ways, *TIMES_S)


def oracle(corners, times, samples: int) -> np.ndarray:
    transitions = [samples_of(ta, PERIOD_S) for ta, _ in times]
    lengths = stretched([samples_of(ts, PERIOD_S) for _, ts in times], transitions)
    return paul_path(corners, lengths, transitions, samples)


@given(st.lists(timed(WAYS, GENTLE), min_size=2, max_size=6))
@settings(max_examples=examples(60))
def test_a_program_of_joint_motions_is_pauls_path_whatever_times_follow_each_other(segments) -> None:
    corners = [np.zeros(2)]
    for way, _, _ in segments:
        corners.append(np.clip(corners[-1] + way, LIMITS.q_min, LIMITS.q_max))
    gen = generator()
    for (_, ta, ts), target in zip(segments, corners[1:], strict=True):
        gen.push(MoveRequest("via", target, Duration(ts), ta))
    path = np.array([output.q for output in run(gen)])
    assert path == pytest.approx(oracle(corners, [(ta, ts) for _, ta, ts in segments], len(path)), abs=1e-12)


GENTLE_PLACES = np.array([0.04, 0.04, 0.04, 0.15])  # m/s and rad/s
PLACES = st.tuples(*[st.floats(-0.08, 0.08)] * 3, st.floats(-0.3, 0.3))


@given(st.lists(timed(PLACES, GENTLE_PLACES), min_size=2, max_size=4))
@settings(max_examples=examples(20))
def test_a_program_of_straight_lines_is_pauls_path_of_the_tool(segments) -> None:
    corners = [np.zeros(4), *(place for place, _, _ in segments)]
    least = np.abs(np.diff(corners, axis=0)) / GENTLE_PLACES  # from place to place, which may be farther than from park
    times = [(ta, 2.0 * max(ts, float(way.max()))) for way, (_, ta, ts) in zip(least, segments, strict=True)]
    gen = puma_generator()
    for place, (ta, ts) in zip(corners[1:], times, strict=True):
        gen.push(MoveRequest("via", at_park(shift(*place)).goal(), Duration(ts), ta, MotionMode.CARTESIAN))
    start = arm().forward(PARK) @ TOOL.value
    tools = [np.linalg.inv(start) @ arm().forward(output.q) @ TOOL.value for output in run(gen)]
    path = np.array([[*tool[:3, 3], np.arctan2(tool[1, 0], tool[0, 0])] for tool in tools])
    assert path == pytest.approx(oracle(corners, times, len(path)), abs=1e-9)


def straight_velocity(states: np.ndarray, names: list[str], name: str) -> tuple[int, np.ndarray] | None:
    """A sample at which the request of that name is on its straight line, and the velocity there."""
    for i in range(1, len(states)):
        if names[i - 1] == names[i] == name and not states[i, 2].any() and states[i, 1].any():
            return i, states[i, 1]
    return None


def slowest_between(v0: np.ndarray, v1: np.ndarray) -> float:
    """The least speed of velocities on the straight line from one to the other."""
    dv = v1 - v0
    share = float(np.clip(-(v0 @ dv) / max(float(dv @ dv), 1e-30), 0.0, 1.0))
    return float(np.linalg.norm(v0 + share * dv))


HASTY = st.tuples(
    st.tuples(st.floats(-2.0, 3.0), st.floats(-0.5, 0.5)),
    st.one_of(st.builds(SpeedShare, st.floats(0.1, 1.0)), st.builds(Duration, st.floats(0.1, 3.0))),
    st.one_of(st.none(), st.floats(0.0, 0.6)),
)


@given(st.lists(HASTY, min_size=2, max_size=6), st.integers(0, 10))
@settings(max_examples=examples(80))
def test_at_no_via_point_the_arm_is_slower_than_both_segments_ask_for(hasty, late) -> None:
    """However hasty: the velocity goes straight from the one to the other. Some requests come one by one."""
    gen = generator()
    moves = [MoveRequest(str(i), np.array(to), speed, ta) for i, (to, speed, ta) in enumerate(hasty)]

    def push(move: MoveRequest) -> None:
        try:
            gen.push(move)
        except MotionError:
            assume(False)

    for move in moves[:2]:
        push(move)
    states, names = [], []
    for output in run(gen, at_tick=lambda tick: [push(m) for m in moves[2:]] if tick == 1 + late else None):
        states.append(gen.state())
        names.append(output.request.name if output.request else "")
    known = [straight_velocity(np.array(states), names, move.name) for move in moves]
    for (move, here), there in zip(zip(moves, known, strict=True), known[1:], strict=False):
        in_time = move is moves[0] or names.index(move.name) > late  # what follows was known when it began
        if in_time and here is not None and there is not None:
            speeds = np.linalg.norm(np.array(states)[here[0] : there[0] + 1, 1], axis=1)
            assert speeds.min() >= slowest_between(here[1], there[1]) - 1e-9


@pytest.mark.parametrize("mode", list(MotionMode))
def test_a_shorter_transition_does_not_stop_the_arm_at_its_via_point(mode) -> None:
    gen = puma_generator()
    for y, ta in ((0.1, 0.2), (0.2, 0.1)):
        gen.push(MoveRequest("via", at_park(shift(y=y)).goal(), Duration(1.0), ta, mode))
    path = np.array([arm().forward(output.q)[:3, 3] for output in run(gen)])
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / PERIOD_S
    assert speed[20:-20].min() > 0.08


def test_a_request_that_was_to_follow_and_is_refused_when_its_turn_comes_lets_the_arm_rest_at_its_goal() -> None:
    """Its shorter transition has kept the arm from slowing down where it would have alone."""
    far = np.zeros(3)
    gen = puma_generator()
    belt = Conveyor(lambda _: (*far, 0.0))
    gen.push(MoveRequest("first", at_park(shift(y=0.1)).goal(), Duration(1.0), 0.4, MotionMode.CARTESIAN))
    gen.push(MoveRequest("second", at_park(belt.trsf).goal(), Duration(1.0), 0.1, MotionMode.CARTESIAN))
    path, codes = [PARK], []
    for tick in range(1, 120):
        belt.tick = tick
        if tick == 1 + 14 + 30:
            far[0] = 3.0
        output = gen.update(tick)
        path.append(output.q)
        codes += ended([output])
    assert [name for name, _ in codes] == ["second", "first"]
    assert codes[0][1] in (Termination.UNREACHABLE, Termination.JOINT_LIMIT)
    assert codes[1][1] is DONE
    assert np.abs(np.diff(path, 2, axis=0)).max() / PERIOD_S**2 < 2.0
    assert arm().forward(path[-1]) == pytest.approx(at_park(shift(y=0.1)).goal().pose(0), abs=1e-9)


def turned(corners: list[tuple[float, ...]], interpolation: OrientationInterpolation) -> tuple[int, float, np.ndarray]:
    """Samples of a program of straight lines to these places, how far the tool turned in all, and where it ended."""
    gen = puma_generator()
    for place in corners:
        goal = at_park(shift(*place)).goal()
        gen.push(MoveRequest("via", goal, Duration(2.0), 0.2, MotionMode.CARTESIAN, turn=interpolation))
    path = [PARK, *(output.q for output in run(gen))]
    steps = [
        so3_log(np.ascontiguousarray((inverse(arm().forward(a)) @ arm().forward(b))[:3, :3])) for a, b in pairwise(path)
    ]
    return len(steps), float(np.linalg.norm(steps, axis=1).sum()), arm().forward(path[-1]) @ TOOL.value


@given(
    st.tuples(*[st.floats(-0.08, 0.08)] * 3),
    st.tuples(*[st.floats(-0.08, 0.08)] * 3),
    st.sampled_from([(0.0, 180.0), (60.0, 170.0), (30.0, 180.0), (-60.0, -170.0), (0.0, -180.0), (60.0, -175.0)]),
    st.sampled_from(list(OrientationInterpolation)),
)
@settings(max_examples=examples(12))
def test_turns_that_are_half_a_turn_and_more_together_go_on_through_their_via_point(here, there, turns, way) -> None:
    """As long, and no farther, as each of them asks for: from rest at the via point it would take a transition more."""
    first, second = np.radians(turns)
    samples, angle, end = turned([(*here, first), (*there, first + second)], way)
    assert samples == turned([(*here, 0.2), (*there, 0.4)], way)[0]
    assert angle <= abs(first) + abs(second) + 1e-6
    assert end == pytest.approx(arm().forward(PARK) @ TOOL.value @ shift(*there, first + second).value, abs=1e-6)
