"""Which mode follows which: power, stops, resets, and who may ask for what when."""

from __future__ import annotations

import re
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode, explain
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_CALIBRATED, DISCRETE_POWER, N_DACS
from qrobot.modecodes import Mode
from qrobot.servo.event import report_fault
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import FLAG_HALTED
from qrobot.servo.memory.telemetry import FLAG_UNSEEN
from qrobot.servo.modes import TRANSITIONS, gives_torque
from qrobot.servo.stages.mode_machine import guardian_alive
from qrobot.servo.stop_categories import stop_category
from qrobot.wire.vocabulary import LONGEST_PERIOD_US
from tests.support.servo_bench import ServoBench, changes, moving, play, swing, writes_at

N = 6
POWER_UP = [(Mode.OFF, Mode.POWERING), (Mode.POWERING, Mode.HOLDING)]


# ------------------------------------------------------------------------------------------------- what a code leads to


def in_motion() -> ServoBench:
    bench = ServoBench()
    moving(bench)
    return bench


IN_MODE: dict[Mode, Callable[[], ServoBench]] = {
    Mode.POWERING: lambda: ServoBench().wait_for_power(),
    Mode.UNCALIBRATED: lambda: ServoBench(calibrated=False).hold(),
    Mode.HOLDING: lambda: ServoBench().hold(),
    Mode.TRACKING: in_motion,
}


@pytest.mark.parametrize("code", [FaultCode.ENC_STUCK, FaultCode.VEL_LIMIT, FaultCode.COLLISION])
@pytest.mark.parametrize("mode", IN_MODE)
def test_a_code_leads_where_the_diagram_says(mode: Mode, code: FaultCode) -> None:
    bench = IN_MODE[mode]()
    assert bench.mode is mode
    report_fault(bench.state, code, 0, 0.2, 0.1)
    bench.tick()
    told = re.compile(rf"\bcategory (\d or )?{stop_category(code):d}( or \d)? fault")
    reasons = TRANSITIONS[mode] | {mode: ""}
    assert {target for target, why in reasons.items() if told.search(why)} == {bench.mode} - {mode}


# --------------------------------------------------------------------------------------------------------- power on


def test_a_servo_starts_off_and_writes_zero_torque_without_power() -> None:
    bench = ServoBench().tick()
    assert bench.mode is Mode.OFF
    assert bench.safe
    bench.run(0.2)
    assert bench.mode is Mode.OFF
    assert bench.safe


def test_the_state_of_an_unpowered_servo_tells_where_the_arm_is() -> None:
    bench = ServoBench().tick(2)
    np.testing.assert_allclose(bench.snapshot.q, bench.q, atol=2e-4)
    np.testing.assert_array_equal(bench.snapshot.q_setpoint, bench.snapshot.q)


def test_power_goes_on_through_powering_into_holding() -> None:
    bench = ServoBench().hold()
    assert list(changes(bench.rows())) == POWER_UP
    assert bench.powered
    assert bench.event is FaultCode.NONE


def test_power_is_enabled_after_zero_torque_was_set_and_torque_only_flows_with_power_on() -> None:
    bench = ServoBench().wait_for_power()
    written = writes_at(bench, next(write.t_ns for write in bench.writes if write.value & DISCRETE_POWER))
    assert written[-1][0] == DISCRETE
    assert written[:-1] == [(DAC + 2 * channel, DAC_ZERO) for channel in range(N_DACS)]
    assert bench.mode is Mode.POWERING
    assert np.all(bench.dac == DAC_ZERO)
    bench.panel = True
    bench.tick(2)
    assert bench.mode is Mode.HOLDING
    assert bench.dac[1] != DAC_ZERO  # carries the upper arm


def test_power_is_given_up_when_nobody_presses_the_button_for_three_seconds() -> None:
    bench = ServoBench()
    bench.panel = False
    bench.tick(3)
    bench.mailbox.request_power(True)
    bench.tick()
    assert bench.mode is Mode.POWERING
    ticks = bench.until(lambda: bench.mode is Mode.OFF)
    assert ticks == pytest.approx(3000, abs=2)
    assert bench.event is FaultCode.POWER_NO_ACK
    assert bench.safe
    bench.panel = True
    bench.run(0.5)
    assert bench.mode is Mode.OFF  # the old request is used up


def test_an_uncalibrated_arm_is_held_without_a_model_and_follows_nobody() -> None:
    bench = ServoBench(calibrated=False).hold()
    assert bench.mode is Mode.UNCALIBRATED
    np.testing.assert_array_equal(bench.snapshot.tau, 0.0)
    play(bench, swing(bench.q, np.full(N, 0.1), 1.0))
    bench.run(0.3)
    assert bench.mode is Mode.UNCALIBRATED


def release_estop(bench: ServoBench) -> None:
    bench.estop_ok = True


@pytest.mark.parametrize(
    ("mishap", "code"),
    [
        (lambda bench: setattr(bench, "estop_ok", False), FaultCode.ESTOP),
        (lambda bench: setattr(bench, "beating", False), FaultCode.GUARD_LOST),
        (lambda bench: setattr(bench, "frozen", True), FaultCode.BOARD_GONE),
        (
            lambda bench: bench.before.append(lambda _now: bench.q.__setitem__(3, bench.q[3] + 2e-4)),
            FaultCode.MOVING_AT_START,
        ),
        (lambda bench: setattr(bench.board.facts, "joints", 5), FaultCode.BOARD_JOINTS),
    ],
)
def test_power_is_refused_with_the_reason_and_not_given_later_by_itself(
    mishap: Callable[[ServoBench], object], code: FaultCode
) -> None:
    bench = ServoBench(guarded=True).tick(3)
    mishap(bench)
    bench.tick(50)
    bench.mailbox.request_power(True)
    bench.tick(5)
    assert (bench.mode, bench.event) == (Mode.OFF, code)
    assert explain(code).endswith(("power on", "ask for power again"))
    assert "clear" not in explain(code).replace("`qrobot ctl clear` where it was a fault", "")  # it is none here
    bench.estop_ok, bench.beating, bench.frozen = True, True, False
    bench.before.clear()
    bench.board.facts.joints = 6
    bench.run(0.5)
    assert bench.mode is Mode.OFF
    bench.mailbox.request_power(False)
    bench.tick()
    bench.hold()
    assert bench.mode is Mode.HOLDING


def ask_anew(bench: ServoBench) -> None:
    """Let the level go down and up with no cycle between."""
    bench.mailbox.request_power(False)
    bench.mailbox.request_power(True)
    bench.run(0.1)


@pytest.mark.parametrize("taken", [False, True], ids=["refused", "taken away"])
def test_a_request_that_was_down_for_less_than_a_cycle_is_one_made_anew(taken: bool) -> None:
    """Two COMMANDs that arrive together: the cycle sees the level of the second alone."""
    bench = ServoBench()
    bench.estop_ok = taken
    if taken:
        bench.hold().mailbox.request_power_off()
    else:
        bench.tick(3).mailbox.request_power(True)
    bench.run(0.1)
    bench.estop_ok = True
    bench.run(1.0)
    assert bench.mode is Mode.OFF
    ask_anew(bench)
    assert bench.mode is Mode.HOLDING


def test_a_stop_before_power_is_on_takes_the_request_back() -> None:
    bench = ServoBench().wait_for_power()
    bench.mailbox.request_stop()
    bench.tick()
    assert (bench.mode, bench.state.event) == (Mode.OFF, FaultCode.POWER_STOPPED)
    bench.panel = True
    bench.mailbox.request_power(True)  # its commander goes on asking
    bench.run(1.0)
    assert bench.mode is Mode.OFF
    ask_anew(bench)
    assert bench.mode is Mode.HOLDING


@pytest.mark.parametrize(("by", "told"), [("somebody", FaultCode.POWER_STOPPED), ("its commander", FaultCode.NONE)])
def test_power_that_is_taken_away_while_it_comes_is_told_unless_its_commander_lets_go(by: str, told: FaultCode) -> None:
    """So that a program which has just come does not ask anew, against whoever has taken it."""
    bench = ServoBench().wait_for_power()
    if by == "somebody":
        bench.mailbox.request_power_off()
    else:
        bench.mailbox.request_power(False)
    bench.tick()
    assert (bench.mode, bench.event) == (Mode.OFF, told)


def test_a_stop_in_the_cycle_in_which_power_is_asked_for_counts() -> None:
    bench = ServoBench().tick(3)
    bench.mailbox.request_stop()
    bench.mailbox.request_power(True)
    bench.run(1.0)
    assert (bench.mode, bench.event) == (Mode.OFF, FaultCode.POWER_STOPPED)


def test_of_power_asked_for_and_taken_away_in_one_cycle_the_latter_counts() -> None:
    bench = ServoBench().tick(3)
    bench.mailbox.request_power_off()
    bench.mailbox.request_power(True)
    bench.run(1.0)
    assert bench.mode is Mode.OFF
    bench.mailbox.request_power(True)  # it is up already
    bench.run(1.0)
    assert bench.mode is Mode.OFF


def test_a_servo_without_any_board_stays_off_and_says_so() -> None:
    bench = ServoBench()
    bench.frozen = True
    bench.mailbox.request_power(True)
    bench.run(0.1)
    assert (bench.mode, bench.event) == (Mode.OFF, FaultCode.BOARD_GONE)
    assert bench.writes == []


def test_a_restarted_servo_adopts_a_calibrated_board_and_moves_nothing() -> None:
    bench = ServoBench(pose="end").tick(5)
    assert bench.discrete & DISCRETE_CALIBRATED
    assert bench.safe
    np.testing.assert_allclose(bench.snapshot.q, bench.robot.poses["end"], atol=2e-4)
    np.testing.assert_array_equal(bench.snapshot.v, 0.0)


def test_a_restarted_servo_does_not_invent_a_calibration() -> None:
    bench = ServoBench(calibrated=False).tick(5)
    assert not bench.discrete & DISCRETE_CALIBRATED


def test_a_board_that_comes_back_elsewhere_is_adopted_while_there_is_no_power() -> None:
    bench = ServoBench().tick(5)
    bench.frozen = True
    bench.tick(10)
    assert bench.event is FaultCode.BOARD_GONE
    bench.q, bench.frozen, bench.discrete = np.array(bench.robot.poses["ready"]), False, -1
    bench.tick(2)
    np.testing.assert_allclose(bench.snapshot.q, bench.robot.poses["ready"], atol=2e-4)
    assert bench.discrete >= 0  # told anew what its discrete outputs are
    bench.hold()
    assert bench.mode is Mode.HOLDING


# -------------------------------------------------------------------------------------------------- stops, power off


def test_power_off_while_holding_takes_power_before_torque() -> None:
    bench = ServoBench().hold()
    bench.mailbox.request_power(False)
    now_ns = bench.now_ns
    bench.tick()
    assert bench.mode is Mode.OFF
    written = writes_at(bench, now_ns)
    assert written[0][0] == DISCRETE
    assert not written[0][1] & DISCRETE_POWER
    assert written[1:] == [(DAC + 2 * channel, DAC_ZERO) for channel in range(N_DACS)]


def test_a_stop_request_ends_in_holding_with_power() -> None:
    bench = ServoBench()
    moving(bench)
    bench.mailbox.request_stop()
    bench.tick()
    assert bench.mode is Mode.STOPPING
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert bench.powered
    assert bench.event is FaultCode.NONE
    np.testing.assert_array_equal(bench.rows()["v_ref"][-1], 0.0)


def test_a_stop_request_from_before_the_motion_does_not_stop_it() -> None:
    bench = ServoBench().tick(2)
    bench.mailbox.request_stop()
    bench.tick(2)
    moving(bench)


@pytest.mark.parametrize(
    "ask",
    [lambda bench: bench.mailbox.request_power(False), lambda bench: setattr(bench.mail.command, "shutdown", 1)],
)
def test_power_off_or_shutdown_while_tracking_stops_first(ask: Callable[[ServoBench], object]) -> None:
    bench = ServoBench()
    moving(bench)
    before = len(bench.rows())
    ask(bench)
    bench.until(lambda: bench.mode is Mode.OFF)
    assert list(changes(bench.rows()))[-2:] == [(Mode.TRACKING, Mode.STOPPING), (Mode.STOPPING, Mode.OFF)]
    stop = bench.rows()[before:-1]
    assert np.all(np.diff(stop["v_ref"][:, 0]) <= 1e-12)
    assert abs(stop["v_ref"][-1, 0]) < 1e-3
    assert bench.safe


def test_power_off_during_a_stop_decides_where_the_stop_ends() -> None:
    bench = ServoBench()
    moving(bench)
    bench.mailbox.request_stop()
    bench.tick(5)
    bench.mailbox.request_power(False)
    bench.until(lambda: bench.mode is Mode.OFF)
    assert bench.safe


def test_power_asked_for_again_during_such_a_stop_does_not_come_by_itself() -> None:
    bench = ServoBench()
    moving(bench)
    bench.mailbox.request_power(False)
    bench.tick(3)
    bench.mailbox.request_power(True)
    bench.run(1.0)
    assert bench.mode is Mode.OFF


def test_a_fault_of_category_one_during_a_mild_stop_ends_it_in_fault() -> None:
    bench = ServoBench(guarded=True)
    moving(bench)
    bench.mailbox.request_stop()
    bench.tick(2)
    bench.beating = False
    bench.until(lambda: bench.mode is Mode.FAULT)
    assert bench.fault is FaultCode.GUARD_LOST
    assert list(changes(bench.rows()))[-2:] == [(Mode.TRACKING, Mode.STOPPING), (Mode.STOPPING, Mode.FAULT)]


def test_power_off_does_not_soften_a_stop_that_ends_in_fault() -> None:
    bench = ServoBench(guarded=True)
    moving(bench)
    bench.beating = False
    bench.until(lambda: bench.mode is Mode.STOPPING)
    bench.mailbox.request_power(False)
    bench.until(lambda: bench.mode is not Mode.STOPPING)
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.GUARD_LOST)


@pytest.mark.parametrize("ask", [ServoMailbox.request_stop, ServoMailbox.request_power_off])
@pytest.mark.parametrize("where", [Mode.HOLDING, Mode.TRACKING, Mode.STOPPING])
def test_a_stop_that_somebody_asks_for_is_told_until_another_stream_is_followed(
    ask: Callable[[ServoMailbox], None], where: Mode
) -> None:
    """Whatever event says why the arm stands, as that of a collision does."""
    bench = ServoBench().hold()
    if where is not Mode.HOLDING:
        moving(bench)
    if where is Mode.STOPPING:
        report_fault(bench.state, int(FaultCode.COLLISION))
        bench.tick(2)
    assert bench.mode is where
    assert not bench.snapshot.flags & FLAG_HALTED
    ask(bench.mailbox)
    bench.tick()
    assert bench.snapshot.flags & FLAG_HALTED
    assert bench.event is (FaultCode.COLLISION if where is Mode.STOPPING else FaultCode.NONE)
    bench.before.clear()
    bench.until(lambda: bench.mode in (Mode.HOLDING, Mode.OFF))
    bench.run(1.0)
    assert bench.snapshot.flags & FLAG_HALTED
    assert not (bench.rows()["flags"] & FLAG_UNSEEN).any()
    bench.mailbox.request_power(False)
    bench.tick(2)
    moving(bench, stream=2)
    assert not bench.snapshot.flags & FLAG_HALTED


def test_a_stream_whose_first_frame_crossed_a_stop_tells_of_it_for_a_while() -> None:
    bench = ServoBench().hold()
    bench.mailbox.request_stop()
    bench.tick()
    play(bench, swing(bench.q, np.zeros(bench.robot.n), 1.0))
    bench.until(lambda: bench.mode is Mode.TRACKING)
    assert bench.snapshot.flags & FLAG_HALTED
    told = bench.until(lambda: not bench.snapshot.flags & FLAG_HALTED)
    assert told > 2 * LONGEST_PERIOD_US // 1000
    assert bench.mode is Mode.TRACKING


@pytest.mark.parametrize("code", [FaultCode.COLLISION, FaultCode.SATURATED])
def test_a_push_against_an_arm_that_is_held_is_no_reason_of_a_later_stop(code: FaultCode) -> None:
    bench = ServoBench().hold()
    report_fault(bench.state, int(code), 2)
    bench.tick()
    assert (bench.mode, bench.event) == (Mode.HOLDING, code)
    moving(bench)
    bench.mailbox.request_stop()
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert bench.event is FaultCode.NONE


def test_an_emergency_stop_during_a_stop_cuts_at_once() -> None:
    bench = ServoBench()
    moving(bench)
    bench.mailbox.request_stop()
    bench.tick(3)
    bench.estop_ok = False
    bench.tick()
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.ESTOP)
    assert bench.safe


# ------------------------------------------------------------------------------------------------------------ resets


def estop_pressed() -> ServoBench:
    bench = ServoBench(guarded=True).hold()
    bench.estop_ok = False
    bench.tick()
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.ESTOP)
    return bench


def test_a_fault_stays_until_it_is_cleared_and_clearing_moves_nothing() -> None:
    bench = estop_pressed()
    bench.estop_ok = True
    bench.run(1.0)
    assert bench.mode is Mode.FAULT
    bench.mailbox.request_clear()
    bench.tick()
    assert (bench.mode, bench.fault, bench.event) == (Mode.OFF, FaultCode.NONE, FaultCode.NONE)
    bench.run(1.0)
    assert bench.mode is Mode.OFF  # although power is still asked for
    assert bench.safe
    bench.mailbox.request_power(False)
    bench.tick()
    assert bench.hold().mode is Mode.HOLDING


@pytest.mark.parametrize(
    "cause",
    [
        lambda bench: setattr(bench, "estop_ok", False),
        lambda bench: setattr(bench, "frozen", True),
        lambda bench: setattr(bench, "status", 0xFFFF),
        lambda bench: setattr(bench, "beating", False),
    ],
)
def test_a_reset_is_denied_while_the_cause_persists(cause: Callable[[ServoBench], object]) -> None:
    bench = estop_pressed()
    bench.estop_ok = True
    cause(bench)
    bench.tick(30)
    bench.mailbox.request_clear()
    bench.run(0.2)
    assert (bench.mode, bench.event, bench.fault) == (Mode.FAULT, FaultCode.RESET_DENIED, FaultCode.ESTOP)
    bench.estop_ok, bench.frozen, bench.status, bench.beating = True, False, None, True
    bench.run(0.2)
    assert bench.mode is Mode.FAULT  # the denied request does not linger
    bench.mailbox.request_clear()
    bench.tick(2)
    assert bench.mode is Mode.OFF


def test_a_reset_from_before_the_fault_does_not_clear_it() -> None:
    bench = ServoBench().hold()
    bench.mailbox.request_clear()
    bench.tick()
    bench.estop_ok = False
    bench.tick()
    bench.estop_ok = True
    bench.run(0.3)
    assert bench.mode is Mode.FAULT


def test_frames_sent_during_a_fault_are_not_played_afterwards() -> None:
    bench = estop_pressed()
    bench.estop_ok = True
    play(bench, swing(bench.q, np.full(N, 0.1), 1.0), last=10)
    bench.run(0.5)
    bench.mailbox.request_power(False)
    bench.mailbox.request_clear()
    bench.tick(2)
    bench.hold()
    bench.run(0.2)
    assert (bench.mode, bench.event) == (Mode.HOLDING, FaultCode.NONE)
    assert Mode.TRACKING not in bench.rows()["mode"]


def test_torque_flows_in_no_mode_but_those_of_the_table() -> None:
    bench = ServoBench(guarded=True)
    moving(bench)
    bench.beating = False
    bench.until(lambda: bench.mode is Mode.FAULT)
    bench.run(0.1)
    for row in bench.rows():
        if not gives_torque(row["mode"]):
            assert np.all(row["dac"] == DAC_ZERO)
    assert bench.state.mode == Mode.FAULT


@pytest.mark.parametrize(("slips", "earliest_ms"), [(0, -100), (1, -1100)])
def test_a_heartbeat_from_the_future_is_none_but_where_time_was_put_back(slips: int, earliest_ms: int) -> None:
    params = SimpleNamespace(guardian_timeout_ns=100_000_000, board_slips=slips)
    alive = getattr(guardian_alive, "py_func", guardian_alive)
    mail = SimpleNamespace(guardian=SimpleNamespace(t_ns=5_000_000_000))
    ages_ms = {-10_000: False, earliest_ms - 1: False, earliest_ms: True, 0: True, 100: True, 101: False}
    assert {age: alive(params, mail, mail.guardian.t_ns + age * 1_000_000) for age in ages_ms} == ages_ms
