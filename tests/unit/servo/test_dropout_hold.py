"""Cycles without a new image: the joints are carried on along their reference, and nothing pushes harder for it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.ident.counters import counter_faults
from qrobot.modecodes import Mode
from qrobot.model.transmission import counts_to_joint
from qrobot.servo.hold import hold_position
from qrobot.servo.kernels.velocity import ESTIMATORS
from qrobot.servo.memory.setpoint_queue import TORQUE_SETPOINT
from qrobot.servo.memory.telemetry import FLAG_UNSEEN
from qrobot.servo.stages.dropout_hold import hold_through_dropout, lose_sight
from tests.support.campaign import PUMA, FastLeg
from tests.support.servo_bench import Floats, ServoBench, cruise, moving, play

WRIST = 5
STALL_S = 0.015
PATIENT_MS = 20.0  # as for an emulated board, which shares the processors

RATES = pytest.mark.parametrize("rate_hz", [1000.0, 4000.0])


def patient(rate_hz: float = 4000.0, velocity: str = "difference") -> ServoBench:
    return ServoBench(rate_hz=rate_hz, velocity=velocity, board_timeout_ms=PATIENT_MS)


def silence(bench: ServoBench, seconds: float) -> Floats:
    """The board publishes nothing for so long; the torques meanwhile. Shape (k, n)."""
    ticks = round(seconds * bench.settings.rate_hz)
    bench.frozen = True
    bench.tick(ticks)
    bench.frozen = False
    return np.asarray(bench.rows()["tau"][-ticks - 1 :])


def counted(bench: ServoBench) -> Floats:
    """Positions by the counters."""
    q = np.zeros(bench.robot.n)
    counts_to_joint(bench.state.counts, bench.params.transmission, q)
    return q


# ----------------------------------------------------------------------------------------------------------- the torque


@RATES
@pytest.mark.parametrize("joint", [0, WRIST])
def test_the_torque_of_a_moving_joint_stays_what_it_was_while_the_board_is_silent(joint: int, rate_hz: float) -> None:
    bench = patient(rate_hz)
    moving(bench, speed=1.0, joint=joint)
    tau = silence(bench, STALL_S)
    wound_up = bench.robot.control.kp[joint] * 1.0 * STALL_S  # positions that stand still
    assert np.abs(tau - tau[0]).max() < 0.03 * wound_up


@RATES
@pytest.mark.parametrize("velocity", [*ESTIMATORS])
def test_nor_does_it_grow_while_the_reference_accelerates(velocity: str, rate_hz: float) -> None:
    bench = patient(rate_hz, velocity)
    moving(bench, speed=1.0, joint=WRIST, seconds=0.25)  # the ramp takes 0.4 s
    acceleration = bench.state.a_ref[WRIST]
    assert acceleration > 3.0
    tau = silence(bench, STALL_S)
    wound_up = bench.robot.control.kv[WRIST] * acceleration * STALL_S  # a velocity that stays, and no more
    assert np.abs(tau - tau[0]).max() < 0.35 * wound_up


def test_an_arm_at_rest_keeps_place_and_torque_to_the_last_bit() -> None:
    bench = patient().hold()
    bench.run(0.2)
    place = bench.snapshot.q.copy()
    tau = silence(bench, STALL_S)
    np.testing.assert_array_equal(tau, tau[:1].repeat(len(tau), axis=0))
    np.testing.assert_array_equal(bench.snapshot.q, place)


@RATES
def test_an_arm_whose_board_is_silent_for_fifteen_milliseconds_goes_on_as_if_nothing_were(rate_hz: float) -> None:
    leg = FastLeg(rate_hz, board_timeout_ms=PATIENT_MS)
    leg.go(0.4)
    outcome = leg.suffer("board frozen +15ms", 8)
    assert outcome.acted > 0
    assert outcome.modes == [Mode.TRACKING]
    rows = outcome.rows
    unseen = rows["flags"] & FLAG_UNSEEN != 0
    assert unseen.sum() == pytest.approx(STALL_S * rate_hz, abs=1)
    change = np.abs(rows["tau"][unseen] - rows["tau"][0]).max(axis=0)
    assert np.all(change < 0.1 * PUMA.guard.tau_max)
    assert np.abs(rows["q_ref"] - rows["q"]).max() < 0.005


# --------------------------------------------------------------------------------------------------------- the position


@RATES
def test_the_position_carried_on_is_where_the_board_finds_the_joint_in_the_end(rate_hz: float) -> None:
    bench = patient(rate_hz)
    moving(bench, speed=1.0, joint=WRIST)
    silence(bench, STALL_S)
    carried = bench.snapshot.q.copy()
    assert carried[WRIST] - counted(bench)[WRIST] == pytest.approx(STALL_S, rel=0.03)
    bench.tick()
    assert bench.snapshot.q[WRIST] - carried[WRIST] == pytest.approx(1.0 / rate_hz, abs=5e-4)
    np.testing.assert_array_equal(bench.snapshot.q, counted(bench))


def test_telemetry_shows_what_the_law_saw_marks_it_and_keeps_the_counts() -> None:
    bench = ServoBench()
    moving(bench, speed=1.0, joint=WRIST)
    silence(bench, 0.003)
    bench.tick(3)
    rows = bench.rows()[-7:]
    assert (rows["flags"] & FLAG_UNSEEN != 0).tolist() == [False, True, True, True, False, False, False]
    assert (np.diff(rows["counts"][:, WRIST]) != 0).tolist() == [False, False, False, True, True, True]
    assert np.all(np.diff(rows["q"][:, WRIST]) > 0.5e-3)


def test_neither_silence_nor_a_glitch_makes_a_recording_that_an_identification_refuses() -> None:
    bench = patient()
    moving(bench, speed=1.0, joint=WRIST)
    silence(bench, STALL_S)
    bench.tick(20)
    bench.slip = {WRIST: 30_000}
    bench.tick(2)
    bench.slip = {}
    bench.tick(20)
    rows = bench.rows()
    assert np.any(rows["flags"] & FLAG_UNSEEN)
    assert counter_faults(PUMA, rows, 1e-9 * bench.params.period_ns) == []


def test_a_joint_held_back_as_a_glitch_is_carried_on_as_well() -> None:
    bench = ServoBench()
    moving(bench, speed=1.0, joint=WRIST)
    place = bench.snapshot.q.copy()
    bench.slip = {WRIST: 30_000}
    bench.tick(2)
    assert bench.snapshot.q[WRIST] - place[WRIST] == pytest.approx(2e-3, rel=0.03)
    bench.slip = {}
    bench.tick()
    np.testing.assert_array_equal(bench.snapshot.q, counted(bench))


@pytest.mark.sampled(12)
@pytest.mark.parametrize("rate_hz", [250.0, 1000.0, 4000.0])
@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("slip", [-30_000, -700, 700, 30_000])
def test_two_bad_readings_of_a_joint_at_full_speed_are_carried_over(rate_hz: float, joint: int, slip: int) -> None:
    bench = ServoBench(rate_hz=rate_hz)
    moving(bench, speed=0.97 * bench.robot.limits.v_max[joint], joint=joint, seconds=0.4)
    bench.slip = {joint: slip}
    bench.tick(2)
    assert np.all(bench.rows()["flags"][-2:] & FLAG_UNSEEN)
    bench.slip = {}
    bench.tick()
    assert bench.mode is Mode.TRACKING
    np.testing.assert_array_equal(bench.snapshot.q, counted(bench))


def test_a_joint_driven_by_torque_goes_on_at_its_speed() -> None:
    bench = ServoBench()

    def by_torque(_seq: int, modes: list[int], values: Floats) -> None:
        modes[WRIST], values[WRIST] = TORQUE_SETPOINT, 0.0

    bench.hold()
    play(bench, cruise(bench.q, np.zeros(6)), edit=by_torque)
    bench.run(0.1)
    bench.follows = False
    bench.before.append(lambda _now: bench.q.__setitem__(WRIST, bench.q[WRIST] + 0.5e-3))
    bench.run(0.1)
    place, tau = bench.snapshot.q.copy(), bench.snapshot.tau.copy()
    silence(bench, 0.004)
    assert bench.snapshot.q[WRIST] - place[WRIST] == pytest.approx(2e-3, rel=0.1)
    np.testing.assert_allclose(bench.snapshot.tau, tau, atol=0.01)


def test_without_torque_nothing_is_carried_on() -> None:
    bench = ServoBench().tick(3)
    bench.before.append(lambda _now: bench.q.__setitem__(WRIST, bench.q[WRIST] + 1e-3))
    bench.tick(30)
    place = bench.snapshot.q.copy()
    assert bench.state.v[WRIST] > 0.5
    silence(bench, 0.003)
    np.testing.assert_array_equal(bench.snapshot.q, place)


def test_a_reference_that_is_put_where_the_joint_is_carries_it_nowhere() -> None:
    bench = ServoBench()
    moving(bench, speed=1.0, joint=WRIST)
    bench.follows = False
    bench.tick(5)  # the joint falls behind
    state = bench.state
    place = np.array(state.q)
    assert state.q_ref[WRIST] - place[WRIST] > 3e-3
    lose_sight(state)
    v = np.array(state.v)
    hold_position(state)
    hold_through_dropout(state)
    np.testing.assert_allclose(state.q, place + v * 1e-3, atol=1e-12)
    np.testing.assert_allclose(state.v, v, atol=1e-12)


# --------------------------------------------------------------------------------------- what goes by what was counted


def test_the_velocity_after_a_silence_is_that_of_a_servo_that_slept_through_it() -> None:
    silent, asleep = patient(), patient()
    for bench in (silent, asleep):
        moving(bench, speed=1.0, joint=WRIST, seconds=0.25)
        bench.follows = False
        start, since = bench.q.copy(), bench.now_ns
        bench.before.append(
            lambda now, bench=bench, start=start, since=since: bench.q.__setitem__(
                WRIST, start[WRIST] + 0.8e-9 * (now - since)
            )
        )
        bench.tick(5)
    silence(silent, 0.002)
    asleep.skip(8)
    for bench in (silent, asleep):
        bench.tick()
    np.testing.assert_array_equal(silent.state.v, asleep.state.v)
    np.testing.assert_array_equal(silent.state.q, asleep.state.q)


@RATES
@pytest.mark.parametrize("timeout_ms", [1.0, PATIENT_MS])
def test_a_board_that_stays_silent_is_gone_when_it_always_was(timeout_ms: float, rate_hz: float) -> None:
    bench = ServoBench(rate_hz=rate_hz, board_timeout_ms=timeout_ms)
    moving(bench, speed=1.0, joint=WRIST)
    bench.frozen = True
    assert bench.until(lambda: bench.mode is Mode.FAULT) == max(4, round(timeout_ms * 1e-3 * rate_hz)) + 1
    assert (bench.fault, bench.safe) == (FaultCode.BOARD_GONE, True)
    bench.tick()
    np.testing.assert_array_equal(bench.snapshot.q, counted(bench))
    bench.mailbox.request_clear()
    bench.frozen = False
    bench.tick()
    np.testing.assert_array_equal(bench.state.v, np.zeros(6))  # begins anew, with nothing of what was carried on


def test_encoders_that_stand_still_in_new_images_are_believed() -> None:
    bench = patient()
    moving(bench, speed=1.0, joint=WRIST)
    bench.follows = False
    tau = bench.snapshot.tau[WRIST]
    bench.run(STALL_S)
    assert bench.snapshot.q[WRIST] == pytest.approx(bench.q[WRIST], abs=1e-4)
    assert bench.snapshot.tau[WRIST] - tau > bench.robot.control.kp[WRIST] * 0.5 * STALL_S


def test_an_image_of_the_past_is_none_whatever_its_count_says() -> None:
    bench = patient(1000.0)
    moving(bench)
    bench.behind_ns = int(1.01 * PATIENT_MS * 1e6)
    bench.tick()
    assert bench.rows()["flags"][-1] & FLAG_UNSEEN
    bench.behind_ns = 0
    bench.tick()
    assert not bench.rows()["flags"][-1] & FLAG_UNSEEN
    assert bench.mode is Mode.TRACKING


def test_a_board_that_falls_behind_for_good_is_gone_as_soon_as_a_silent_one() -> None:
    bench = patient(1000.0)
    moving(bench)
    bench.behind_ns = int(1.01 * PATIENT_MS * 1e6)
    assert bench.until(lambda: bench.mode is Mode.FAULT) == round(PATIENT_MS) + 1
    assert bench.fault is FaultCode.BOARD_GONE
    assert bench.safe


def test_a_board_that_is_always_a_little_behind_is_as_good_as_another() -> None:
    bench = patient(1000.0)
    bench.behind_ns = int(0.99 * PATIENT_MS * 1e6)
    moving(bench)
    assert not np.any(bench.rows()["flags"][-100:] & FLAG_UNSEEN)


# --------------------------------------------------------------------------------------------- the clock of the board


def behind_a_gateway(bench: ServoBench, far_ns: Callable[[int], int]) -> None:
    """From now on the board's clock is `far_ns` of ours, which tells when it was asked."""

    def ask(now_ns: int) -> None:
        bench.board.facts.taken_ns = now_ns
        bench.behind_ns = now_ns - far_ns(now_ns)

    bench.before.append(ask)


@pytest.mark.parametrize("stands", [True, False])
def test_a_board_whose_clock_stands_or_goes_back_is_gone_as_soon_as_a_silent_one(stands: bool) -> None:
    bench = patient(1000.0)
    moving(bench, seconds=0.15)
    last_ns = bench.now_ns - bench.settings.period_ns
    behind_a_gateway(bench, lambda now_ns: last_ns if stands else now_ns - 500_000_000)
    assert bench.until(lambda: bench.mode is Mode.FAULT) == round(PATIENT_MS) + 1
    assert (bench.fault, bench.safe) == (FaultCode.BOARD_GONE, True)
    bench.mailbox.request_power(False)
    bench.mailbox.request_clear()
    bench.tick(10)
    assert bench.mode is (Mode.FAULT if stands else Mode.OFF)  # another clock is as good as the one before
    assert stands or bench.hold().mode is Mode.HOLDING


@pytest.mark.parametrize("far_ns", [0, 7])
def test_an_arm_whose_board_has_a_clock_that_stands_gets_no_power(far_ns: int) -> None:
    bench = ServoBench()
    behind_a_gateway(bench, lambda _now_ns: far_ns)
    bench.tick(10)
    for _ in range(3):
        bench.mailbox.request_power(True)
        bench.tick(5)
        assert (bench.mode, bench.event) == (Mode.OFF, FaultCode.BOARD_GONE)
        bench.mailbox.request_power(False)
        bench.tick()


def test_an_image_that_its_board_has_stamped_no_later_than_the_one_before_is_none() -> None:
    bench = patient(1000.0)
    moving(bench, seconds=0.15)
    late_ns = bench.settings.period_ns
    behind_a_gateway(bench, lambda now_ns: now_ns - late_ns)
    bench.tick()
    assert bench.rows()["flags"][-1] & FLAG_UNSEEN
    bench.tick()
    assert not bench.rows()["flags"][-1] & FLAG_UNSEEN
    assert bench.mode is Mode.TRACKING
