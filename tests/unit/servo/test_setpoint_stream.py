"""Following setpoints: what a frame has to satisfy, what a missing one becomes, when a stream is lost."""

from __future__ import annotations

import math

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.model.stiction_compensation import REST_SHARE
from qrobot.servo.kernels.interpolation_polynomials import FORMS, QUINTIC, Form
from qrobot.servo.kernels.interpolator import PEAK_SLOPE
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.stages.setpoint_stream import PLAYOUT_FRAMES, SILENCE_MARGIN, longest_silence
from tests.support.servo_bench import FRAME_NS, Floats, Program, ServoBench, changes, cruise, moving, play, swing

FRAME_S = FRAME_NS * 1e-9
OUT_AND_BACK = np.array([0.3, -0.2, 0.4, 0.5, -0.5, 0.6])
V_MAX, A_MAX = load_robot("puma560").limits.v_max, load_robot("puma560").limits.a_max
DELAY_FRAMES = PLAYOUT_FRAMES + QUINTIC.delay_frames


def continuous(bench: ServoBench, rows: Rows) -> bool:
    """No step of the driven reference beyond v_max T, and none of its velocity beyond what 3 a_max make of a tick."""
    dt = bench.settings.period_ns * 1e-9
    rows = rows[rows["mode"] >= Mode.HOLDING]
    steps = np.abs(np.diff(rows["q_ref"], axis=0))
    bends = np.abs(np.diff(rows["v_ref"], axis=0))
    limits = bench.robot.limits
    return bool(np.all(steps <= limits.v_max * dt * 1.0001) and np.all(bends <= 3.0 * limits.a_max * dt + 1e-9))


def stopped(bench: ServoBench, seconds: float = 3.0) -> None:
    """Run until a stop has ended in HOLDING."""
    bench.until(lambda: bench.mode is Mode.STOPPING, seconds)
    bench.until(lambda: bench.mode is Mode.HOLDING, seconds)


# ------------------------------------------------------------------------------------------------------ good streams


@pytest.mark.parametrize("rate_hz", [1000.0, 4000.0])
@pytest.mark.parametrize("period_ms", [1, 28, 100])
def test_the_reference_is_the_path_two_and_a_half_frames_late(period_ms: int, rate_hz: float) -> None:
    bench = ServoBench(rate_hz=rate_hz).hold()
    period_s = period_ms * 1e-3
    program = play(bench, swing(bench.q, OUT_AND_BACK, 1.6), period_ns=period_ms * 1_000_000)
    bench.run(1.0)
    rows = bench.rows()
    rows = rows[rows["t_ns"] > program.start_ns + int((DELAY_FRAMES + 1) * period_s * 1e9)]
    late_s = (rows["t_ns"] - program.start_ns) * 1e-9 - DELAY_FRAMES * period_s
    wanted = np.array([program.path(t) for t in late_s])
    assert np.abs(rows["q_ref"] - wanted).max() <= 0.5 * period_s**2  # what interpolation makes of a swing
    assert bench.mode is Mode.TRACKING
    assert bench.snapshot.missed_frames == 0
    assert continuous(bench, rows)


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_every_form_follows_the_path_as_many_frames_late_as_it_says(form: Form) -> None:
    bench = ServoBench(interpolation=form.name).hold()
    program = play(bench, cruise(bench.q, 0.3 * OUT_AND_BACK))
    bench.run(1.0)
    late_s = (bench.rows()["t_ns"] - program.start_ns) * 1e-9 - (PLAYOUT_FRAMES + form.delay_frames) * FRAME_S
    wanted = np.array([program.path(t) for t in late_s])
    np.testing.assert_allclose(bench.rows()["q_ref"][-300:], wanted[-300:], atol=1e-9)  # a straight line by now


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_in_every_form_a_lost_stream_stops_on_the_line_it_was_on(form: Form) -> None:
    bench = ServoBench(interpolation=form.name).hold()
    start, velocity = bench.q.copy(), np.array([0.8, -0.4, 0.6, 0.3, -0.5, 0.9])
    play(bench, cruise(start, velocity), last=30)
    stopped(bench)
    rows = bench.rows()
    moved = rows["q_ref"] - start
    np.testing.assert_allclose(moved, np.outer(moved[:, 0] / velocity[0], velocity), atol=1e-9)
    stop = rows[rows["mode"] == Mode.STOPPING]
    assert np.all(np.diff(np.abs(stop["v_ref"][:, 0])) <= 1e-9)
    assert np.abs(stop["a_ref"]).max(axis=0) == pytest.approx(
        PEAK_SLOPE * np.abs(velocity) / (len(stop) * bench.settings.period_ns * 1e-9), rel=0.02
    )


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_in_every_form_a_torque_joint_goes_on_from_where_it_is(form: Form) -> None:
    bench = ServoBench(interpolation=form.name).hold()

    def edit(seq: int, modes: list[int], values: np.ndarray) -> None:
        modes[5] = 2 if 5 < seq < 20 else 1
        values[5] = 0.5 if 5 < seq < 20 else bench.q[5]

    play(bench, swing(bench.q, 0.0 * OUT_AND_BACK, 2.0), edit=edit)
    bench.run(0.2)
    bench.follows = False
    before = bench.q.copy()
    bench.before.append(lambda now_ns: bench.q.__setitem__(5, before[5] + 0.2 * (now_ns - began_ns) * 1e-9))
    began_ns = bench.now_ns
    bench.until(lambda: bench.state.joint_modes[5] == 1)
    rows = bench.rows()[-2:]
    assert abs(np.diff(rows["q_ref"][:, 5])[0]) < 0.001
    if form.continuity:
        assert rows["v_ref"][-1, 5] == pytest.approx(0.2, rel=0.1)


def test_setpoints_are_reached_exactly_at_frame_boundaries() -> None:
    bench = ServoBench().hold()
    program = play(bench, swing(bench.q, OUT_AND_BACK, 1.6))
    bench.run(1.0)
    rows = bench.rows()
    for seq in range(1, 30):
        due_ns = program.due_ns(seq) + int(DELAY_FRAMES * FRAME_NS)
        row = rows[rows["t_ns"] == due_ns][0]
        np.testing.assert_allclose(row["q_ref"], program.path(seq * FRAME_S), atol=1e-12)


def test_a_stream_that_stands_still_changes_nothing() -> None:
    bench = ServoBench().hold()
    before = bench.q.copy()
    play(bench, lambda _t: before)
    bench.run(0.5)
    assert bench.mode is Mode.TRACKING
    np.testing.assert_array_equal(bench.snapshot.q_setpoint, before)


def test_frames_that_hold_every_joint_do_not_start_a_stream() -> None:
    bench = ServoBench().hold()
    play(bench, lambda _t: bench.q, edit=lambda _seq, modes, _values: modes.__setitem__(slice(None), [0] * 6))
    bench.run(0.5)
    assert bench.mode is Mode.HOLDING
    assert bench.event is FaultCode.NONE


def test_a_joint_not_spoken_of_stays_while_the_others_move() -> None:
    bench = ServoBench().hold()
    start = bench.q.copy()

    def only_the_first(_seq: int, modes: list[int], values: np.ndarray) -> None:
        modes[1:] = [0] * 5
        values[1:] = math.nan

    play(bench, swing(bench.q, OUT_AND_BACK, 2.0), edit=only_the_first)
    bench.run(1.0)
    assert bench.mode is Mode.TRACKING
    assert abs(bench.snapshot.q_setpoint[0] - start[0]) > 0.2
    np.testing.assert_array_equal(bench.snapshot.q_setpoint[1:], start[1:])


# --------------------------------------------------------------------------------------- missing, late, double frames


@pytest.mark.parametrize("seq", [8, 20, 33])
def test_one_missing_frame_is_bridged_and_counted(seq: int) -> None:
    bench = ServoBench().hold()
    play(bench, swing(bench.q, 0.5 * OUT_AND_BACK, 1.6), dropped={seq})
    bench.run(1.5)
    assert bench.mode is Mode.TRACKING
    assert bench.snapshot.missed_frames == 1
    assert continuous(bench, bench.rows())


def test_a_missing_frame_at_constant_velocity_leaves_no_trace_in_the_reference() -> None:
    lossy, whole = ServoBench(), ServoBench()
    moving(lossy, dropped={22})
    moving(whole)
    assert lossy.snapshot.missed_frames == 1
    np.testing.assert_allclose(lossy.rows()["q_ref"], whole.rows()["q_ref"], atol=1e-12)


def test_every_other_frame_missing_is_still_no_loss_of_the_stream() -> None:
    bench = ServoBench()
    moving(bench, seconds=1.4, dropped=set(range(21, 60, 2)))
    assert bench.snapshot.missed_frames > 10


def test_a_frame_sent_twice_counts_once() -> None:
    twice, once = ServoBench(), ServoBench()
    program = moving(once)
    program = moving(twice, seconds=0.4)
    twice.before.append(lambda now: program.sent_ns == now and program.send(program.seq - 1, now))
    twice.run(0.4)
    np.testing.assert_array_equal(twice.rows()["q_ref"], once.rows()["q_ref"])
    assert twice.mode is Mode.TRACKING


def test_two_frames_in_the_wrong_order_count_as_one_missing() -> None:
    bench = ServoBench()
    program = moving(bench, seconds=0.4, dropped={20})
    bench.until(lambda: program.seq == 22)
    program.send(20, bench.now_ns)
    bench.run(0.4)
    assert bench.mode is Mode.TRACKING
    assert bench.snapshot.missed_frames == 1
    assert continuous(bench, bench.rows())


def test_a_frame_that_is_late_by_less_than_half_a_frame_is_not_missed() -> None:
    bench = ServoBench()
    moving(bench, seconds=1.2, delayed={20: 0.45 * FRAME_S, 27: 0.3 * FRAME_S, 28: 0.1 * FRAME_S})
    assert bench.snapshot.missed_frames == 0
    assert continuous(bench, bench.rows())


def test_jitter_of_a_third_of_a_frame_disturbs_the_velocity_by_less_than_two_percent() -> None:
    bench = ServoBench()
    random = np.random.default_rng(7)
    delays = {seq: float(random.uniform(0.0, FRAME_S / 3)) for seq in range(16, 200)}
    moving(bench, speed=0.5, seconds=2.4, delayed=delays)
    assert bench.snapshot.missed_frames == 0
    settled = bench.rows()["v_ref"][-1500:, 0]
    assert np.abs(settled / 0.5 - 1.0).max() < 0.02


@pytest.mark.parametrize("skew", [-0.01, 0.01])
def test_a_clock_skew_of_one_percent_is_followed_without_a_stop_or_ripple(skew: float) -> None:
    bench = ServoBench()
    moving(bench, speed=0.3, seconds=4.5, skew=skew)
    assert bench.snapshot.missed_frames == 0
    late = bench.rows()["v_ref"][-2000:, 0]
    assert np.mean(late) == pytest.approx(0.3 / (1.0 + skew), rel=1e-3)
    assert np.ptp(late) / 0.3 < 0.02


# --------------------------------------------------------------------------------------------------------- the end


@pytest.mark.parametrize("rate_hz", [1000.0, 4000.0])
@pytest.mark.parametrize("last", [25, 26, 27])
def test_a_stop_begins_two_frames_and_the_margin_after_the_last_frame(last: int, rate_hz: float) -> None:
    bench = ServoBench(rate_hz=rate_hz)
    program = moving(bench, seconds=0.6, last=last)
    bench.until(lambda: bench.mode is Mode.STOPPING)
    assert bench.event is FaultCode.STREAM_LOST
    silence_ns = bench.now_ns - bench.settings.period_ns - program.sent_ns
    assert 0 < silence_ns - (2 + SILENCE_MARGIN) * FRAME_NS <= bench.settings.period_ns


@pytest.mark.parametrize("refused", [False, True])
def test_what_ended_or_refused_a_stream_stands_until_the_next_one_plays_so_that_it_can_be_told_again(
    refused: bool,
) -> None:
    bench = ServoBench().hold()
    q, code = bench.q.copy(), FaultCode.START_POSE if refused else FaultCode.STREAM_LOST
    for stream in range(1, 4):
        away = 1.0 if refused else 0.0  # of each joint: no stream may begin so far from the reference
        play(bench, lambda _t, at=q + away: at.copy(), stream=2 * stream, last=5)
        bench.run(0.5)
        assert (bench.mode, bench.event) == (Mode.HOLDING, code)
        play(bench, lambda _t: q.copy(), stream=2 * stream + 1, last=20)
        bench.until(lambda: bench.mode is Mode.TRACKING)
        assert bench.event is FaultCode.NONE
        bench.until(lambda: bench.mode is Mode.HOLDING)
    told = bench.rows()["fault"]
    begun = np.flatnonzero((told[1:] == code) & (told[:-1] != code))
    assert len(begun) == (3 if refused else 6)


# ------------------------------------------------------------------------------------- jitter, loss and stalls together


class Stream:
    """How frames reach the servo: each up to `jitter` of a period late, of which some are lost, and none overtakes."""

    def __init__(self, jitter: float, seed: int, frames: int = 80) -> None:
        self.random = np.random.default_rng(seed)
        self.delays = {seq: float(self.random.uniform(0.0, jitter)) * FRAME_S for seq in range(frames)}

    def single_losses(self) -> set[int]:
        """Frames lost one at a time, on average every sixth."""
        lost = np.cumsum(self.random.integers(2, 10, 12)) + 3
        return {int(seq) for seq in lost}


@pytest.mark.parametrize("seed", range(3))
def test_jitter_of_a_quarter_of_a_period_and_single_losses_never_stop_the_arm(seed: int) -> None:
    stream = Stream(SILENCE_MARGIN, seed)
    bench = ServoBench(rate_hz=[1000.0, 4000.0][seed % 2]).hold()
    lost = stream.single_losses()
    play(bench, swing(bench.q, 0.5 * OUT_AND_BACK, 1.6), delayed=stream.delays, dropped=lost)
    bench.run(1.7)
    assert (bench.mode, bench.event) == (Mode.TRACKING, FaultCode.NONE)
    assert bench.snapshot.missed_frames == len([seq for seq in lost if seq <= bench.snapshot.setpoint_seq]) > 5
    assert continuous(bench, bench.rows())


@pytest.mark.parametrize("lost", [1, 2, 3, 12, 13, 25, 31, 40])
def test_a_frame_one_tick_late_after_a_lost_one_is_in_time(lost: int) -> None:
    """The next frame is due two periods after the last one that came: at the limit, would there be no margin."""
    bench = ServoBench().hold()
    delays = dict.fromkeys(range(lost + 1, 99), 1.1e-3)
    play(bench, swing(bench.q, OUT_AND_BACK, 1.6), dropped={lost}, delayed=delays)
    bench.run(1.4)
    assert (bench.mode, bench.event) == (Mode.TRACKING, FaultCode.NONE)
    assert bench.snapshot.missed_frames == 1


@pytest.mark.parametrize("seed", range(4))
def test_two_frames_lost_in_a_row_always_stop_the_arm_in_time(seed: int) -> None:
    stream = Stream(SILENCE_MARGIN, seed)
    bench = ServoBench().hold()
    first = int(stream.random.integers(8, 30))
    play(bench, swing(bench.q, OUT_AND_BACK, 1.6), delayed=stream.delays, dropped={first, first + 1})
    bench.until(lambda: bench.mode is Mode.STOPPING)
    assert bench.event is FaultCode.STREAM_LOST
    arrived_ns = bench.state.last_arrival_ns
    assert bench.now_ns - arrived_ns <= longest_silence(FRAME_NS, bench.settings.period_ns) + 2e6
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert continuous(bench, bench.rows())


@pytest.mark.parametrize(("stall", "stops"), [(0.9, False), (1.1, False), (1.5, True), (3.0, True)])
def test_a_sender_that_stalls_stops_the_arm_when_it_is_late_by_more_than_a_period_and_a_quarter(
    stall: float, stops: bool
) -> None:
    """A stall of s periods: the frame due in it arrives s late, those behind it at once."""
    bench = ServoBench().hold()
    delays = {seq: max(0.0, stall - (seq - 30)) * FRAME_S for seq in range(30, 36)}
    play(bench, swing(bench.q, OUT_AND_BACK, 2.4), delayed=delays)
    bench.run(1.5)
    assert (bench.event is FaultCode.STREAM_LOST) == stops
    assert bench.mode is (Mode.HOLDING if stops else Mode.TRACKING)
    assert continuous(bench, bench.rows())


@pytest.mark.sampled(10)
@pytest.mark.parametrize("share", [0.7, 1.09])
@pytest.mark.parametrize("lost", range(6, 26))
def test_no_frame_of_a_motion_that_turns_at_once_stops_the_arm_when_it_is_lost(lost: int, share: float) -> None:
    """Hard acceleration one way, then the other: the knot in place of the lost one bends the path three times too much.

    So does the end of the way back, where the stream goes on with all the acceleration it may ask for.
    """
    bench = ServoBench().hold()
    start, a = bench.q.copy(), share * bench.robot.limits.a_max * np.array([1, -1, 1, 1, -1, 1])
    steps = np.tile([1.0, -1.0, -1.0, 1.0], 20)  # second differences in a_max T^2: out, and back to where it began
    places = np.concatenate([np.zeros(6), np.cumsum(np.cumsum(steps))]) * FRAME_S**2

    def path(t: float) -> Floats:
        return start + a * places[round(t / FRAME_S)]

    play(bench, path, dropped={lost})
    bench.run(1.0)
    assert (bench.mode, bench.event) == (Mode.TRACKING, FaultCode.NONE)


@pytest.mark.parametrize("period_ms", [1, 2, 5, 100])
def test_one_lost_frame_stops_no_stream_of_any_period(period_ms: int) -> None:
    bench = ServoBench(rate_hz=4000.0 if period_ms < 5 else 1000.0).hold()
    play(bench, swing(bench.q, 0.3 * OUT_AND_BACK, 1.6), period_ns=period_ms * 1_000_000, dropped={5})
    bench.run(0.7)
    assert (bench.mode, bench.snapshot.missed_frames) == (Mode.TRACKING, 1)


def test_a_lost_stream_ends_on_the_path_without_any_step() -> None:
    bench = ServoBench().hold()
    start, velocity = bench.q.copy(), np.array([0.8, -0.4, 0.6, 0.3, -0.5, 0.9])
    play(bench, cruise(start, velocity), last=30)
    stopped(bench)
    rows = bench.rows()
    assert continuous(bench, rows)
    moved = rows["q_ref"] - start
    share = moved[:, 0] / velocity[0]
    np.testing.assert_allclose(moved, np.outer(share, velocity), atol=1e-9)  # a straight line in joint space
    assert np.all(np.diff(share) >= -1e-6)  # the interpolator takes a tiny swing before it starts


def test_a_stop_decelerates_no_joint_harder_than_a_stop() -> None:
    bench = ServoBench()
    moving(bench, speed=1.0, joint=1, last=20, seconds=0.5)
    stopped(bench)
    rows = bench.rows()
    stop = rows[rows["mode"] == Mode.STOPPING]
    assert np.abs(stop["a_ref"][:, 1]).max() <= bench.robot.guard.a_stop[1] * 1.0001
    seconds = len(stop) * bench.settings.period_ns * 1e-9
    assert seconds == pytest.approx(PEAK_SLOPE * 1.0 / bench.robot.guard.a_stop[1], abs=2e-3)


def test_a_stop_in_the_middle_of_a_curve_stays_on_the_curve() -> None:
    bench = ServoBench().hold()
    path = swing(bench.q, OUT_AND_BACK, 3.0)
    play(bench, path, last=40)
    stopped(bench)
    rows = bench.rows()
    assert continuous(bench, rows)
    curve = np.array([path(t) for t in np.arange(0.0, 1.5, 2e-4)])
    distance = [np.abs(curve - q).max(axis=1).min() for q in rows["q_ref"][::10]]
    assert max(distance) < 0.02  # past the last setpoint the path goes on straight


def test_after_a_stop_the_old_stream_is_not_followed_any_more() -> None:
    bench = ServoBench()
    program = moving(bench, dropped={28, 29, 30, 31})
    stopped(bench)
    assert program.seq < 60
    bench.run(1.0)
    assert bench.mode is Mode.HOLDING


def test_a_new_stream_from_where_the_arm_stands_is_followed_again() -> None:
    bench = ServoBench()
    program = moving(bench, last=25, seconds=0.7)
    stopped(bench)
    bench.before.remove(program.step)
    play(bench, swing(bench.snapshot.q_setpoint, 0.3 * OUT_AND_BACK, 1.0), stream=2)
    bench.run(0.5)
    assert bench.mode is Mode.TRACKING
    assert continuous(bench, bench.rows())


def test_a_bunch_of_frames_after_a_silence_finds_the_arm_stopped_and_is_not_followed() -> None:
    bench = ServoBench()
    program = moving(bench, last=24, seconds=0.68)
    bench.until(lambda: bench.now_ns >= program.sent_ns + 120_000_000)
    for seq in range(24, 29):
        program.send(seq, bench.now_ns)
    bench.run(0.5)
    assert bench.mode is Mode.HOLDING
    assert list(changes(bench.rows()))[-2:] == [(Mode.TRACKING, Mode.STOPPING), (Mode.STOPPING, Mode.HOLDING)]


@pytest.mark.parametrize("waiting", [(2,), (1, 2), (2, 3)])
def test_a_stop_request_during_a_stop_also_ends_the_streams_that_wait_for_its_end(waiting: tuple[int, ...]) -> None:
    bench = ServoBench().hold()
    moving(bench)
    bench.mailbox.request_stop()
    bench.until(lambda: bench.mode is Mode.STOPPING)
    program = Program(bench, lambda _t: bench.snapshot.q_setpoint + 1e-3, stream=0)
    bench.run(0.01)
    for program.stream in waiting:  # whoever sends them has died before the arm has come to rest
        program.send(0, bench.now_ns)
    bench.mailbox.request_stop()
    bench.until(lambda: bench.mode is Mode.HOLDING)
    end = bench.snapshot.q_setpoint.copy()
    for seq in (1, 2, 3):
        program.send(seq, bench.now_ns)
        bench.run(0.028)
    assert bench.mode is Mode.HOLDING
    np.testing.assert_array_equal(bench.snapshot.q_setpoint, end)


def test_a_stop_request_while_holding_also_ends_the_stream_that_was_about_to_begin() -> None:
    bench = ServoBench().hold()
    play(bench, swing(bench.q, OUT_AND_BACK, 2.0))
    bench.tick(5)
    bench.mailbox.request_stop()
    bench.run(0.5)
    assert bench.mode is Mode.HOLDING


# --------------------------------------------------------------------------------------------------- refused setpoints


def refused(bench: ServoBench, change: float, seq: int = 28, joint: int = 0) -> None:
    """Track, then get one bad value."""

    def edit(at: int, _modes: list[int], values: np.ndarray) -> None:
        if at == seq:
            values[joint] = change if not math.isfinite(change) or abs(change) > 3 else values[joint] + change

    moving(bench, edit=edit, seconds=0.7)
    bench.until(lambda: bench.mode is Mode.STOPPING)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (math.nan, FaultCode.SP_INVALID),
        (math.inf, FaultCode.SP_INVALID),
        (-math.inf, FaultCode.SP_INVALID),
        (1e300, FaultCode.SP_LIMIT),
        (-1e300, FaultCode.SP_LIMIT),
        (0.05, FaultCode.SP_STEP),
        (-0.05, FaultCode.SP_STEP),
    ],
)
def test_a_bad_setpoint_stops_the_arm_on_the_path_and_never_shows_in_the_reference(
    change: float, code: FaultCode
) -> None:
    bench = ServoBench()
    refused(bench, change)
    assert bench.event is code
    assert bench.snapshot.event_joint == 0
    bench.until(lambda: bench.mode is Mode.HOLDING)
    rows = bench.rows()
    assert continuous(bench, rows)
    assert np.all(np.diff(rows["q_ref"][:, 0]) >= -1e-6)  # it was going forward all the time


def test_a_program_that_drives_into_the_end_of_the_range_is_stopped_inside_it() -> None:
    bench = ServoBench()
    bench.q[0] = bench.robot.limits.q_max[0] - 0.25
    bench.hold()
    play(bench, cruise(bench.q, np.array([0.6, 0, 0, 0, 0, 0])))
    bench.until(lambda: bench.mode is Mode.STOPPING)
    assert bench.event is FaultCode.SP_LIMIT
    bench.until(lambda: bench.mode is Mode.HOLDING)
    rows = bench.rows()
    assert rows["q_ref"][:, 0].max() <= bench.robot.limits.q_max[0] + bench.robot.guard.range_margin[0]
    stop = rows[rows["mode"] == Mode.STOPPING]
    assert np.abs(stop["v_ref"][:, 0]).max() <= 0.6 * 1.05
    assert continuous(bench, rows)


def test_a_program_that_still_gathers_speed_at_the_end_of_the_range_is_stopped_inside_it() -> None:
    bench, joint = ServoBench(), 3
    end, v_max, a_max = (limit[joint] for limit in (bench.robot.limits.q_max, V_MAX, A_MAX))
    bench.q[joint] = end - 0.4
    bench.hold()
    places, v = [bench.q.copy() for _ in range(3)], 0.0
    while places[-1][joint] < end + 0.5:
        fastest = 0.3 if places[-1][joint] < end - 0.2 else v_max
        v = min(fastest, v + a_max * FRAME_S)
        places.append(places[-1] + np.eye(6)[joint] * v * FRAME_S)
    play(bench, lambda t: places[min(round(t / FRAME_S), len(places) - 1)])
    stopped(bench)
    assert bench.event is FaultCode.SP_LIMIT
    assert bench.rows()["q_ref"][:, joint].max() <= end


@pytest.mark.parametrize(
    ("joint", "period_s", "short_of_end", "hardest"),
    [
        (5, 0.1, 0.07, 2.0),  # goes on far beyond the range, which is seen at once
        (4, 0.028, 0.057, 10.0),  # just beyond, and turns back too late, which is seen a frame later
    ],
)
def test_an_arm_that_turns_back_at_the_end_of_its_range_is_stopped_inside_it_when_that_frame_is_lost(
    joint: int, period_s: float, short_of_end: float, hardest: float
) -> None:
    robot = ServoBench().robot
    end, step, change = robot.limits.q_max[joint], V_MAX[joint] * period_s, A_MAX[joint] * period_s**2
    if period_s < 0.1:
        step = short_of_end + 0.009
    steps = [0.0, 0.0, 0.0]
    while steps[-1] < step:
        steps.append(min(step, steps[-1] + change))
    turn = len(steps)
    while steps[-1] > -step:
        steps.append(max(-step, steps[-1] - change))
    while steps[-1] < 0.0:
        steps.append(min(0.0, steps[-1] + change))
    way = np.cumsum([*steps, 0.0])
    for lost in (set[int](), {turn}):
        bench = ServoBench()
        bench.q[joint] = end - short_of_end - way[turn - 1]
        start = bench.hold().q.copy()
        places = start + np.outer(way, np.eye(6)[joint])
        play(bench, lambda t: places[min(round(t / period_s), len(places) - 1)],  # noqa: B023
             period_ns=round(period_s * 1e9), dropped=lost)  # fmt: skip
        bench.run((len(places) + 3) * period_s)
        assert (bench.mode, bench.event) == (
            (Mode.HOLDING, FaultCode.STREAM_LOST) if lost else (Mode.TRACKING, FaultCode.NONE)
        )
        assert bench.rows()["q_ref"][:, joint].max() <= end + robot.guard.range_margin[joint]
        stop = bench.rows()[bench.rows()["mode"] == Mode.STOPPING]
        assert np.abs(stop["a_ref"][:, joint]).max(initial=0.0) <= hardest * robot.guard.a_stop[joint]


@pytest.mark.parametrize("offset", [0.021, -0.5, math.nan])
def test_a_stream_that_does_not_begin_where_the_arm_stands_is_refused(offset: float) -> None:
    bench = ServoBench().hold()
    before = bench.snapshot.q_setpoint.copy()
    shifted = bench.q.copy()
    shifted[2] += offset
    program = play(bench, lambda _t: shifted)
    bench.run(0.5)
    assert bench.mode is Mode.HOLDING
    assert (bench.event, bench.snapshot.event_joint) == (FaultCode.START_POSE, 2)
    np.testing.assert_array_equal(bench.snapshot.q_setpoint, before)
    bench.before.remove(program.step)
    play(bench, lambda _t: before, stream=2)
    bench.run(0.2)
    assert bench.mode is Mode.TRACKING


@pytest.mark.parametrize("period_ns", [0, -28_000_000, 999_999, 100_000_001])
def test_a_stream_of_an_impossible_period_is_refused(period_ns: int) -> None:
    bench = ServoBench().hold()
    bench.mailbox.push_setpoint(1, 0, bench.now_ns, period_ns, [1] * 6, bench.q)
    bench.run(0.3)
    assert bench.mode is Mode.HOLDING
    assert bench.event is FaultCode.SP_INVALID


def test_a_stream_that_changes_its_period_on_the_way_is_stopped() -> None:
    bench = ServoBench()
    program = moving(bench, seconds=0.6)
    program.period_ns = 2 * FRAME_NS  # says so in each frame from now on
    program.start_ns -= program.seq * FRAME_NS
    bench.until(lambda: bench.mode is Mode.STOPPING)
    assert bench.event is FaultCode.SP_INVALID


@pytest.mark.parametrize("mode", [3, -1])
def test_a_mode_that_there_is_not_is_refused_and_moves_nothing(mode: int) -> None:
    """The wire refuses it; here somebody has spoilt the words of the queue."""
    bench = ServoBench().hold()
    before = bench.snapshot.q_setpoint.copy()
    bench.mailbox.push_setpoint(1, 0, bench.now_ns, FRAME_NS, [mode, 0, 0, 0, 0, 0], before + 0.5)
    bench.run(0.3)
    assert (bench.mode, bench.event) == (Mode.HOLDING, FaultCode.SP_INVALID)
    np.testing.assert_array_equal(bench.snapshot.q_setpoint, before)


@pytest.mark.parametrize("mode", [3, -1])
def test_a_mode_that_there_is_not_ends_the_stream_on_its_path(mode: int) -> None:
    bench = ServoBench()

    def edit(at: int, modes: list[int], values: np.ndarray) -> None:
        if at == 28:
            modes[0], values[0] = mode, values[0] + 0.5

    moving(bench, speed=0.5, edit=edit, seconds=0.7)
    bench.until(lambda: bench.mode is Mode.STOPPING)
    assert bench.event is FaultCode.SP_INVALID
    begun = bench.snapshot.q_setpoint[0]
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert abs(bench.snapshot.q_setpoint[0] - begun) < 0.2


# ------------------------------------------------------------------------------------------------------ torque joints


def torque_program(bench: ServoBench, torque: float, joint: int = 0, **options: object):
    """Joint in torque mode; the others hold their place."""
    here = bench.snapshot.q_setpoint.copy()

    def edit(_seq: int, modes: list[int], values: np.ndarray) -> None:
        modes[joint], values[joint] = 2, torque

    return play(bench, lambda _t: here.copy(), **({"edit": edit} | options))


@pytest.mark.parametrize(("torque", "friction"), [(7.5, 13.58), (-7.5, -7.65), (0.0, 0.0)])
def test_a_torque_setpoint_comes_on_top_of_what_carries_the_arm_with_friction_of_its_direction(
    torque: float, friction: float
) -> None:
    """The Coulomb friction of a standing shoulder, each way, and viscous friction at the speed that stands for it."""
    bench = ServoBench().hold()
    bench.run(0.3)
    carrying = bench.snapshot.tau.copy()
    torque_program(bench, torque, joint=1)
    bench.run(0.3)
    assert bench.mode is Mode.TRACKING
    added = REST_SHARE * (friction + np.sign(torque) * 9.497 * bench.robot.control.friction_velocity[1])
    np.testing.assert_allclose(bench.snapshot.tau - carrying, [0, torque + added, 0, 0, 0, 0], atol=1e-9)


@pytest.mark.parametrize(("torque", "code"), [(1e6, FaultCode.SP_LIMIT), (math.nan, FaultCode.SP_LIMIT)])
def test_an_impossible_torque_setpoint_stops_the_arm(torque: float, code: FaultCode) -> None:
    bench = ServoBench().hold()
    torque_program(bench, torque)
    bench.until(lambda: bench.mode is Mode.STOPPING)
    assert bench.event is code


def test_a_torque_joint_is_followed_wherever_it_goes_and_held_there_when_the_stream_ends() -> None:
    bench = ServoBench().hold()
    start = bench.q.copy()
    bench.before.append(lambda _now: bench.mode is Mode.TRACKING and bench.q.__setitem__(0, bench.q[0] + 2e-4))
    torque_program(bench, 1.0, last=20)
    bench.run(0.5)
    assert bench.mode is Mode.TRACKING
    assert bench.q[0] - start[0] > 0.08
    stopped(bench)
    rows = bench.rows()
    assert continuous(bench, rows[rows["mode"] == Mode.STOPPING])
    assert np.abs(np.diff(rows["q_ref"][3:, 0])).max() < 3e-4
    assert bench.snapshot.q_setpoint[0] >= start[0] + 0.08
    bench.run(0.1)
    np.testing.assert_allclose(bench.snapshot.tau[[0, 3, 4, 5]], 0.0, atol=0.5)


@pytest.mark.parametrize("speed", [0.0, 0.1])
def test_a_torque_joint_goes_back_to_position_without_a_bump(speed: float) -> None:
    bench = ServoBench().hold()
    bench.before.append(
        lambda _now: bench.state.joint_modes[0] == 2 and bench.q.__setitem__(0, bench.q[0] + speed * 1e-3)
    )
    goal: list[float] = []

    def edit(seq: int, modes: list[int], values: np.ndarray) -> None:
        if seq < 20:
            modes[0], values[0] = 2, 0.0
            return
        if not goal:
            goal.append(bench.snapshot.q_setpoint[0] + speed * FRAME_S)
        values[0] = goal[0]

    play(bench, swing(bench.q, 0 * OUT_AND_BACK, 1.0), edit=edit)
    bench.run(0.5)
    assert bench.state.joint_modes[0] == 2
    bench.run(0.6)
    assert bench.mode is Mode.TRACKING
    assert bench.state.joint_modes[0] == 1
    rows = bench.rows()
    switched = int(np.flatnonzero(rows["mode"] == Mode.TRACKING)[0]) + 20 * 28 - 5
    assert np.abs(np.diff(rows["q_ref"][switched:, 0])).max() < 1e-3 * max(3.0 * speed, 0.02)
    assert np.abs(rows["tau"][switched:, 0]).max() < 234.0 * 2.0 * speed + 1.0
    assert bench.snapshot.q_setpoint[0] == pytest.approx(goal[0], abs=1e-9)
