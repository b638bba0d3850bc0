"""Requests, queue and codes of the generator, on a small arm and on the paper's experiment."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import JointLimit, MotionError
from qrobot.motion import (
    HERE,
    Duration,
    EventKind,
    Generator,
    JointSpeed,
    MoveRequest,
    SpeedShare,
    Termination,
    motion_limits,
)
from qrobot.motion.planning.request_queue import QUEUE_SIZE
from qrobot.motion.request import whole_samples
from tests.support.motion import LIMITS, PERIOD_S, ended, generator, run

SLOW = SpeedShare(0.5)
DONE = Termination.COMPLETED


def move(name: str, *q: float, speed=SLOW, ta=None) -> MoveRequest:
    return MoveRequest(name, np.array(q), speed, ta)


@pytest.mark.parametrize(("ms", "samples"), [(100, 2), (300, 5), (0, 1), (10, 1), (140, 3)])
def test_times_are_rounded_to_whole_samples_as_in_the_arcl_trace(ms, samples) -> None:
    assert whole_samples(ms / 1000, 0.056) == samples


def test_the_triple_speed_leg_of_the_papers_experiment_lasts_a_third_to_a_sample() -> None:
    robot = load_robot("puma560")
    park, end = robot.poses["park"], robot.poses["end"]
    gen = Generator(motion_limits(robot), PERIOD_S, park)
    for name, q, speed in (("out", end, 0.35), ("back", park, 1.05)):
        gen.push(MoveRequest(name, q, JointSpeed(speed)))
    outputs = list(run(gen))
    velocity = np.abs(np.diff([output.q for output in outputs], axis=0)).max(axis=1) / PERIOD_S
    assert np.median(velocity[20:120]) == pytest.approx(0.35, rel=0.005)
    assert velocity.max() == pytest.approx(1.05, rel=0.02)
    turn = next(i for i, output in enumerate(outputs) if output.request and output.request.name == "back")
    rest = len(outputs) - 1
    slow = np.abs(end - park).max() / 0.35 / PERIOD_S
    # from the beginning of one transition to that of the next; then to the end of the last, twice 196 ms later
    assert turn == pytest.approx(slow, abs=1)
    assert rest - turn - 2 * 7 == pytest.approx(slow / 3, abs=1)


def test_a_motion_alone_lasts_its_time_and_one_transition() -> None:
    gen = generator()
    gen.push(move("p", 1.0, 0.2, speed=Duration(2.8), ta=0.28))
    outputs = list(run(gen))
    assert len(outputs) == 1 + 100 + 2 * 10  # the sample at which it begins is still at rest


def test_an_empty_queue_holds() -> None:
    gen = generator((0.3, 0.1))
    outputs = [gen.update(tick) for tick in range(1, 50)]
    assert all((output.q == [0.3, 0.1]).all() and not output.moving for output in outputs)
    assert not any(output.events for output in outputs)


def test_the_path_turns_round_a_via_point_without_a_stop() -> None:
    gen = generator()
    gen.push(move("via", 1.0, 0.0))
    gen.push(move("goal", 2.0, 0.2))
    outputs = list(run(gen))
    speed = [abs(b.q[0] - a.q[0]) for a, b in pairwise(outputs)]
    begun = next(i for i, output in enumerate(outputs) if output.request and output.request.name == "goal")
    assert min(speed[begun - 5 : begun + 20]) > 0.005
    assert ended(outputs) == [("via", DONE), ("goal", DONE)]


def test_a_request_that_comes_too_late_for_the_turn_waits_until_the_arm_is_at_rest() -> None:
    gen = generator()
    gen.push(move("first", 1.0, 0.0))
    total = sum(1 for _ in run(gen))
    gen = generator()
    gen.push(move("first", 1.0, 0.0))
    late = list(run(gen, at_tick=lambda tick: gen.push(move("second", 0.0, 0.0)) if tick == total - 2 else None))
    assert ended(late) == [("first", DONE), ("second", DONE)]
    assert any((output.q == [1.0, 0.0]).all() for output in late)


def test_events_tell_begin_and_end_of_each_request_and_the_idle_arm_once() -> None:
    gen = generator()
    gen.push(move("a", 0.5, 0.0))
    gen.push(move("b", 0.0, 0.0))
    kinds = [(event.kind, event.request and event.request.name) for output in run(gen) for event in output.events]
    assert kinds == [
        (EventKind.BEGUN, "a"),
        (EventKind.BEGUN, "b"),
        (EventKind.ENDED, "a"),
        (EventKind.ENDED, "b"),
        (EventKind.IDLE, None),
    ]


def test_scal_runs_from_zero_to_one_during_a_segment() -> None:
    gen = generator()
    gen.push(move("a", 1.0, 0.0))
    scals = [output.scal for output in run(gen)]
    assert scals[0] == 0.0
    assert scals[-1] == 1.0
    assert np.diff(scals).min() >= 0.0


def test_a_dwell_lasts_its_time() -> None:
    gen = generator()
    gen.push(move("p", 0.5, 0.0))
    gen.push(move("p", 0.5, 0.0, speed=Duration(0.7), ta=0.0))
    outputs = list(run(gen))
    dwell = [output for output in outputs[1:] if output.request and np.allclose(output.q, [0.5, 0.0])]
    assert len(dwell) * PERIOD_S == pytest.approx(0.7, abs=3 * PERIOD_S)


def test_an_interruption_ends_the_request_with_the_programs_code_and_goes_on_to_the_next() -> None:
    gen = generator()
    gen.push(move("a", 2.0, 0.0))
    gen.push(move("b", 0.0, 0.3))
    outputs = list(run(gen, at_tick=lambda tick: gen.skip(42) if tick == 20 else None))
    assert ended(outputs) == [("a", 42), ("b", DONE)]
    assert max(output.q[0] for output in outputs) < 1.0


def test_an_interruption_ends_a_request_that_is_about_to_begin_and_the_next_one_takes_its_place() -> None:
    gen = generator()
    gen.push(move("a", 2.0, 0.0))
    gen.push(move("b", 0.0, 0.3))
    gen.skip(42)
    outputs = list(run(gen))
    assert ended(outputs) == [("a", 42), ("b", DONE)]
    assert max(output.q[0] for output in outputs) == 0.0


def test_an_interruption_with_nothing_to_follow_stops_on_the_path() -> None:
    gen = generator()
    gen.push(move("a", 2.0, 0.4))
    outputs = list(run(gen, at_tick=lambda tick: gen.skip(42) if tick == 20 else None))
    assert ended(outputs) == [("a", 42)]
    q = outputs[-1].q
    assert 0.1 < q[0] < 1.0
    assert q[1] == pytest.approx(q[0] * 0.4 / 2.0)


def test_a_stop_on_the_spot_behind_a_motion_lets_it_arrive_and_one_that_interrupts_does_not() -> None:
    stand = MoveRequest("stand", HERE, SLOW)
    for when, codes in ((None, [DONE, DONE]), (20, [42, DONE])):
        gen = generator()
        gen.push(move("a", 2.0, 0.4))
        gen.push(stand)
        outputs = list(run(gen, at_tick=lambda tick, gen=gen, when=when: gen.skip(42) if tick == when else None))
        assert [code for _, code in ended(outputs)] == codes
        assert (outputs[-1].q == [2.0, 0.4]).all() == (when is None)
        assert outputs[-1].q[1] == pytest.approx(outputs[-1].q[0] * 0.2)


def test_what_has_to_be_given_up_ends_in_a_stop_with_its_code_and_nothing_follows() -> None:
    gen = generator()
    gen.push(move("a", 2.0, 0.4))
    gen.push(move("b", 0.0, 0.0))
    outputs = list(run(gen, at_tick=lambda tick: gen.abort(Termination.SINGULAR) if tick == 20 else None))
    assert ended(outputs) == [("b", Termination.STOPPED), ("a", Termination.SINGULAR)]
    assert 0.0 < outputs[-1].q[0] < 1.0


def test_a_stop_decelerates_no_harder_than_a_stop() -> None:
    gen = generator(period_s=0.001)
    gen.push(move("a", 3.0, 0.0, speed=SpeedShare(1.0)))
    states = []
    for _ in run(gen, at_tick=lambda tick: gen.stop() if tick == 1000 else None):
        states.append(gen.state())
    assert min(state[2][0] for state in states) == pytest.approx(-LIMITS.a_stop[0], rel=0.01)


def test_a_stop_may_take_longer_when_asked() -> None:
    gen = generator()
    gen.push(move("a", 3.0, 0.0, speed=SpeedShare(0.2)))
    outputs = list(run(gen, at_tick=lambda tick: gen.stop(1.4) if tick == 30 else None))
    assert len(outputs) == 29 + 50


def test_after_a_stop_new_requests_are_served() -> None:
    gen = generator()
    gen.push(move("a", 3.0, 0.0))

    def stop_and_ask(tick: int) -> None:
        if tick == 30:
            gen.stop()
            gen.push(move("b", 0.0, 0.0))

    outputs = list(run(gen, at_tick=stop_and_ask))
    assert ended(outputs) == [("a", Termination.STOPPED), ("b", DONE)]


def test_an_interruption_at_rest_does_nothing() -> None:
    gen = generator()
    gen.skip(3)
    gen.stop()
    assert not gen.update(1).events


@pytest.mark.parametrize(
    ("request_", "error", "words"),
    [
        (move("far", 3.5, 0.0), JointLimit, r"move to far: joint 1 \(waist\) at 200.54 deg is outside -114.59 deg to"),
        (move("out", 0.0, 0.6), JointLimit, r"joint 2 \(slide\) at 0.6000 m is outside -0.5000 m to 0.5000 m"),
        (move("odd", 0.0), MotionError, "2 finite joint positions needed"),
        (move("nan", np.nan, 0.0), MotionError, "2 finite joint positions needed"),
        (move("p", 2.0, 0.0, speed=Duration(1.0)), MotionError, r"1.984 rad/s, 1.5 allowed; give it 1344 ms or more"),
        (
            move("p", 0.0, 0.5, speed=JointSpeed(0.5)),
            MotionError,
            r"joint 2 \(slide\) would need 0.4\d* m/s, 0.4 allowed",
        ),
        (move("p", 2.0, 0.0, ta=0.0), MotionError, r"allowed; give the transition \d+ ms or more"),
    ],
)
def test_what_the_arm_cannot_do_is_refused_with_the_reason(request_, error, words) -> None:
    gen = generator()
    with pytest.raises(error, match=words):
        gen.push(request_)
    assert gen.waiting == 0


def test_what_the_refusal_advises_is_granted() -> None:
    generator().push(move("p", 2.0, 0.0, speed=Duration(1.344)))
    with pytest.raises(MotionError, match="give the transition") as refusal:
        generator().push(move("p", 2.0, 0.0, ta=0.0))
    advised_ms = float(str(refusal.value).split("give the transition ")[1].split()[0])
    generator().push(move("p", 2.0, 0.0, ta=advised_ms / 1000))


def test_a_full_queue_refuses_and_counts() -> None:
    gen = generator()
    for _ in range(QUEUE_SIZE):
        gen.push(move("p", 0.1, 0.0))
    assert gen.waiting == QUEUE_SIZE
    with pytest.raises(MotionError, match="64 motions are waiting already"):
        gen.push(move("one more", 0.1, 0.0))


def test_time_does_not_run_backwards() -> None:
    gen = generator()
    gen.update(5)
    with pytest.raises(MotionError, match="sample 5 asked for after sample 5"):
        gen.update(5)


@pytest.mark.parametrize("make", [Duration, JointSpeed, SpeedShare])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
def test_a_pace_that_is_no_pace_is_refused(make, value) -> None:
    with pytest.raises(MotionError):
        make(value)


@pytest.mark.parametrize("when", [1, 20])
def test_a_stop_takes_the_place_of_a_skip_and_what_is_asked_next_begins_from_rest(when: int) -> None:
    """At rest as well, where the motion that was to be skipped has not begun."""
    gen = generator()
    gen.push(move("a", 1.0, 0.0))

    def skip_stop_and_ask(tick: int) -> None:
        if tick == when:
            gen.skip(42)
            gen.stop()
            gen.push(move("b", 0.0, 0.5))

    outputs = list(run(gen, at_tick=skip_stop_and_ask))
    assert ended(outputs) == [("a", Termination.STOPPED), ("b", DONE)]
    assert outputs[-1].q.tolist() == [0.0, 0.5]


def test_motions_end_in_their_order_whichever_samples_are_left_out() -> None:
    for gap in range(1, 120, 3):
        gen = generator()
        for name, q in zip("abc", (0.2, 0.4, 0.1), strict=True):
            gen.push(move(name, q, 0.0, speed=Duration(1.0), ta=0.1))
        outputs = [gen.update(tick) for tick in (*range(1, 21), *range(20 + gap, 300))]
        assert ended(outputs) == [("a", DONE), ("b", DONE), ("c", DONE)]


def test_a_motion_that_is_no_motion_from_where_an_interruption_finds_the_arm_is_refused_at_rest() -> None:
    """From its goal there is no way to go, however slowly; from elsewhere it would take for ever."""
    gen = generator()
    gen.push(MoveRequest("first", np.array([0.2, 0.05]), Duration(1.0)))
    gen.push(MoveRequest("slow", np.array([0.2, 0.05]), SpeedShare(1e-12)))
    outputs = list(run(gen, lambda tick: gen.skip(7) if tick == 10 else None))
    assert ended(outputs) == [("first", 7), ("slow", Termination.UNREACHABLE)]
    gen.push(MoveRequest("last", np.array([0.1, 0.0]), Duration(1.0)))
    assert gen.busy
