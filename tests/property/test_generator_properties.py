"""Whatever is asked of the generator, and whenever: no jump, no limit passed, the targets exact."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.motion import HERE, Blend, EventKind, JointSpeed, MoveRequest, SpeedShare, Termination
from tests.support.motion import LIMITS, ended, generator, run
from tests.support.thorough import examples

FINE_S = 0.005  # at this period differences of states say what the derivatives are
TARGETS = st.tuples(st.floats(-2.0, 3.0), st.floats(-0.5, 0.5))
PACES = st.one_of(st.builds(SpeedShare, st.floats(0.2, 1.0)), st.builds(JointSpeed, st.floats(0.05, 0.4)))
MOVES = st.builds(MoveRequest, st.just("there"), TARGETS.map(np.array), PACES)
PROGRAMS = st.lists(MOVES, min_size=1, max_size=4)
BLENDS = st.sampled_from(Blend)
ROUNDING = 1e-9
DONE = Termination.COMPLETED


def assert_within_limits(state) -> None:
    q, v, a = state
    assert (LIMITS.q_min - ROUNDING <= q).all()
    assert (q <= LIMITS.q_max + ROUNDING).all()
    assert (abs(v) <= LIMITS.v_max + ROUNDING).all()
    assert (abs(a) <= LIMITS.a_max + ROUNDING).all()


def assert_smooth(before, after, period_s: float, ticks: int = 1) -> None:
    """A step of the state agrees with its derivatives, within what the derivative may change during the step."""
    dt = period_s * ticks
    assert np.abs(after[0] - before[0] - dt * before[1]).max() <= LIMITS.a_max.max() * dt * dt
    assert (np.abs(after[1] - before[1]) <= LIMITS.a_max * dt + ROUNDING).all()


@given(PROGRAMS, BLENDS)
@settings(max_examples=examples(40))
def test_every_program_ends_exactly_at_its_last_target_within_the_limits(moves, blend) -> None:
    gen = generator(blend=blend)
    for move in moves:
        gen.push(move)
    before = gen.state()
    for output in run(gen):
        state = gen.state()
        assert_within_limits(state)
        assert_smooth(before, state, gen.period_s)
        before, last = state, output
    assert (last.q == moves[-1].target).all()
    assert not gen.state()[1:].any()


@given(PROGRAMS, st.integers(1, 120), st.sampled_from(["interrupt", "stop", "push"]), BLENDS)
@settings(max_examples=examples(30))
def test_interference_at_any_instant_leaves_position_velocity_and_acceleration_continuous(
    moves, when, interference, blend
) -> None:
    gen = generator(period_s=FINE_S, blend=blend)
    for move in moves:
        gen.push(move)
    deed = {
        "interrupt": lambda: gen.skip(1),
        "stop": gen.stop,
        "push": lambda: gen.push(MoveRequest("late", np.zeros(2), SpeedShare(0.5))),
    }[interference]

    def interfere(tick: int) -> None:
        if tick == 3 * when:
            state = gen.state()
            deed()
            assert (gen.state() == pytest.approx(state, abs=1e-9)) or not gen.state()[1:].any()

    before = gen.state()
    for _ in run(gen, at_tick=interfere):
        state = gen.state()
        assert_within_limits(state)
        assert_smooth(before, state, FINE_S)
        before = state


@given(MOVES, MOVES, st.integers(1, 100), BLENDS)
@settings(max_examples=examples(20))
def test_start_interruption_stop_and_resumption_are_requests_in_one_queue(first, second, when, blend) -> None:
    """A-38: `there` ends a motion at any instant, and another one begins where the arm then stands."""
    gen = generator(period_s=FINE_S, blend=blend)
    gen.push(first)
    events, last = [], first

    def interfere(tick: int) -> None:
        nonlocal last
        if tick == 3 * when:
            last = second
            gen.push(MoveRequest("stand", HERE, SpeedShare(0.5)))
            gen.push(second)
            gen.skip(7)

    before = gen.state()
    for output in run(gen, at_tick=interfere):
        state = gen.state()
        assert_within_limits(state)
        assert_smooth(before, state, FINE_S)
        before = state
        events.append(output)
    assert (output.q == last.target).all()
    assert ended(events) in ([("there", DONE)], [("there", 7), ("stand", DONE), ("there", DONE)])


@given(MOVES, MOVES)
@settings(max_examples=examples(10))
def test_replanning_from_every_intermediate_state_of_a_motion_keeps_the_limits(first, second) -> None:
    length = sum(1 for _ in run(with_moves(first)))
    for when in range(2, length, max(1, length // 20)):
        gen = with_moves(first)
        for tick in range(1, when):
            gen.update(tick)
        gen.push(second)
        gen.skip(5)
        before = gen.state()
        for tick in range(when, when + length + 2000):
            output = gen.update(tick)
            state = gen.state()
            assert_within_limits(state)
            assert_smooth(before, state, gen.period_s)
            before = state
            if not output.moving:
                break
        assert (output.q == second.target).all()


def with_moves(*moves):
    gen = generator()
    for move in moves:
        gen.push(move)
    return gen


@given(PROGRAMS, st.integers(1, 100))
@settings(max_examples=examples(40))
def test_a_stop_stays_on_the_path_and_drops_what_waits(moves, when) -> None:
    free, stopped = with_moves(*moves), with_moves(*moves)
    path = np.array([output.q for output in run(free)])
    outputs = list(run(stopped, at_tick=lambda tick: stopped.stop() if tick == when else None))
    codes = [code for _, code in ended(outputs)]
    assert len(codes) == len(moves)
    assert codes == sorted(codes, reverse=True)  # completed ones first, then stopped ones
    dense = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(np.vstack((np.zeros(2), path)))])
    if codes[0] == Termination.STOPPED:  # still on the way to the first target: the free path knows where
        distances = [np.linalg.norm(dense - output.q, axis=1).min() for output in outputs]
        assert max(distances) < 2e-3


@given(MOVES, st.integers(2, 60))
@settings(max_examples=examples(40))
def test_a_lost_sample_does_not_change_the_path(move, lost) -> None:
    whole, holed = with_moves(move), with_moves(move)
    for tick in range(1, 70):
        expected = whole.update(tick)
        if tick != lost:
            assert holed.update(tick).q == pytest.approx(expected.q, abs=1e-12)


CALLS = st.lists(st.tuples(st.sampled_from(["skip", "stop", "abort", "push", "here"]), st.integers(0, 40)), max_size=8)


@given(PROGRAMS, CALLS, st.lists(st.integers(1, 30), min_size=1, max_size=20))
@settings(max_examples=examples(50))
def test_whatever_is_asked_and_left_out_every_motion_begins_once_at_most_and_ends_once(moves, calls, gaps) -> None:
    """Calls come in any order, several between two samples, and samples are left out."""
    gen = with_moves(*moves)
    asked, events, tick = list(moves), [], 0
    act = {
        "skip": lambda: gen.skip(9),
        "stop": gen.stop,
        "abort": lambda: gen.abort(Termination.UNREACHABLE),
        "push": lambda: push(MoveRequest("more", np.array([0.3, 0.1]), SpeedShare(0.5))),
        "here": lambda: push(MoveRequest("stand", HERE, SpeedShare(0.5))),
    }

    def push(request: MoveRequest) -> None:
        gen.push(request)
        asked.append(request)

    for what, sample in sorted(calls, key=lambda call: call[1]):
        while tick < sample:
            tick += gaps[tick % len(gaps)]
            events += gen.update(tick).events
        act[what]()
    while gen.busy or gen.has_events:
        tick += gaps[tick % len(gaps)]
        events += gen.update(tick).events
    for request in asked:
        told = [event.kind for event in events if event.request is request]
        assert told.count(EventKind.ENDED) == 1
        assert told.count(EventKind.BEGUN) <= 1
        assert told[-1] is EventKind.ENDED
    completed = {event.request for event in events if event.kind is EventKind.ENDED and event.code == DONE}
    ends = [event.request for event in events if event.kind is EventKind.ENDED and event.request in completed]
    assert ends == [request for request in asked if request in completed]
    assert events[-1].kind in (EventKind.IDLE, EventKind.LOST)
