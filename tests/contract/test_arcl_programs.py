"""What an ARCL program asks for and what becomes of it, from the paper (Corke & Kirkham), off line."""

from __future__ import annotations

import re

import numpy as np
import pytest

from qrobot.arcl import (
    ARCL_AMI,
    ARCL_PERIOD,
    ARCL_ROBOT,
    ARCL_START,
    ARCL_STREAM,
    EQ,
    ERROR,
    EVENT_BEGIN,
    EVENT_DEQ,
    EVENT_DONE,
    EVENT_ERROR,
    EVENT_LIMIT,
    EVENT_NEAR,
    EVENT_STOP,
    FNDEF,
    GRIP_CLOSE,
    GRIP_CLOSE_BY,
    GRIP_OPEN,
    GRIP_OPEN_BY,
    HOLD,
    IOD_IN,
    IOD_OUT,
    MOV_CONFIG,
    MOV_DONEPROC,
    MOV_FEEDBACK,
    MOV_JVEL,
    MOV_NOTIFY,
    MOV_OFFSET,
    MOV_SHARE,
    MOV_SYNC,
    MOV_TACC,
    MOV_TIME,
    MOV_TRAJ,
    MOV_UPDATE,
    MOV_VR,
    MOV_VT,
    MOVE_STOP,
    OK,
    T6,
    TL,
    TRAJ_CART,
    TRAJ_JOINT,
    VARB,
    ami_treal,
    arcl_close,
    arcl_errproc,
    arcl_open,
    arcl_skip,
    arcl_wait,
    fkine,
    gripper,
    iod_read,
    iod_value,
    iod_write,
    joint_pos,
    makeposition,
    move,
    named_iod,
    new_iod,
    new_sem,
    new_trans,
    new_trans_tr,
    robot_pos,
    sem_clear,
    sem_give,
    sem_pend,
    sem_take,
    stop,
    teach,
    where,
)
from qrobot.arcl.stream import RecordKind, read_stream
from qrobot.errors import ConfigError, JointLimit, LinkError, MotionError, Unreachable
from qrobot.model.transform import so3_exp, transform
from qrobot.rci.machine_choice import MachineChoice, use_machine
from qrobot.rci.standstill import HELD_S
from tests.support.arcl import PARK, at, forget_programs, offline, recorded

pytestmark = pytest.mark.usefixtures("arcl_alone")

AWAY = (30.0, 80.0, -110.0, 10.0, 70.0, -20.0)
DT_MS = 56.0


def stood_for(samples: int):
    """True when so many samples have passed."""
    end = ami_treal() + samples * DT_MS
    return lambda: ami_treal() >= end


def test_a_move_returns_at_once_and_several_wait_in_the_queue() -> None:
    rp = offline()
    for _ in range(3):
        move(rp, joint_pos(rp, "away", AWAY), 0)
    assert (ami_treal(), rp.waiting) == (0.0, 3)
    arcl_wait(rp)
    assert (rp.waiting, rp.busy) == (0, False)


@pytest.mark.parametrize("ms", [2000, 3400, 1400])
def test_a_motion_of_tseg_ms_takes_tseg_in_whole_samples_and_one_more(ms: int) -> None:
    rp = offline()
    move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, ms, 0)
    arcl_wait(rp)
    assert ami_treal() == pytest.approx((round(ms / DT_MS) + 1) * DT_MS)
    assert np.allclose(rp.joints, AWAY, atol=1e-9)


def test_the_arm_comes_smoothly_to_rest_exactly_at_the_goal_when_nothing_waits() -> None:
    rp = offline()
    with recorded(rp) as rows:
        move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 2000, 0)
        arcl_wait(rp)
    path = np.array(rows)
    assert np.abs(path[-1] - AWAY).max() < 1e-9
    speed = np.abs(np.diff(path, axis=0)).max(axis=1)
    assert speed[-1] < 0.2 * speed.max()


def test_a_via_point_is_rounded_without_jerk_and_never_reached() -> None:
    """B1 to B2 of Figure 3: the third difference of a fine sample is bounded, so the acceleration has no step."""
    rp = offline(ARCL_PERIOD, 4)
    via = (30.0, 90.0, -90.0, 0.0, 90.0, 0.0)
    with recorded(rp) as rows:
        move(rp, joint_pos(rp, "via", via), MOV_TIME, 1500, MOV_TACC, 200, 0)
        move(rp, joint_pos(rp, "end", (30.0, 60.0, -90.0, 0.0, 90.0, 0.0)), MOV_TIME, 1500, 0)
        arcl_wait(rp)
    path, h = np.array(rows), 0.004
    assert 0.1 < np.abs(path - via).max(axis=1).min() < 10.0
    jerk = np.abs(np.diff(path, 3, axis=0)).max() / h**3
    dv, length = 20.0 * np.sqrt(2.0), 0.4
    assert jerk < 1.1 * 5.774 * dv / length**2  # the largest third derivative of 5/2 h^4 - 3 h^5 + h^6


def test_a_cartesian_motion_is_straight_and_a_joint_motion_is_not() -> None:
    bends = []
    for traj in (TRAJ_JOINT, TRAJ_CART):
        rp = offline()
        move(rp, at(500, 100, 200), MOV_CONFIG, "run", 0)
        arcl_wait(rp)
        rp.ami.wait(stood_for(4))
        with recorded(rp) as rows:
            move(rp, at(500, -250, 300), MOV_TRAJ, traj, MOV_TIME, 2000, 0)
            arcl_wait(rp)
        points = np.array([1e3 * rp.aki.forward(np.radians(row))[:3, 3] for row in rows])
        way = points[-1] - points[0]
        off = points - points[0] - np.outer((points - points[0]) @ way / (way @ way), way)
        bends.append(np.linalg.norm(off, axis=1).max())
        arcl_close(rp)
    assert bends[1] < 1e-6
    assert bends[0] > 1.0


def test_a_configuration_can_be_changed_in_joint_mode() -> None:
    rp = offline()
    goal = fkine(rp, (0.0, 135.0, 0.0, 0.0, 45.0, -180.0))
    assert rp.aki.branch(np.radians(PARK)).letters == "run"
    move(rp, makeposition(T6, EQ, goal, TL, goal), MOV_CONFIG, "lun", 0)
    arcl_wait(rp)
    assert rp.aki.branch(np.radians(rp.joints)).letters == "lun"


def test_a_speed_of_the_tool_sets_the_time() -> None:
    rp = offline()
    move(rp, at(500, 100, 200), MOV_CONFIG, "run", 0)
    arcl_wait(rp)
    begin = ami_treal()
    move(rp, at(500, -100, 200), MOV_TRAJ, TRAJ_CART, MOV_VT, 50, 0)
    arcl_wait(rp)
    assert ami_treal() - begin == pytest.approx((round(200 / 50 / 0.056) + 1) * DT_MS, abs=1.1 * DT_MS)


@pytest.mark.parametrize(("word", "turn"), [(MOV_VT, True), (MOV_VR, False)])
def test_what_a_speed_of_the_tool_says_nothing_of_goes_with_what_it_says(word: int, turn: bool) -> None:
    """A turn, where a speed along the way was asked for alone; a way, where that was done of the turn."""
    rp = offline()
    goal = (*PARK[:5], PARK[5] - 60.0) if turn else (PARK[0] + 40.0, *PARK[1:])
    with recorded(rp) as rows:
        move(rp, joint_pos(rp, "away", goal), word, 40.0 if turn else 20.0, 0)
        arcl_wait(rp)
    if turn:  # degrees/s
        assert np.abs(np.diff(np.array(rows)[:, 5])).max() / 0.056 == pytest.approx(20.0, rel=0.1)
    else:  # mm/s
        tip = np.array([1e3 * rp.aki.forward(np.radians(row))[:3, 3] for row in rows])
        assert np.linalg.norm(np.diff(tip, axis=0), axis=1).max() / 0.056 == pytest.approx(40.0, rel=0.1)


def test_joint_targets_take_a_speed_and_not_only_a_time() -> None:
    rp = offline()
    with recorded(rp) as rows:
        move(rp, joint_pos(rp, "away", (60.0, *PARK[1:])), MOV_JVEL, 20, 0)
        arcl_wait(rp)
    fastest = np.abs(np.diff(np.array(rows), axis=0)).max() / 0.056
    assert 19.0 < fastest < 22.0


def test_a_variable_counts_at_once_a_hold_transform_as_it_was_when_the_motion_was_requested() -> None:
    for kind, wanted in ((HOLD, 500.0), (VARB, 520.0)):
        rp = offline()
        shift = new_trans("shift", kind)
        move(rp, at(500, 100, 200, 90.0, shift), MOV_CONFIG, "run", 0)
        shift.t_p.z = 20.0  # along x of the base, for the goal is pitched by 90 degrees
        arcl_wait(rp)
        assert where(rp).t_p.x == pytest.approx(wanted, abs=1e-3)
        arcl_close(rp)


def test_a_function_is_called_every_cycle_with_its_transform_and_its_motion() -> None:
    rp, calls = offline(), []

    def drift(trans, m):
        calls.append((ami_treal(), m.name, m.t0))
        trans.t_p.y = 0.01 * (ami_treal() - m.t0)

    belt = new_trans("belt", FNDEF, drift)
    move(rp, at(500, 0, 200), MOV_CONFIG, "run", 0)
    arcl_wait(rp)
    begin = ami_treal()
    move(rp, at(500, 0, 200, 90.0, belt), MOV_TIME, 1500, 0)
    arcl_wait(rp)
    assert {(name, t0) for _, name, t0 in calls} == {("pos", begin + DT_MS)}
    assert np.allclose(np.diff([t for t, _, _ in calls]), DT_MS)


def test_the_arm_stays_with_a_goal_that_moves() -> None:
    rp = offline()
    belt = new_trans("belt", FNDEF, lambda t, m: setattr(t.t_p, "y", 0.02 * (ami_treal() - m.t0)))
    move(rp, at(500, -100, 200), MOV_CONFIG, "run", 0)
    arcl_wait(rp)
    move(rp, at(500, -100, 200, 90.0, belt), MOV_TIME, 1500, 0)
    arcl_wait(rp)
    y, t = where(rp).t_p.y, ami_treal()
    rp.ami.wait(lambda: ami_treal() >= t + 1000.0)
    assert where(rp).t_p.y - y == pytest.approx(0.02 * (ami_treal() - t), abs=0.01)
    stop(rp)


def test_sync_returns_when_the_move_is_nearly_complete() -> None:
    rp = offline()
    motion = move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 2000, MOV_SYNC, 0)
    assert motion.code is None
    assert 1700.0 < ami_treal() < 2000.0
    arcl_wait(rp)
    assert motion.code == EVENT_DONE


def test_functions_are_called_for_the_events_of_a_motion() -> None:
    rp, told = offline(), []
    move(
        rp, joint_pos(rp, "away", AWAY), MOV_NOTIFY, lambda event, robot: told.append((event, robot is rp)),
        MOV_DONEPROC, lambda _robot, motion: told.append(motion.name), 0,
    )  # fmt: skip
    arcl_wait(rp)
    assert told == [(EVENT_DEQ, True), (EVENT_BEGIN, True), (EVENT_NEAR, True), "away", (EVENT_DONE, True)]


def test_a_function_may_queue_the_next_motion() -> None:
    rp, left = offline(), [3]

    def again(robot, motion):
        left[0] -= 1
        if left[0]:
            move(robot, joint_pos(robot, "next", (10.0 * left[0], *PARK[1:])), MOV_DONEPROC, again, 0)

    move(rp, joint_pos(rp, "away", AWAY), MOV_DONEPROC, again, 0)
    arcl_wait(rp)
    assert left == [0]
    assert np.allclose(rp.joints, (10.0, *PARK[1:]))


def test_a_refused_motion_is_asked_for_again_until_it_may_begin() -> None:
    rp, asked = offline(), []

    def late(event, _robot):
        if event == EVENT_DEQ:
            asked.append(ami_treal())
            return OK if ami_treal() > 3000.0 else MOVE_STOP
        return OK

    first = joint_pos(rp, "first", (10.0, *PARK[1:]))
    move(rp, first, MOV_TIME, 1000, 0)
    last = move(rp, joint_pos(rp, "away", AWAY), MOV_NOTIFY, late, 0)
    rp.wait(lambda: ami_treal() > 2500.0)
    assert np.allclose(rp.joints, (10.0, *PARK[1:]))  # it waits where the motion before has ended
    assert last.code is None
    arcl_wait(rp)
    assert np.allclose(np.diff(asked), DT_MS)
    assert last.code == EVENT_DONE


def test_a_function_that_is_asked_may_stop_the_arm() -> None:
    rp = offline()
    motion = move(
        rp, joint_pos(rp, "away", AWAY), MOV_NOTIFY, lambda event, robot: event == EVENT_DEQ and stop(robot), 0
    )
    arcl_wait(rp)
    assert motion.code == EVENT_STOP
    assert np.allclose(rp.joints, PARK)


def test_an_answer_that_is_none_is_refused_and_that_to_other_events_does_not_matter() -> None:
    rp = offline()
    move(rp, joint_pos(rp, "away", AWAY), MOV_NOTIFY, lambda event, _robot: None if event == EVENT_DEQ else "thanks", 0)
    arcl_wait(rp)
    assert np.allclose(rp.joints, AWAY)
    move(rp, joint_pos(rp, "home", PARK), MOV_NOTIFY, lambda _event, _robot: True, 0)
    with pytest.raises(MotionError, match="answers OK"):
        arcl_wait(rp)


def test_a_transform_that_cannot_be_solved_for_is_refused_at_once_and_none_is_updated_that_was_not_gone_to() -> None:
    rp = offline()
    table, found = new_trans_tr("table", 400, 0, 0), new_trans("found", HOLD)
    pos = makeposition(T6, EQ, table, found, TL, found)
    for strange in (T6, new_trans("other"), rp):
        with pytest.raises(MotionError):
            move(rp, pos, MOV_UPDATE, strange, 0)
    move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 3000, 0)
    motion = move(rp, pos, MOV_UPDATE, found, 0)
    rp.wait(lambda: ami_treal() > 500.0)
    stop(rp)
    arcl_wait(rp)
    assert motion.code == EVENT_STOP
    assert np.array_equal(found.value, np.eye(4))


def test_stop_drops_what_waits_and_brings_the_arm_to_rest_on_its_path() -> None:
    rp, told = offline(), []
    notify = lambda event, _robot: told.append(event)  # noqa: E731
    motions = [move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 3000, MOV_NOTIFY, notify, 0) for _ in range(2)]
    rp.wait(lambda: ami_treal() > 1500.0)
    stop(rp)
    arcl_wait(rp)
    assert [motion.code for motion in motions] == [EVENT_STOP, EVENT_STOP]
    share = (rp.joints - PARK) / (np.array(AWAY) - PARK)
    assert np.allclose(share, share[0])
    assert 0.3 < share[0] < 0.9


def test_skip_goes_on_to_the_next_motion() -> None:
    rp = offline()
    first = move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 6000, 0)
    move(rp, joint_pos(rp, "home", PARK), MOV_TIME, 1000, 0)
    rp.wait(lambda: ami_treal() > 1000.0)
    arcl_skip(rp)
    arcl_wait(rp)
    assert first.code == EVENT_STOP
    assert np.allclose(rp.joints, PARK)
    assert ami_treal() < 4000.0


def test_feedback_tells_each_sample_of_a_motion_and_may_end_it() -> None:
    rp, told = offline(), []

    def look(feedback):
        told.append(feedback)
        return feedback.joints[0] > 15.0

    motion = move(rp, joint_pos(rp, "away", (60.0, *PARK[1:])), MOV_TIME, 4000, MOV_FEEDBACK, look, 0)
    arcl_wait(rp)
    assert motion.code == EVENT_STOP
    assert 15.0 < rp.joints[0] < 30.0
    assert np.allclose(np.diff([feedback.t for feedback in told]), DT_MS)
    shares = [feedback.share for feedback in told]
    assert shares == sorted(shares)


def test_a_goal_is_modified_in_the_frame_of_the_tool() -> None:
    rp = offline()
    move(rp, at(500, 0, 200), MOV_CONFIG, "run", MOV_OFFSET, new_trans_tr("back", 0, 0, -50), 0)
    arcl_wait(rp)
    assert list(where(rp).t_p) == pytest.approx([450.0, 0.0, 200.0], abs=1e-6)


def test_a_transform_is_solved_for_where_a_motion_ends() -> None:
    rp = offline()
    found = new_trans("found", HOLD)
    table = new_trans_tr("table", 400, 0, 0)
    goal = fkine(rp, AWAY)
    move(rp, joint_pos(rp, "away", AWAY), 0)
    arcl_wait(rp)
    found.set(np.linalg.inv(table.value) @ goal.value)
    found.t_p.x += 5.0
    move(rp, makeposition(T6, EQ, table, found, TL, found), MOV_UPDATE, found, MOV_TIME, 900, 0)
    found.t_p.x = 0.0
    arcl_wait(rp)
    assert np.allclose(table.value @ found.value, where(rp).value, atol=1e-5)  # measured a sample before


def test_without_a_handler_an_error_halts_the_arm_and_is_raised_at_the_next_call() -> None:
    rp = offline()
    move(rp, joint_pos(rp, "away", AWAY), 0)
    bad = move(rp, at(3000, 0, 0), 0)
    waits = move(rp, robot_pos(rp, "park"), 0)
    with pytest.raises(Unreachable, match="move to pos"):
        arcl_wait(rp)
    arcl_wait(rp)
    assert waits.code == EVENT_STOP
    assert bad.code is not None
    move(rp, joint_pos(rp, "home", PARK), 0)  # the program may go on
    arcl_wait(rp)
    assert np.allclose(rp.joints, PARK)


@pytest.mark.parametrize(("answer", "place"), [(OK, AWAY), (MOVE_STOP, PARK)])
def test_a_handler_of_errors_goes_on_or_halts(answer: int, place: tuple) -> None:
    rp, told = offline(), []
    arcl_errproc(lambda event, robot, error: (told.append((event, robot is rp, type(error))), answer)[1])
    move(rp, joint_pos(rp, "far", (170.0, *PARK[1:])), 0)
    move(rp, joint_pos(rp, "away", AWAY), 0)
    arcl_wait(rp)
    assert told == [(EVENT_LIMIT, True, JointLimit)]
    assert np.allclose(rp.joints, place)


def test_a_frame_that_turns_a_joint_to_its_limit_is_an_error_which_names_that_joint() -> None:
    rp, told = offline(), []
    arcl_errproc(lambda event, _, error: told.append((event, str(error))))

    def turn(t, motion) -> None:
        t.set(transform(so3_exp(np.array([0.0, 0.0, np.radians(-0.03 * (ami_treal() - motion.t0))]))))

    turning = makeposition("turning", T6, EQ, new_trans("around", FNDEF, turn), where(rp), TL, T6)
    move(rp, turning, MOV_TRAJ, TRAJ_JOINT, 0)
    arcl_wait(rp, lambda: told or rp.treal > 20_000.0)
    ((event, error),) = told
    assert event is EVENT_LIMIT
    assert re.search(r"joint \d \(\w+\) at \S+ deg could not stop within its range, \S+ deg to \S+ deg", error)


def test_a_frame_that_jumps_is_an_error_and_no_jump_of_the_arm() -> None:
    rp = offline()
    place = new_trans("place", VARB)
    move(rp, at(500, 0, 200, 90.0, place), MOV_CONFIG, "run", 0)
    arcl_wait(rp)
    with recorded(rp) as rows:
        rp.ami.wait(lambda: len(rows) > 5)
        place.t_p.y = 150.0
        with pytest.raises(MotionError):
            rp.wait(lambda: False)
    assert np.abs(np.diff(np.array(rows), axis=0)).max() < 1.0


def test_an_exception_of_a_function_reaches_the_program() -> None:
    rp = offline()
    move(rp, joint_pos(rp, "away", AWAY), MOV_FEEDBACK, lambda _feedback: 1 / 0, 0)
    with pytest.raises(ZeroDivisionError):
        arcl_wait(rp)


def test_a_function_that_is_called_at_each_sample_must_not_wait() -> None:
    rp = offline()
    move(rp, joint_pos(rp, "away", AWAY), MOV_FEEDBACK, lambda _feedback: arcl_wait(rp), 0)
    with pytest.raises(MotionError, match="must not wait"):
        arcl_wait(rp)


def test_semaphores_are_set_cleared_and_waited_for() -> None:
    rp, ready = offline(), new_sem("ready", value=False)
    assert sem_take(ready) == ERROR
    sem_give(ready)
    assert (sem_take(ready), sem_take(ready)) == (OK, ERROR)
    move(rp, joint_pos(rp, "away", AWAY), MOV_DONEPROC, lambda _robot, _motion: sem_give(ready), 0)
    sem_pend(ready)
    assert np.allclose(rp.joints, AWAY)
    sem_give(ready)
    sem_clear(ready)
    with pytest.raises(MotionError, match="no motion is left"):
        sem_pend(ready)


def test_hand_and_outputs_are_requests_in_the_stream(tmp_path) -> None:
    rp = offline(ARCL_STREAM, str(tmp_path / "run.arcl"))
    move(rp, joint_pos(rp, "away", AWAY), MOV_SYNC, 0)
    gripper(rp, GRIP_CLOSE)
    gripper(rp, GRIP_CLOSE_BY, 40.0)
    iod = new_iod(rp, IOD_OUT, 3, 4)
    iod_write(iod, 0b1001)
    arcl_wait(rp)
    rp.ami.wait(stood_for(2))
    assert iod_read(iod) == 0b1001
    arcl_close(rp)
    stream = read_stream(tmp_path / "run.arcl")
    assert [list(record.numbers) for record in stream.of(RecordKind.GRIPPER)] == [[2.0, 0.0], [3.0, 40.0]]
    assert [list(record.numbers) for record in stream.of(RecordKind.OUTPUT)] == [[3.0, 4.0, 9.0]]
    assert not stream.damage


def test_outputs_that_were_just_switched_read_as_they_were_switched_until_the_robot_has_answered(monkeypatch) -> None:
    rp = offline()
    both, one = new_iod(rp, IOD_OUT, 1, 4), new_iod(rp, IOD_OUT, 3)
    iod_write(both, 0b0001)
    for bit in (0b0010, 0b1000):
        iod_write(both, iod_read(both) | bit)  # no sample passes between them
    assert iod_read(both) == 0b1011
    rp.ami.wait(stood_for(6))
    assert iod_read(both) == 0b1011
    monkeypatch.setattr(rp.ami, "write_outputs", lambda *_: None)  # no line leads there
    iod_write(one, 1)
    assert iod_read(both) == 0b1111
    rp.ami.wait(stood_for(6))
    assert (iod_read(one), iod_read(both)) == (0, 0b1011)


def test_lines_that_are_not_there_and_values_too_large_for_them_are_refused() -> None:
    rp = offline()
    for direction, first, count in ((IOD_OUT, 0, 1), (IOD_OUT, 16, 2), (IOD_IN, 33, 1), ("out", 1, 1)):
        with pytest.raises(MotionError):
            new_iod(rp, direction, first, count)
    for value in (4, -1, 1.0, True):
        with pytest.raises(MotionError):
            iod_write(new_iod(rp, IOD_OUT, 1, 2), value)
    with pytest.raises(MotionError, match="inputs"):
        iod_write(new_iod(rp, IOD_IN, 1), 1)


def test_a_stream_has_joint_and_cartesian_setpoints_of_each_sample(tmp_path) -> None:
    rp = offline(ARCL_STREAM, str(tmp_path / "run.arcl"))
    with recorded(rp) as rows:
        move(rp, joint_pos(rp, "away", AWAY), 0)
        arcl_close(rp)
    stream = read_stream(tmp_path / "run.arcl")
    times, joints = stream.table(RecordKind.JOINTS, 6)
    _, poses = stream.table(RecordKind.CARTESIAN, 12)
    assert np.allclose(np.degrees(joints), rows)
    assert np.allclose(times, 0.056 * np.arange(len(rows)))
    wanted = [rp.aki.forward(q)[:3].T.ravel() for q in joints]
    assert np.allclose(poses, wanted)


def test_several_robots_share_one_time_and_nobody_is_left_behind() -> None:
    puma, stanford = offline(), arcl_open(ARCL_ROBOT, "stanford", ARCL_AMI, "offline", ARCL_PERIOD, 28, 0)
    move(stanford, robot_pos(stanford, "end"), MOV_SHARE, 20, 0)
    move(puma, joint_pos(puma, "away", AWAY), MOV_TIME, 2000, 0)
    arcl_wait(puma)
    assert abs(ami_treal(puma) - ami_treal(stanford)) <= DT_MS
    arcl_wait(stanford)
    assert np.allclose(stanford.joints, stanford.pose("end").target / stanford._units)


@pytest.mark.parametrize(("joint", "travel"), [(0, 20.0), (2, 80.0)])
def test_the_fastest_joint_moves_at_mov_jvel_degrees_or_where_it_slides_mm_each_second(
    joint: int, travel: float
) -> None:
    stanford = arcl_open(ARCL_ROBOT, "stanford", ARCL_AMI, "offline", ARCL_PERIOD, 28, 0)
    goal = np.array(stanford.joints)
    goal[joint] += travel
    began = ami_treal(stanford)
    move(stanford, joint_pos(stanford, "away", goal), MOV_JVEL, 20.0, 0)
    arcl_wait(stanford)
    assert ami_treal(stanford) - began == pytest.approx(travel / 20.0 * 1000.0, abs=3 * 28)


def test_close_waits_for_the_motions_and_nothing_comes_after_it() -> None:
    rp = offline()
    motion = move(rp, joint_pos(rp, "away", AWAY), 0)
    arcl_close(rp)
    assert motion.code == EVENT_DONE
    arcl_close(rp)
    with pytest.raises(LinkError, match="closed"):
        move(rp, joint_pos(rp, "away", AWAY), 0)


@pytest.mark.parametrize(
    ("attributes", "error"),
    [
        ((ARCL_AMI, "nowhere", 0), ConfigError),
        ((ARCL_ROBOT, "puma9000", 0), ConfigError),
        ((ARCL_AMI, "offline", ARCL_PERIOD, 0.1, 0), MotionError),
        ((ARCL_AMI, "offline", ARCL_START, (1, 2), 0), MotionError),
        ((MOV_TIME, 3, 0), MotionError),
    ],
)
def test_a_robot_that_cannot_be_opened_is_refused(attributes: tuple, error: type) -> None:
    with pytest.raises(error):
        arcl_open(*attributes)


def test_a_transform_is_no_position_and_a_tool_is_named_behind_tl() -> None:
    rp = offline()
    with pytest.raises(MotionError, match="position is needed"):
        move(rp, new_trans_tr("t", 1, 2, 3), 0)  # type: ignore[arg-type]
    with pytest.raises(MotionError, match="TL"):
        joint_pos(rp, "p", PARK, new_trans_tr("t", 1, 2, 3))
    with pytest.raises(MotionError, match="6 finite"):
        joint_pos(rp, "p", (1, 2, 3))
    with pytest.raises(MotionError):
        makeposition(T6, EQ, TL, T6, T6)


def test_a_motion_that_fails_behind_its_deq_ends_with_a_stop_too() -> None:
    rp, told, free = offline(), [], new_sem("free")
    arcl_errproc(lambda _event, _robot, _error: OK)

    def one_at_a_time(event, _robot):
        told.append(event)
        if event == EVENT_DEQ and sem_take(free) == ERROR:
            return MOVE_STOP
        if event in (EVENT_DONE, EVENT_STOP):
            sem_give(free)
        return OK

    bad = move(rp, joint_pos(rp, "far", (170.0, *PARK[1:])), MOV_NOTIFY, one_at_a_time, 0)
    move(rp, joint_pos(rp, "away", AWAY), MOV_NOTIFY, one_at_a_time, 0)
    arcl_wait(rp)
    assert told[:3] == [EVENT_DEQ, EVENT_LIMIT, EVENT_STOP]
    assert bad.code == EVENT_LIMIT
    assert np.allclose(rp.joints, AWAY)


@pytest.mark.parametrize("period_ms", [1, 56])
def test_a_program_may_wait_for_a_time_with_its_arm_at_rest(period_ms: int) -> None:
    rp = offline(ARCL_PERIOD, period_ms)
    arcl_wait(rp, lambda: ami_treal() >= 6000.0)
    assert 6000.0 <= ami_treal() < 6000.0 + 2 * period_ms


@pytest.mark.parametrize("n", [1, 2])
def test_a_program_whose_arms_are_all_held_back_for_ever_ends(n: int) -> None:
    robots = [offline() for _ in range(n)]
    motions = [move(rp, joint_pos(rp, "away", AWAY), MOV_NOTIFY, lambda *_: MOVE_STOP, 0) for rp in robots]
    with pytest.raises(MotionError, match="held back by MOVE_STOP"):
        arcl_wait(robots[0])
    assert HELD_S * 1e3 < ami_treal(robots[0]) < HELD_S * 1e3 + 1000.0
    forget_programs()
    assert [motion.code for motion in motions] == [EVENT_STOP] * n


def test_an_arm_waits_for_another_one_that_moves_for_long() -> None:
    first, second = offline(), offline()
    ready = new_sem("ready", value=False)
    move(
        first, joint_pos(first, "away", AWAY), MOV_NOTIFY,
        lambda event, _: MOVE_STOP if event == EVENT_DEQ and sem_take(ready) == ERROR else OK, 0,
    )  # fmt: skip
    give = (MOV_DONEPROC, lambda _robot, _motion: sem_give(ready))
    move(second, joint_pos(second, "away", AWAY), MOV_TIME, 1000 * HELD_S + 5000, *give, 0)
    arcl_wait(first)
    assert np.allclose(first.joints, AWAY)


def fails(*_arguments):
    raise ZeroDivisionError("division")


def answers_junk(*_arguments):
    return "banana"


@pytest.mark.parametrize(
    ("handler", "attribute", "function", "where_to"),
    [
        (fails, MOV_DONEPROC, fails, (999.0, *PARK[1:])),
        (answers_junk, MOV_DONEPROC, fails, (999.0, *PARK[1:])),
        (None, MOV_DONEPROC, fails, AWAY),
        (None, MOV_NOTIFY, answers_junk, AWAY),
    ],
)
def test_what_the_last_call_back_raises_is_raised_once_and_then_the_arm_is_given_up(
    handler, attribute, function, where_to
) -> None:
    rp = offline()
    arcl_errproc(handler)
    move(rp, joint_pos(rp, "goal", where_to), attribute, function, 0)
    with pytest.raises((ZeroDivisionError, MotionError), match=r"division|not 'banana'"):
        arcl_wait(rp)
    for call in (lambda: arcl_wait(rp), lambda: move(rp, joint_pos(rp, "home", PARK), 0), lambda: stop(rp)):
        with pytest.raises(MotionError, match=r"was given up after .* call arcl_open"):
            call()
    arcl_close(rp)


@pytest.mark.parametrize(
    ("call", "error"),
    [
        (lambda _: move(None, None, 0), "move: a robot is needed"),
        (lambda _: arcl_close(5), "arcl_close: a robot"),
        (lambda _: ami_treal(5), "ami_treal: a robot"),
        (lambda rp: arcl_wait(rp, 5), "arcl_wait: a function"),
        (lambda rp: gripper(rp, GRIP_OPEN_BY), "needs millimetres"),
        (lambda rp: gripper(rp, GRIP_OPEN_BY, -5), "needs millimetres"),
        (lambda rp: gripper(rp, GRIP_OPEN_BY, float("nan")), "needs millimetres"),
        (lambda rp: gripper(rp, GRIP_CLOSE_BY, True), "needs millimetres"),
        (lambda rp: gripper(rp, GRIP_OPEN, 5), "takes no value"),
        (lambda rp: gripper(rp, GRIP_OPEN, "foo"), "takes no value"),
        (lambda rp: move(rp, robot_pos(rp, "park"), MOV_TACC, 1e9, 0), "at most 60000 ms"),
        (lambda rp: new_iod(rp, IOD_OUT, "a", 1), "numbers of lines"),
        (lambda rp: new_iod(rp, IOD_OUT, 1, 1.5), "numbers of lines"),
        (lambda rp: new_iod(rp, IOD_OUT, 1, 0), "1 line or more, not 0"),
        (lambda _: new_iod(None, IOD_OUT, 1), "new_iod: a robot is needed"),
        (lambda rp: move(rp, robot_pos(rp, "park"), 0, MOV_TACC, 5), "move: MOV_TACC stands behind the end"),
        (lambda rp: teach(rp, 5), "teach: a function is needed"),
        (lambda rp: named_iod(rp, 5), "named_iod: a name of the deployment file"),
        (lambda _: named_iod(5, "lamps"), "named_iod: a robot"),
        (lambda _: iod_value(5), "iod_value: an IO descriptor"),
        (lambda _: arcl_open(ARCL_AMI, "offline", ARCL_ROBOT, 5), "ARCL_ROBOT: a name"),
        (lambda _: arcl_open(ARCL_AMI, "offline", ARCL_PERIOD, "x"), "ARCL_PERIOD: a number"),
        (lambda _: offline(start=(999.0, 0.0, 0.0, 0.0, 0.0, 0.0)), r"ARCL_START: joint 1 \(waist\)"),
    ],
)
def test_an_argument_that_cannot_be_is_told_by_the_call_that_got_it(call, error: str) -> None:
    rp = offline()
    with pytest.raises(MotionError, match=error):
        call(rp)
    with pytest.raises(ConfigError, match=r"no signal 'lamps', nor any other: name them by \[\[arm.signals\]\]"):
        named_iod(rp, "lamps")
    with pytest.raises(ConfigError, match="no teach pendant; start the program with `qrobot run`"):
        teach(rp, print)
    pendant = use_machine(MachineChoice("offline", None, None, (), print))
    with pendant, pytest.raises(MotionError, match="inside the program, and no teach pendant reaches it"):
        teach(rp, print)
    gripper(rp, GRIP_OPEN, 0)
    arcl_close(rp)


def test_a_time_too_short_is_as_long_as_the_arm_needs_and_an_error_only_with_a_transition_that_was_said() -> None:
    rp = offline()
    short = move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 1, 0)
    arcl_wait(rp)
    assert short.code == EVENT_DONE
    assert 500.0 < ami_treal() < 1500.0
    first = move(rp, joint_pos(rp, "park", PARK), MOV_TACC, 0, MOV_TIME, 1, 0)
    move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 1, 0)
    with pytest.raises(MotionError, match=r"give the transition \d+ ms or more"):
        arcl_wait(rp)
    assert first.code == EVENT_ERROR
