"""Whatever is asked of the generator in Cartesian space, and whenever: no jump, no limit passed, the goals exact."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.motion import HERE, Blend, MotionMode, MoveRequest, SpeedShare, Termination, ToolSpeed
from qrobot.motion.path.blend import Correction
from tests.support.motion import ended, run
from tests.support.puma import LIMITS, PARK, TOOL, Conveyor, arm, at_park, puma_generator, shift
from tests.support.thorough import examples

FINE_S = 0.005
DISTANCE = st.floats(-0.1, 0.1)
SHIFTS = st.builds(shift, DISTANCE, DISTANCE, st.floats(-0.15, 0.05), st.floats(-0.6, 0.6))
MODES = st.sampled_from(MotionMode)
BLENDS = st.sampled_from(Blend)
SPEED = st.builds(ToolSpeed, st.floats(0.05, 0.3), st.floats(0.3, 1.0))
# What differences of samples may exceed a planned value by: they see its change within a sample.
SLACK = 1.06


def moves(*frames):
    return st.lists(
        st.builds(lambda at, mode, speed: MoveRequest("there", at_park(*frames, at).goal(), speed, mode=mode),
                  SHIFTS, MODES, SPEED),
        min_size=1, max_size=4,
    )  # fmt: skip


def assert_within_limits(path: np.ndarray, period_s: float) -> None:
    assert (LIMITS.q_min <= path).all()
    assert (path <= LIMITS.q_max).all()
    v = np.diff(path, axis=0) / period_s
    assert (np.abs(v) <= SLACK * LIMITS.v_max).all()
    assert (np.abs(np.diff(v, axis=0)) / period_s <= SLACK * LIMITS.a_max).all()


def assert_smooth(path: np.ndarray, period_s: float, jump: float = 0.25) -> None:
    """No jump of the acceleration but what the shortest transition makes of it within one sample."""
    a = np.diff(path, 2, axis=0) / period_s**2
    jumps = np.abs(np.diff(a, axis=0)) / LIMITS.a_max
    assert jumps.max() < jump


def tool_at(q) -> np.ndarray:
    return arm().forward(q) @ TOOL.value


@given(moves(), BLENDS, st.sampled_from(Correction))
@settings(max_examples=examples(25))
def test_every_cartesian_program_ends_exactly_at_its_last_goal_within_the_limits(requests, blend, correction) -> None:
    gen = puma_generator(blend=blend, correction=correction)
    for request in requests:
        gen.push(request)
    outputs = list(run(gen))
    assert [code for _, code in ended(outputs)] == [Termination.COMPLETED] * len(requests)
    assert arm().forward(outputs[-1].q) == pytest.approx(requests[-1].target.pose(0), abs=1e-9)
    assert_within_limits(np.array([PARK, *(output.q for output in outputs)]), gen.period_s)


@given(SHIFTS, SPEED)
@settings(max_examples=examples(15))
def test_the_controlled_frame_moves_on_a_straight_line_and_turns_about_a_fixed_axis(there, speed) -> None:
    gen = puma_generator()
    gen.push(MoveRequest("there", at_park(there).goal(), speed, mode=MotionMode.CARTESIAN))
    start = tool_at(PARK)
    line = start[:3, :3] @ there.value[:3, 3]
    for output in run(gen):
        tool = tool_at(output.q)
        gone = tool[:3, 3] - start[:3, 3]
        assert np.linalg.norm(np.cross(gone, line)) <= 1e-9 * max(1.0, float(np.linalg.norm(line)))
        assert tool[:3, 2] == pytest.approx(start[:3, 2], abs=1e-9)  # the turn is about the tool's z


@given(
    moves(), st.integers(3, 150), st.sampled_from(["interrupt", "next", "here", "stop", "push"]), MODES, BLENDS
)  # fmt: skip
@settings(max_examples=examples(25))
def test_interference_at_any_instant_leaves_no_jump(requests, when, interference, mode, blend) -> None:
    gen = puma_generator(period_s=FINE_S, blend=blend)
    for request in requests:
        gen.push(request)

    def push() -> None:
        gen.push(MoveRequest("late", at_park(shift(y=0.05)).goal(), ToolSpeed(0.2, 1.0), mode=mode))

    def here() -> None:
        gen.push(MoveRequest("here", HERE, SpeedShare(0.5)))

    deeds = {
        "interrupt": (lambda: gen.skip(1),),
        "next": (push, lambda: gen.skip(1)),
        "here": (here,),
        "stop": (gen.stop,),
        "push": (push,),
    }[interference]

    def interfere(tick: int) -> None:
        if tick == when:
            for deed in deeds:
                deed()

    path = np.array([PARK, *(output.q for output in run(gen, at_tick=interfere))])
    assert_within_limits(path, FINE_S)
    assert_smooth(path, FINE_S, 0.8)  # a stop from slow joint motion takes a few samples only


@given(MODES, MODES, SHIFTS, st.integers(40, 120), st.sampled_from(Correction))
@settings(max_examples=examples(25))
def test_moving_frames_are_joined_followed_and_left_without_a_jump(mode, other, there, when, correction) -> None:
    """The goal moves on an ellipse and turns; after the segment's end the tool coincides with it at every sample."""
    belt = Conveyor(lambda t: (0.04 * np.sin(t), 0.06 * np.cos(1.3 * t), 0.0, 0.2 * np.sin(0.7 * t)))
    moving, fixed = at_park(belt.trsf, there, name="moving"), at_park(shift(z=-0.05), name="fixed")
    gen = puma_generator(correction=correction)
    speed = ToolSpeed(0.15, 0.6)
    gen.push(MoveRequest("moving", moving.goal(), speed, mode=mode))
    path, followed = [PARK], 0
    for tick in range(1, 400):
        belt.tick = tick
        if tick == when:
            gen.push(MoveRequest("fixed", fixed.goal(), speed, mode=other))
            gen.push(MoveRequest("again", moving.goal(), speed, mode=other))
        output = gen.update(tick)
        assert not any(code < Termination.COMPLETED for _, code in ended([output]))
        path.append(output.q)
        if not output.moving and not output.events:
            followed += 1
            goal = tool_at(PARK) @ belt.pose(tick) @ there.value
            assert np.abs(tool_at(output.q) - goal).max() < 1e-9
    assert followed > 50
    assert belt.calls == 399
    assert_within_limits(np.array(path), gen.period_s)
    if correction is Correction.SMOOTH:
        assert_smooth(np.array(path[3:]), gen.period_s)


@given(st.floats(0.02, 0.25), st.integers(1, 4), MODES)
@settings(max_examples=6)
def test_an_arm_at_rest_joins_a_frame_that_passes_without_a_jump_of_velocity(speed, rests, mode) -> None:
    """Also in the samples after a motion, when the newest setpoints moved still."""
    belt = Conveyor(lambda t: (speed * (t - 0.5), 0.0, 0.0, 0.0), FINE_S)
    gen = puma_generator(period_s=FINE_S)
    gen.push(MoveRequest("fixed", at_park(shift(z=-0.01)).goal(), ToolSpeed(0.2, 1.0), mode=mode))
    path, since = [PARK], 0
    for tick in range(1, 380):
        belt.tick = tick
        output = gen.update(tick)
        assert not any(code < Termination.COMPLETED for _, code in ended([output]))
        path.append(output.q)
        joined = since >= rests
        since += not output.moving
        if since == rests and not joined:
            gen.push(MoveRequest("belt", at_park(belt.trsf).goal(), ToolSpeed(0.3, 1.0), mode=mode))
    assert since > 50
    assert tool_at(output.q) == pytest.approx(tool_at(PARK) @ belt.pose(tick), abs=1e-9)
    assert_within_limits(np.array(path), FINE_S)
    assert_smooth(np.array(path), FINE_S)


def test_the_goal_equation_is_exact_at_the_end_of_a_segment_whose_frames_never_rest() -> None:
    belt = Conveyor(lambda t: (0.03 * t, 0.02 * t * t, 0.0, 0.1 * t))
    gen = puma_generator()
    gen.push(MoveRequest("m", at_park(belt.trsf).goal(), ToolSpeed(0.2, 1.0), mode=MotionMode.CARTESIAN))
    for tick in range(1, 60):
        belt.tick = tick
        output = gen.update(tick)
        if ended([output]):
            break
    assert ended([output]) == [("m", Termination.COMPLETED)]
    assert tool_at(output.q) == pytest.approx(tool_at(PARK) @ belt.pose(tick), abs=1e-12)


@given(SHIFTS, MODES)
@settings(max_examples=6)
def test_replanning_from_every_intermediate_state_of_a_cartesian_motion_keeps_the_limits(there, mode) -> None:
    first = MoveRequest("first", at_park(there).goal(), ToolSpeed(0.2, 1.0), mode=MotionMode.CARTESIAN)
    second = MoveRequest("second", at_park(shift(y=-0.1)).goal(), ToolSpeed(0.2, 1.0), mode=mode)
    length = sum(1 for _ in run(with_moves(first)))
    for when in range(2, length, max(1, length // 10)):
        gen = with_moves(first)
        path = [PARK, *(gen.update(tick).q for tick in range(1, when))]
        gen.push(second)
        gen.skip(5)
        for tick in range(when, when + 2000):
            output = gen.update(tick)
            path.append(output.q)
            if not output.moving:
                break
        assert arm().forward(output.q) == pytest.approx(second.target.pose(0), abs=1e-9)
        assert_within_limits(np.array(path), gen.period_s)
        assert all(np.abs(after - before).max() < 0.1 for before, after in pairwise(path))


def with_moves(*requests):
    gen = puma_generator()
    for request in requests:
        gen.push(request)
    return gen
