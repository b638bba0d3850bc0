"""What `end`, `code`, `scal`, `completed` and `update` say at each instant, in lock-step."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot import rccl
from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.motion import Termination
from qrobot.rccl import gentr_trsl, newtrans, rot, zunit
from tests.support.fake_robot import FakeRobot
from tests.support.puma import arm
from tests.support.rccl_table import TABLE, TIP, on_table, programmed
from tests.support.thorough import examples

DONE, STOPPED = Termination.COMPLETED, Termination.STOPPED
PERIOD_NS = 28_000_000


@pytest.fixture
def robot() -> Iterator[FakeRobot]:
    with programmed() as fake:
        yield fake


def place(name: str, *mm: float) -> rccl.Position:
    return on_table(name, gentr_trsl(name, *mm))


def tip_at(q: tuple[float, ...] | Floats) -> Floats:
    """The tip of the tool in the table's frame, mm. Shape (3,)."""
    return 1000.0 * (np.linalg.inv(TABLE.value) @ arm().forward(np.array(q)) @ TIP)[:3, 3]


def each_sample(note: Callable[[], object]) -> None:
    """Call `note` at each sample until nothing is to be done."""
    rccl.waitas(lambda: (note(), rccl.completed.count > 0)[1])


# ---------------------------------------------------------------------------------------- every motion ends, once

ACTS = st.sampled_from(["move", "move again", "nextmove", "stop", "sample", "wait"])


@settings(max_examples=examples(25), deadline=None)
@given(st.lists(ACTS, min_size=1, max_size=8))
def test_whatever_is_stopped_or_skipped_every_motion_ends_once_and_completed_comes(acts: list[str]) -> None:
    with programmed():
        a, b = place("A", 0, 0, -20), place("B", 0, 30, -20)
        asked = 0
        for act in acts:
            if act.startswith("move"):
                rccl.move(a if act == "move" else b)
                asked += 1
            elif act == "nextmove":
                rccl.nextmove(7)
            elif act == "stop":
                rccl.stop(0)
            elif act == "sample":
                begin = rccl.how.t_ns
                rccl.waitas(lambda begin=begin: rccl.how.t_ns != begin)
            else:
                rccl.waitfor(rccl.completed)
        rccl.waitfor(rccl.completed)
        assert a.end.count + b.end.count == asked
        assert {p.code for p in (a, b) if p.end.count} <= {DONE, STOPPED, 7}


@pytest.mark.parametrize("event", [lambda _: rccl.completed, lambda p: p.end])
@pytest.mark.parametrize("drop", [lambda: rccl.stop(0), lambda: rccl.nextmove(9)])
def test_a_motion_that_is_dropped_before_it_begins_signals_that_it_ended(robot, drop, event) -> None:
    p = place("P", 0, 0, 0)
    rccl.move(p)
    drop()
    rccl.waitfor(event(p))
    assert p.code in (STOPPED, 9)
    with pytest.raises(MotionError, match="no motion is left that could signal it"):
        rccl.waitfor(place("Q", 0, 0, 0).end)


def test_a_motion_that_is_dropped_by_release_has_ended_too(robot) -> None:
    p = place("P", 0, 0, 0)
    rccl.move(p)
    rccl.release()
    assert (p.code, p.end.count) == (STOPPED, 1)


# ------------------------------------------------------------------------------------------------- via points


@pytest.mark.parametrize("mode", ["cartesian", "joint"])
def test_the_end_of_a_via_point_comes_at_its_nearest_approach(robot, mode) -> None:
    """Hayward & Paul 1986, section 3.3: "each time the manipulator moves through p0"."""
    start, via, goal = place("START", 0, 0, 0), place("VIA", 0, 100, 0), place("GOAL", -100, 100, 0)
    rccl.move(start)
    rccl.waitfor(rccl.completed)
    rccl.setmode(mode)
    rccl.move(via)
    rccl.move(goal)
    away: list[float] = []
    ends: list[int] = []

    def note() -> None:
        away.append(float(np.linalg.norm(tip_at(rccl.how.q_setpoint) - (0, 100, 0))))
        ends.append(via.end.count)

    each_sample(note)
    assert abs(ends.index(1) - int(np.argmin(away))) <= 1
    assert min(away) > 2.0  # it is turned round, not gone to
    assert (via.end.count, via.code, via.scal) == (1, DONE, 1.0)


def test_both_motions_of_a_transition_tell_how_far_they_are(robot) -> None:
    via, goal = place("VIA", 0, 100, 0), place("GOAL", -100, 100, 0)
    rccl.move(via)
    rccl.move(goal)
    rows: list[tuple[float, float, int]] = []
    each_sample(lambda: rows.append((via.scal, goal.scal, via.end.count)))
    turning = [row for row in rows if 0.0 < row[1] < 1.0 and row[2] == 0]
    assert len(turning) >= 3  # the first half of the transition
    scals = np.array([row[:2] for row in rows])
    assert np.diff(scals[:, 0]).min() >= 0.0
    assert np.diff(scals[:, 0]).max() < 0.1  # up to its via point, without a jump
    assert np.diff(scals[:, 1]).min() >= 0.0


def test_a_motion_that_is_interrupted_while_it_turns_out_of_a_via_point_ends_after_that(robot) -> None:
    via, goal = place("VIA", 0, 100, 0), place("GOAL", -100, 100, 0)
    rccl.move(via)
    rccl.move(goal)
    rccl.waitas(lambda: goal.scal > 0.0)
    assert via.end.count == 0
    rccl.nextmove(5)
    rccl.waitfor(via.end)
    rccl.waitfor(goal.end)
    assert (via.code, goal.code) == (DONE, 5)


def test_the_dwell_of_the_paper_takes_its_time_and_is_half_over_at_half_of_it(robot) -> None:
    """S-02, Hayward & Paul 1986, section 3.3, at a sample period of which 400 ms are a multiple."""
    rccl.sample(20)
    p = place("P", 0, 0, 0)
    rccl.distance("dz", -10)
    rccl.move(p)
    rccl.move(p)
    rccl.setime(0, 400)
    rccl.move(p)
    rccl.waitfor(p.end)
    rccl.waitfor(p.end)
    begin = rccl.how.t_ns
    rccl.waitas(lambda: p.scal > 0.5)
    half_ms = (rccl.how.t_ns - begin) / 1e6
    rccl.waitfor(p.end)
    assert half_ms == 220  # the first sample after 200
    assert (rccl.how.t_ns - begin) / 1e6 == 400


def stop_there(_: rccl.Position) -> None:
    rccl.move(rccl.there)


def stop_for_200_ms(p: rccl.Position) -> None:
    rccl.setime(0.0, 200.0)
    rccl.move(p)


@pytest.mark.parametrize("mode", ["joint", "cartesian"])
@pytest.mark.parametrize("stop", [stop_there, stop_for_200_ms])
def test_a_queued_stop_stands_at_the_position_before_it_and_goes_on(robot, mode, stop) -> None:
    """ "to stop there, the command stop() is used" (Lloyd et al. 1987, section 2), as the guide writes it here."""
    rccl.move(place("START", 0, 0, 0))
    rccl.waitfor(rccl.completed)
    rccl.setmode(mode)
    p, then = place("P", 0, 60, 0), place("THEN", -60, 60, 0)
    rccl.move(p)
    stop(p)
    rccl.move(then)
    seen: list[Floats] = []
    each_sample(lambda: seen.append(tip_at(rccl.how.q_setpoint)))
    at_p = np.flatnonzero(np.abs(np.array(seen) - (0.0, 60.0, 0.0)).max(axis=1) < 1e-6)
    assert at_p.size >= 1
    assert np.diff(at_p).tolist() == [1] * (at_p.size - 1)
    assert (p.code, then.code) == (DONE, DONE)


@pytest.mark.parametrize("mode", ["joint", "cartesian"])
@pytest.mark.parametrize(("ta", "ts"), [(0.0, 400.0), (60.0, 310.0), (100.0, 777.0)])
@pytest.mark.parametrize("follows", [False, True])
def test_a_dwell_takes_its_time_to_the_nearest_sample_whether_or_not_a_motion_follows(
    robot, mode, ta, ts, follows
) -> None:
    p = place("P", 0, 0, 0)
    rccl.setmode(mode)
    rccl.move(p)
    rccl.setime(ta, ts)
    rccl.move(p)
    if follows:
        rccl.setime(60, 600)
        rccl.move(place("NEXT", 0, 60, 0))
    rccl.waitfor(p.end)
    begin = rccl.how.t_ns
    rccl.waitfor(p.end)
    assert (rccl.how.t_ns - begin) // PERIOD_NS == round(ts / 28.0)


def test_a_dwell_from_rest_takes_its_time_and_half_a_transition(robot) -> None:
    p = place("P", 0, 0, 0)
    rccl.move(p)
    rccl.waitfor(rccl.completed)
    rccl.setime(56, 400)
    p.end = 0
    rccl.move(p)
    begin = rccl.how.t_ns
    rccl.waitfor(p.end)
    assert (rccl.how.t_ns - begin) // PERIOD_NS == pytest.approx(
        14 + 2, abs=2
    )  # a goal is looked at before it is gone to


# ------------------------------------------------------------------------------------------------------- update


@pytest.mark.parametrize("more", [False, True])
@pytest.mark.parametrize("mode", ["cartesian", "joint"])
def test_update_takes_the_place_of_the_interruption_whether_or_not_a_motion_follows(robot, mode, more) -> None:
    """ "records the location at the time the motion is interrupted", Hayward & Paul 1986, section 3.3."""
    rccl.move(place("BEGIN", 0, 0, 0))
    rccl.waitfor(rccl.completed)
    rccl.setmode(mode)
    loc = gentr_trsl("LOC", 0, 200, 0)
    p = on_table("P", loc)
    seen: list[Floats] = []

    def monitor() -> int:
        if (tip := tip_at(rccl.how.q))[1] <= 90.0:
            return 0
        seen.append(tip)
        return 7

    rccl.evalfn(monitor)
    rccl.update(loc, p)
    rccl.move(p)
    if more:
        rccl.move(place("ELSEWHERE", 0, 0, -50))
    rccl.waitfor(p.end)
    assert p.code == 7
    assert [*loc.p] == pytest.approx(seen[0], abs=1e-6)
    rccl.waitfor(rccl.completed)
    assert [*loc.p] == pytest.approx(seen[0], abs=1e-6)
    if not more:
        assert np.linalg.norm(tip_at(robot.q) - seen[0]) > 3.0  # the arm came to rest farther on


def test_update_takes_the_place_where_stop_cut_the_motion_short(robot) -> None:
    loc = gentr_trsl("LOC", 0, 200, 0)
    p = on_table("P", loc)
    rccl.update(loc, p)
    rccl.move(p)
    rccl.waitas(lambda: p.scal > 0.5)
    rccl.stop(0)
    begin = rccl.how.t_ns
    rccl.waitas(lambda: rccl.how.t_ns != begin)
    there = tip_at(rccl.how.q)
    rccl.waitfor(p.end)
    assert p.code == STOPPED
    assert [*loc.p] == pytest.approx(there, abs=1e-6)


def test_update_takes_the_rest_of_a_motion_that_nothing_interrupts_and_of_a_stop_that_was_asked_for(robot) -> None:
    first, then = gentr_trsl("FIRST", 0, 50, 0), newtrans("THEN")
    p = on_table("P", first)
    rccl.distance("dz", -5)
    rccl.update(first, p)
    rccl.move(p)
    rccl.update(then, on_table("Q", then))
    rccl.move(rccl.there)
    rccl.waitfor(rccl.completed)
    assert [*first.p] == pytest.approx((0, 50, -5), abs=0.5)  # one sample behind the setpoint at most
    assert [*then.p] == pytest.approx((0, 50, -5), abs=0.5)


def test_a_motion_that_never_began_updates_nothing(robot) -> None:
    loc = gentr_trsl("LOC", 0, 200, 0)
    p = on_table("P", loc)
    rccl.move(place("BEFORE", 0, 0, 0))
    rccl.update(loc, p)
    rccl.move(p)
    rccl.waitas(lambda: rccl.nbrequest == 1)
    rccl.stop(0)
    rccl.waitfor(p.end)
    assert [*loc.p] == [0, 200, 0]


def test_several_transforms_are_updated_by_one_motion_and_a_second_time_is_refused(robot) -> None:
    a, b = gentr_trsl("A", 0, 20, 0), newtrans("B")
    p = on_table("P", a)
    rccl.update(a, p)
    rccl.update(b, on_table("Q", b))
    with pytest.raises(MotionError, match=r"update\(A, P\): the next motion has to update A already"):
        rccl.update(a, p)
    rccl.distance("dx", 10)
    rccl.move(p)
    rccl.waitfor(rccl.completed)
    assert [*a.p] == pytest.approx([*b.p])
    assert [*a.p] == pytest.approx((10, 20, 0), abs=0.5)
    rccl.update(a, p)  # of another motion
    rccl.move(p)
    rccl.waitfor(rccl.completed)


# ------------------------------------------------------------------------------------------------ scal and code


def test_scal_and_code_are_those_of_the_motion_that_was_asked_for_last(robot) -> None:
    """A program that goes to one position twice and waits for the second half is not deceived by the first time."""
    p = place("P", 0, 0, 0)
    rccl.move(p)
    rccl.waitfor(rccl.completed)
    assert (p.scal, p.code) == (1.0, DONE)  # a program that looks late still sees that it is done
    rccl.distance("dz", -40)
    rccl.move(p)
    assert (p.scal, p.code) == (0.0, Termination.NONE)
    begin = rccl.how.t_ns
    rccl.waitas(lambda: p.scal > 0.5)
    assert rccl.how.t_ns - begin > 3 * PERIOD_NS
    rccl.waitfor(rccl.completed)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("mm", [0.0, 40.0])
@pytest.mark.parametrize("ta", [0.0, 140.0])
def test_scal_grows_to_1_without_a_jump(robot, ta, mm, moving) -> None:
    """What a frame is turned by must not jump: also in a dwell, and with a frame that moves."""
    p = on_table("P", gentr_trsl("PLACE", 0, 0, 0), newtrans("FRAME", lambda _: None) if moving else newtrans("FRAME"))
    rccl.distance("dy", -mm)
    rccl.move(p)
    rccl.waitfor(rccl.completed)
    p.end = 0
    rccl.setime(ta if mm == 0.0 else max(ta, 84.0), 840)  # 30 samples
    rccl.move(p)
    scals = [p.scal]
    rccl.waitas(lambda: (scals.append(p.scal), p.end.count > 0)[1])
    assert (scals[0], scals[-1]) == (0.0, 1.0)
    assert 0.0 <= np.diff(scals).min() <= np.diff(scals).max() <= 1.001 / 30


def test_a_dwell_over_a_belt_that_the_arm_goes_with_is_waited_for(robot) -> None:
    belt = newtrans("BELT", lambda t: setattr(t.p, "y", 0.02 * rccl.how.t_ns * 1e-6))
    pick, place_ = on_table("PICK", gentr_trsl("BOX", 0, -60, 0), belt), place("PLACE", 0, 0, -40)
    for position in (pick, place_, pick):
        rccl.move(position)
        rccl.waitfor(position.end)
    rccl.setime(100, 560)
    rccl.move(pick)
    assert (pick.scal, pick.code) == (0.0, Termination.NONE)
    begin = rccl.how.t_ns
    rccl.waitas(lambda: pick.scal > 0.5)
    assert rccl.how.t_ns - begin > 9 * PERIOD_NS
    rccl.waitfor(rccl.completed)
    rccl.stop(0)


def test_of_two_motions_to_one_position_the_older_one_counts_until_it_has_ended(robot) -> None:
    p, between = place("P", 0, 0, 0), place("Q", 0, 60, 0)
    for position in (p, between, p):
        rccl.move(position)
    rccl.waitfor(p.end)
    assert (p.code, p.scal) == (DONE, 0.0)  # why the first ended, and how far the second is
    rccl.waitas(lambda: p.scal > 0.5)
    assert between.end.count == 1
    rccl.waitfor(p.end)
    assert (p.code, p.scal) == (DONE, 1.0)


def test_a_frame_that_is_a_function_of_scal_stays_where_it_was_while_the_arm_is_with_it(robot) -> None:
    """A quarter turn by `scal`: were that to be reset at the end, or by the next `move`, the arm would have to jump."""
    turn: list[rccl.Position] = []
    angle = newtrans("ANGLE", lambda t: rot(t, zunit, turn[0].scal * 40.0 if turn else 0.0))
    turn.append(on_table("TURN", gentr_trsl("OFF", 0, 0, 0), angle))
    away = place("AWAY", 0, 60, 0)
    rccl.setime(200, 1500)
    rccl.move(turn[0])
    rccl.waitfor(turn[0].end)
    path = [np.array(rccl.how.q_setpoint)]
    rccl.move(away)
    rccl.move(away)
    rccl.distance("dz", -1)
    rccl.move(turn[0])  # waits behind them
    assert turn[0].scal == 1.0
    rccl.waitas(lambda: (path.append(np.array(rccl.how.q_setpoint)), away.end.count == 1)[1])
    assert turn[0].code == DONE
    assert np.abs(np.diff(path, 2, axis=0)).max() < 0.02
    rccl.stop(0)
    rccl.waitfor(rccl.completed)
