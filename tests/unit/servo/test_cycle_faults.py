"""Every fault the servo raises today: what it takes, how fast, what happens to torque and power.

`ServoBench` shows the cycle exactly one disturbance at a time; the bounds are those of the servo's promises.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.hwif.board_memory import LANE_CAPACITY
from qrobot.hwif.registers import (
    DAC_ZERO,
    DISCRETE_CALIBRATED,
    N_DACS,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_POWER,
)
from qrobot.modecodes import Mode
from qrobot.servo.laws.law import law
from qrobot.servo.modes import StopCategory
from qrobot.servo.stop_categories import stop_category
from tests.support.servo_bench import Floats, ServoBench, changes, cruise, moving, play

RATES = pytest.mark.parametrize("rate_hz", [1000.0, 4000.0])


def holding(bench: ServoBench) -> None:
    bench.hold()
    bench.tick(20)


def tracking(bench: ServoBench) -> None:
    moving(bench, seconds=0.6)


BOTH = pytest.mark.parametrize("begin", [holding, tracking])


def until_fault(bench: ServoBench, code: FaultCode, seconds: float = 2.0) -> int:
    """Ticks until the servo is in FAULT with this code, safe."""
    ticks = bench.until(lambda: bench.mode is Mode.FAULT, seconds)
    assert bench.fault is code
    assert bench.safe
    return ticks


# ---------------------------------------------------------------------------------------------- category 0: cut at once


def fail_status(word: int) -> Callable[[ServoBench], object]:
    return lambda bench: setattr(bench, "status", word)


@BOTH
@RATES
@pytest.mark.parametrize(
    ("mishap", "code"),
    [
        (fail_status(0xFFFF), FaultCode.BOARD_GONE),
        (fail_status(0x0000), FaultCode.ESTOP),
        (fail_status(STATUS_POWER | STATUS_CALIBRATED), FaultCode.ESTOP),
        (fail_status(STATUS_ESTOP_OK | STATUS_CALIBRATED), FaultCode.POWER_LOST),
        (lambda bench: setattr(bench.mail.guardian, "takeover", 1), FaultCode.GUARD_TRIP),
    ],
)
def test_what_the_board_or_the_guardian_shows_cuts_the_power_in_the_same_tick(
    mishap: Callable[[ServoBench], object],
    code: FaultCode,
    rate_hz: float,
    begin: Callable[[ServoBench], None],
) -> None:
    bench = ServoBench(rate_hz=rate_hz)
    begin(bench)
    mishap(bench)
    bench.tick()
    assert (bench.mode, bench.fault, bench.event) == (Mode.FAULT, code, code)
    assert bench.safe or code is FaultCode.GUARD_TRIP
    assert stop_category(code) is StopCategory.CATEGORY_0


@RATES
@BOTH
def test_a_frozen_board_is_noticed_within_a_millisecond_or_four_cycles(
    rate_hz: float, begin: Callable[[ServoBench], None]
) -> None:
    bench = ServoBench(rate_hz=rate_hz)
    begin(bench)
    bench.frozen = True
    assert until_fault(bench, FaultCode.BOARD_GONE) == 4 + 1


def test_an_image_that_is_torn_for_some_cycles_is_no_fault_but_one_that_stays_torn_is() -> None:
    bench = ServoBench()
    tracking(bench)
    bench.frozen = True
    bench.board.shown.sequence += 1  # a writer is inside
    before = np.array(bench.state.counts)
    bench.tick(3)
    assert bench.mode is Mode.TRACKING
    np.testing.assert_array_equal(bench.state.counts, before)
    bench.board.shown.sequence += 1
    bench.frozen = False
    bench.run(0.2)
    assert bench.mode is Mode.TRACKING
    bench.frozen = True
    bench.board.shown.sequence += 1
    until_fault(bench, FaultCode.BOARD_GONE)


@RATES
def test_one_impossible_encoder_reading_is_held_back_and_leaves_no_trace(rate_hz: float) -> None:
    clean, bench = ServoBench(rate_hz=rate_hz), ServoBench(rate_hz=rate_hz)
    for one in (clean, bench):
        tracking(one)
    bench.slip = {1: 30_000}
    clean.tick()
    bench.tick()
    bench.slip = {}
    for one in (clean, bench):
        one.run(0.2)
    assert bench.mode is Mode.TRACKING
    np.testing.assert_array_equal(bench.snapshot.q_setpoint, clean.snapshot.q_setpoint)
    np.testing.assert_allclose(bench.snapshot.q, clean.snapshot.q, atol=1e-12)


@BOTH
@pytest.mark.parametrize("slip", [-30_000, -200, -100, 100, 200, 30_000])
def test_three_impossible_readings_in_a_row_are_a_fault(slip: int, begin: Callable[[ServoBench], None]) -> None:
    bench = ServoBench()
    begin(bench)
    bench.slip = {2: slip}
    assert until_fault(bench, FaultCode.ENC_JUMP) == 3
    assert bench.snapshot.event_joint == 2


def test_counters_that_jumped_for_good_are_taken_after_a_reset_but_are_no_calibration() -> None:
    bench = ServoBench()
    holding(bench)
    bench.slip = {0: 500}
    until_fault(bench, FaultCode.ENC_JUMP)
    bench.mailbox.request_power(False)
    bench.mailbox.request_clear()
    bench.tick(3)
    assert bench.mode is Mode.OFF
    assert not bench.discrete & DISCRETE_CALIBRATED
    bench.calibrated = False  # as the board reads it back
    bench.hold()
    assert bench.mode is Mode.UNCALIBRATED


def test_counters_that_came_back_keep_their_calibration_over_a_reset() -> None:
    bench = ServoBench()
    holding(bench)
    bench.slip = {0: 500}
    until_fault(bench, FaultCode.ENC_JUMP)
    bench.slip = {}
    bench.mailbox.request_power(False)
    bench.tick(2)
    bench.mailbox.request_clear()
    bench.tick(3)
    assert bench.discrete & DISCRETE_CALIBRATED
    np.testing.assert_allclose(bench.snapshot.q, bench.q, atol=2e-4)


@pytest.mark.parametrize("cycles", [1, 2, 3, 8])
def test_a_late_tick_is_no_glitch(cycles: int) -> None:
    bench = ServoBench()
    moving(bench, speed=1.2)
    step = np.array([1.2e-3 * cycles, 0, 0, 0, 0, 0])
    bench.skip(cycles)
    bench.q = bench.q + step  # the arm went on meanwhile
    bench.tick()
    bench.run(0.2)
    assert bench.mode is Mode.TRACKING


@pytest.mark.parametrize("step", [-1e-3, 1e-3])
def test_a_counter_that_wraps_is_continuous(step: float) -> None:
    bench = ServoBench()
    bench.slip = {0: 32_750 if step > 0 else -32_750}  # shows counts next to the end of the signed word
    bench.tick(3)
    start = bench.snapshot.q[0]
    for _ in range(40):
        bench.q[0] += step
        bench.tick()
    assert bench.mode is Mode.OFF
    assert bench.snapshot.q[0] - start == pytest.approx(40 * step, abs=2e-4)


@RATES
def test_a_joint_that_runs_away_is_cut(rate_hz: float) -> None:
    bench = ServoBench(rate_hz=rate_hz)
    holding(bench)
    bench.follows = False
    step = 2.5 * bench.robot.limits.v_max[4] / rate_hz
    bench.before.append(lambda _now: bench.q.__setitem__(4, bench.q[4] + step))
    ticks = bench.until(lambda: bench.mode is Mode.FAULT)
    assert bench.safe
    assert ticks / rate_hz < 0.05
    assert abs(bench.q[4] - bench.robot.poses["park"][4]) < math.radians(4.0)


def test_a_measured_speed_beyond_half_as_much_again_is_a_runaway() -> None:
    bench = ServoBench()
    holding(bench)
    bench.state.v[3] = -2.2 * bench.robot.limits.v_max[3]
    bench.tick()
    assert (bench.mode, bench.fault, bench.snapshot.event_joint) == (Mode.FAULT, FaultCode.RUNAWAY, 3)
    assert bench.safe


@pytest.mark.parametrize(("law", "reach"), [("qrobot", 1.0), ("joint_impedance", 5.0)])
@BOTH
def test_an_arm_that_is_not_where_it_should_be_is_cut(
    begin: Callable[[ServoBench], None], law: str, reach: float
) -> None:
    bench = ServoBench(law=law)
    begin(bench)
    bench.follows = False
    allowed = reach * bench.robot.guard.following_error[5]
    place = bench.q[5]
    bench.before.append(lambda _now: bench.q.__setitem__(5, max(bench.q[5] - 2e-3, place - allowed - 5e-3)))
    until_fault(bench, FaultCode.FOLLOWING)
    assert place - bench.q[5] > 0.99 * allowed


# ------------------------------------------------------------------------------------- category 1: stop, then power off


def measure_too_fast(bench: ServoBench) -> None:
    """Let the next cycle measure a speed beyond the limit, but not as far as that of a runaway."""
    bench.state.v[0] = 1.55 * bench.robot.limits.v_max[0]
    bench.tick()


def test_a_speed_that_one_cycle_alone_measures_is_noise() -> None:
    bench = ServoBench()
    tracking(bench)
    for _ in range(5):
        measure_too_fast(bench)
        bench.state.v[0] = 0.0
        bench.tick()
    assert (bench.mode, bench.event) == (Mode.TRACKING, FaultCode.NONE)


def test_a_joint_too_fast_while_tracking_is_stopped_on_the_path_and_then_cut() -> None:
    bench = ServoBench()
    tracking(bench)
    measure_too_fast(bench)
    assert bench.mode is Mode.TRACKING
    measure_too_fast(bench)
    assert (bench.mode, bench.event) == (Mode.STOPPING, FaultCode.VEL_LIMIT)
    assert bench.powered
    until_fault(bench, FaultCode.VEL_LIMIT)
    assert stop_category(FaultCode.VEL_LIMIT) is StopCategory.CATEGORY_1


def test_a_joint_too_fast_while_holding_is_cut() -> None:
    bench = ServoBench()
    holding(bench)
    measure_too_fast(bench)
    measure_too_fast(bench)
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.VEL_LIMIT)
    assert bench.safe


@pytest.mark.parametrize("side", [-1, 1])
def test_a_joint_that_leaves_its_range_and_the_margin_is_cut(side: int) -> None:
    bench = ServoBench()
    limits = bench.robot.limits
    end = (limits.q_min if side < 0 else limits.q_max)[1]
    bench.q[1] = end - side * 2e-3
    holding(bench)
    bench.follows = False
    bench.before.append(lambda _now: bench.q.__setitem__(1, bench.q[1] + side * 5e-4))
    until_fault(bench, FaultCode.JOINT_LIMIT)
    margin = bench.robot.guard.range_margin[1]
    assert 0.0 < side * (bench.q[1] - end) - margin < 1e-3


def outside(joint: int, by: float) -> ServoBench:
    """Powered up beyond the end of a joint's range."""
    bench = ServoBench()
    bench.q[joint] = bench.robot.limits.q_max[joint] + by
    holding(bench)
    return bench


def test_an_arm_powered_up_outside_its_range_is_held_and_can_be_driven_back() -> None:
    bench = outside(0, 0.15)
    assert bench.mode is Mode.HOLDING
    program = play(bench, cruise(bench.snapshot.q_setpoint, np.array([-0.4, 0, 0, 0, 0, 0])))
    bench.run(0.9)
    assert bench.mode is Mode.TRACKING
    assert bench.q[0] < bench.robot.limits.q_max[0]
    program.path = cruise(program.path(program.seq * 0.028), np.zeros(6))
    bench.run(0.1)
    assert bench.state.range_max[0] == bench.robot.limits.q_max[0]


def test_such_an_arm_is_not_driven_further_out() -> None:
    bench = outside(0, 0.15)
    play(bench, cruise(bench.snapshot.q_setpoint, np.array([0.4, 0, 0, 0, 0, 0])))
    bench.until(lambda: bench.mode is Mode.STOPPING)
    assert bench.event is FaultCode.SP_LIMIT
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert bench.q[0] < bench.robot.limits.q_max[0] + 0.15 + 2 * bench.robot.guard.range_margin[0]


def test_nor_is_it_let_out_again_where_it_has_come_back() -> None:
    bench = outside(1, 0.1)
    bench.follows = False
    for step in [-1e-3] * 30 + [1e-3] * 35:
        bench.q[1] += step
        bench.tick()
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.JOINT_LIMIT)


def test_an_uncalibrated_arm_has_no_range() -> None:
    bench = ServoBench(calibrated=False)
    bench.q[1] = bench.robot.limits.q_max[1] + 0.3
    bench.hold()
    bench.run(0.1)
    assert bench.mode is Mode.UNCALIBRATED


@law
def breaks_later(
    q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, gravity: Any, friction: Any,
    sensors: Any, gains: Any, memory: Any, tau: Any,
) -> None:  # fmt: skip
    """Works for 5000 calls, then breaks on joint 2: NaN; after 6000 calls an infinity."""
    memory[0] += 1.0
    for j in range(tau.size):
        tau[j] = gravity[j]
    if memory[0] > 6000.0:
        tau[1] = np.inf
    elif memory[0] > 5000.0:
        tau[1] = np.nan


def break_law(bench: ServoBench, word: float) -> None:
    bench.state.memory[0] = word


@pytest.mark.parametrize("calls", [4999.0, 5999.0])
def test_a_law_that_breaks_while_tracking_is_replaced_and_the_arm_stopped(calls: float) -> None:
    bench = ServoBench(law=breaks_later)
    tracking(bench)
    break_law(bench, calls)
    bench.tick(2)
    assert (bench.mode, bench.event, bench.snapshot.event_joint) == (Mode.STOPPING, FaultCode.LAW_NAN, 1)
    assert np.all(np.isfinite(bench.snapshot.tau))
    assert abs(bench.snapshot.tau[1]) > 1.0  # still carried
    until_fault(bench, FaultCode.LAW_NAN)
    assert list(changes(bench.rows()))[-2:] == [(Mode.TRACKING, Mode.STOPPING), (Mode.STOPPING, Mode.FAULT)]


def test_a_law_that_breaks_while_holding_is_cut_in_the_same_tick_without_a_torque() -> None:
    bench = ServoBench(law=breaks_later)
    holding(bench)
    break_law(bench, 5000.0)
    bench.tick()
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.LAW_NAN)
    assert np.all(bench.rows()["dac"][-1] == DAC_ZERO)
    assert bench.safe


def test_after_a_reset_the_law_gets_another_chance() -> None:
    bench = ServoBench(law=breaks_later)
    holding(bench)
    break_law(bench, 5000.0)
    bench.tick(2)
    bench.mailbox.request_power(False)
    bench.mailbox.request_clear()
    bench.tick(3)
    bench.hold()
    bench.tick(10)
    assert bench.mode is Mode.HOLDING  # its memory was wiped at power-up
    assert 0.0 < bench.state.memory[0] < 20.0


@law
def spoils_its_arguments(
    q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, gravity: Any, friction: Any,
    sensors: Any, gains: Any, memory: Any, tau: Any,
) -> None:  # fmt: skip
    """Writes where it must only read."""
    for j in range(tau.size):
        q_ref[j] = v_ref[j] = q[j] = v[j] = gravity[j] = np.nan
        tau[j] = 1e300


@BOTH
def test_a_law_that_writes_into_what_it_is_given_gets_no_bad_number_to_a_dac_or_to_the_servo(
    begin: Callable[[ServoBench], None],
) -> None:
    bench = ServoBench()
    begin(bench)
    mode = bench.mode
    bench.follows = False
    bench.law = spoils_its_arguments
    bench.run(0.05)
    rows = bench.rows()
    assert np.all(np.isfinite(rows["tau"]))
    assert np.all(np.abs(rows["tau"]) <= bench.robot.guard.tau_max)
    for name in ("q", "v", "q_ref"):
        assert np.all(np.isfinite(rows[name]))
    assert bench.mode is mode  # what it spoilt were copies


@RATES
def test_a_servo_without_its_guardian_stops_the_arm_within_ten_milliseconds(rate_hz: float) -> None:
    bench = ServoBench(rate_hz=rate_hz, guarded=True)
    tracking(bench)
    bench.beating = False
    ticks = bench.until(lambda: bench.mode is Mode.STOPPING)
    assert ticks / rate_hz <= 0.010 + 1.0 / rate_hz
    assert bench.powered
    until_fault(bench, FaultCode.GUARD_LOST)


# -------------------------------------------------------------------------------------------------- the guardian has it


def test_a_servo_whose_board_was_taken_writes_nothing_until_it_is_handed_back() -> None:
    bench = ServoBench()
    tracking(bench)
    bench.mail.guardian.takeover = 1
    written = len(bench.writes)
    bench.run(0.1)
    assert len(bench.writes) == written
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.GUARD_TRIP)
    bench.mail.guardian.takeover = 0
    bench.tick()
    assert bench.safe  # zero torque, power off, said anew
    assert bench.mode is Mode.FAULT


def test_a_takeover_is_a_fault_even_without_power() -> None:
    bench = ServoBench().tick(3)
    bench.mail.guardian.takeover = 1
    bench.tick()
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.GUARD_TRIP)


# ----------------------------------------------------------------------------------------- a board that does not listen


def test_a_power_off_that_found_the_lane_full_is_said_again() -> None:
    bench = ServoBench()
    holding(bench)
    bench.deaf = True
    bench.tick(LANE_CAPACITY // N_DACS + 1)
    bench.estop_ok = False
    bench.tick(2)
    assert bench.mode is Mode.FAULT
    bench.deaf = False
    bench.tick(2)
    assert bench.safe


# ------------------------------------------------------------------------------------------------------ several at once


def test_of_several_codes_the_one_that_cuts_counts() -> None:
    bench = ServoBench(guarded=True)
    tracking(bench)
    bench.run(0.02)
    bench.beating = False  # category 1, raised from 10 ms on
    bench.tick(10)
    bench.estop_ok = False
    bench.tick()
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.ESTOP)


def test_nothing_that_happens_in_fault_changes_its_code() -> None:
    bench = ServoBench(guarded=True)
    holding(bench)
    bench.estop_ok = False
    bench.tick()
    bench.beating, bench.slip = False, {0: 400}
    bench.frozen = True
    bench.run(0.1)
    assert (bench.mode, bench.fault, bench.event) == (Mode.FAULT, FaultCode.ESTOP, FaultCode.ESTOP)


def still(bench: ServoBench) -> Floats:
    return np.abs(bench.rows()["v"][-1])


def test_the_velocity_estimate_settles_after_motion() -> None:
    bench = ServoBench()
    tracking(bench)
    assert still(bench)[0] == pytest.approx(0.5, rel=0.02)
    bench.mailbox.request_stop()
    bench.run(0.5)
    assert still(bench).max() < 1e-6
