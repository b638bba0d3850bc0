"""Watches over timing, saturation and brakes in the cycle, and the record they leave of an incident."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import ConfigError
from qrobot.faultcodes import FaultCode
from qrobot.hwif.registers import STATUS_CALIBRATED, STATUS_ESTOP_OK, STATUS_POWER
from qrobot.modecodes import Mode
from qrobot.report import QueuedReport
from qrobot.servo.checks.fault_monitors import SETTLE_S
from qrobot.servo.checks.monitor_state import check_exchanges
from qrobot.servo.laws.law import law
from qrobot.servo.memory.stop_record import INCIDENT_WORDS, Incident, read_incident
from qrobot.servo.process.daemon import serve
from qrobot.servo.settings import Overrun, ServoSettings
from tests.support.servo_bench import ServoBench, moving

STRICT = Overrun(misses_in_a_row=3, late_share=0.01, window_s=1.0)


def tracking(speed: float = 0.5, **options: Any) -> ServoBench:
    bench = ServoBench(**options)
    moving(bench, speed, seconds=0.6)
    return bench


def incident_of(bench: ServoBench) -> Incident:
    incident = read_incident(bench.state.watch.incident)
    assert incident is not None
    return incident


# ------------------------------------------------------------------------------------------------------------- timing


def test_three_late_cycles_in_a_row_stop_the_arm_and_cut_it() -> None:
    bench = tracking(overrun=STRICT)
    for _ in range(2):
        bench.skip(1)
        bench.tick()
        assert bench.mode is Mode.TRACKING
    bench.skip(1)
    bench.tick()
    assert (bench.mode, bench.event) == (Mode.STOPPING, FaultCode.OVERRUN)
    bench.until(lambda: bench.mode is Mode.FAULT)
    assert bench.fault is FaultCode.OVERRUN
    assert bench.safe


def test_late_cycles_with_punctual_ones_between_are_counted_up_to_their_share() -> None:
    bench = tracking(overrun=STRICT)
    for _ in range(10):  # 1 % of a second at 1 kHz
        bench.skip(1)
        bench.tick(5)
    assert bench.mode is Mode.TRACKING
    bench.skip(1)
    bench.tick()
    assert (bench.mode, bench.event) == (Mode.STOPPING, FaultCode.OVERRUN)
    assert (incident_of(bench).value, incident_of(bench).limit) == (11.0, 10.0)


def test_each_window_counts_anew() -> None:
    bench = tracking(speed=0.1, overrun=STRICT)
    for _ in range(3):
        bench.skip(9)
        bench.run(1.0)
    assert (bench.mode, bench.event) == (Mode.TRACKING, FaultCode.NONE)


def test_one_long_stall_is_as_many_misses_as_it_has_cycles() -> None:
    bench = tracking(overrun=STRICT)
    bench.skip(11)
    bench.tick()
    assert bench.event is FaultCode.OVERRUN


def test_before_power_nothing_is_late_enough() -> None:
    bench = ServoBench(overrun=STRICT)
    for _ in range(20):
        bench.skip(50)
        bench.tick()
    bench.hold()
    bench.tick(10)
    assert (bench.mode, bench.event) == (Mode.HOLDING, FaultCode.NONE)


def test_an_emulated_arm_may_be_as_late_as_its_machine_is() -> None:
    bench = tracking()
    for _ in range(200):
        bench.skip(4)
        bench.tick()
    assert bench.event is not FaultCode.OVERRUN


@pytest.mark.parametrize(
    "wrong", [{"misses_in_a_row": -1}, {"late_share": 1.5}, {"late_share": math.nan}, {"window_s": 0.0}]
)
def test_a_share_of_lateness_that_is_none_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="allowed are"):
        Overrun(**wrong)


def busy(share: float) -> Callable[[ServoBench], object]:
    """The cycle takes so much of its period."""
    return lambda bench: bench.before.append(
        lambda _now: setattr(bench.state, "busy_ns", int(share * bench.settings.period_ns))
    )


def test_a_law_longer_than_the_cycle_is_replaced_and_the_arm_stopped_after_three_cycles() -> None:
    bench = tracking()
    busy(1.1)(bench)
    bench.tick(2)
    assert bench.mode is Mode.TRACKING
    bench.tick()
    assert (bench.mode, bench.event) == (Mode.STOPPING, FaultCode.LAW_SLOW)
    bench.until(lambda: bench.mode is Mode.FAULT)
    assert bench.fault is FaultCode.LAW_SLOW


def test_a_law_longer_than_half_the_cycle_is_told_of_and_goes_on() -> None:
    bench = tracking()
    busy(0.6)(bench)
    bench.tick(30)
    assert (bench.mode, bench.event) == (Mode.TRACKING, FaultCode.LAW_SLOW)


def test_a_lost_module_is_told_of_once_and_stops_nothing() -> None:
    bench = tracking()
    bench.board.facts.module_losses += 1
    bench.tick()
    assert (bench.mode, bench.event) == (Mode.TRACKING, FaultCode.IO_LOST)
    bench.state.event = 0
    bench.tick(20)
    assert bench.event is FaultCode.NONE


def test_a_module_lost_while_something_else_is_told_is_told_of_once_when_that_has_gone() -> None:
    bench = tracking()
    bench.state.event = int(FaultCode.COLLISION)
    bench.board.facts.module_losses += 1
    bench.tick(20)
    assert bench.event is FaultCode.COLLISION
    for told in (FaultCode.IO_LOST, FaultCode.NONE):
        bench.state.event = 0
        bench.tick(20)
        assert (bench.mode, bench.event) == (Mode.TRACKING, told)


def test_a_module_lost_before_the_arm_has_power_is_no_answer_to_the_request_for_it() -> None:
    bench = ServoBench()
    bench.board.facts.module_losses = 3
    bench.hold()
    bench.tick(10)
    assert (bench.mode, bench.event) == (Mode.HOLDING, FaultCode.NONE)


def test_one_long_cycle_is_the_machines_fault() -> None:
    bench = tracking()
    for _ in range(5):
        bench.state.busy_ns = 50_000_000
        bench.tick(2)
        bench.state.busy_ns = 1_000
        bench.tick()
    assert (bench.mode, bench.event) == (Mode.TRACKING, FaultCode.NONE)


# ----------------------------------------------------------------------------------------------- saturation and brakes


@law
def pushes_with_all_it_has(
    q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, gravity: Any, friction: Any,
    sensors: Any, gains: Any, memory: Any, tau: Any,
) -> None:  # fmt: skip
    """Full torque on joint 3."""
    for j in range(tau.size):
        tau[j] = gravity[j]
    tau[2] = 1e4


def test_a_torque_at_its_limit_for_half_a_second_stops_the_arm_and_holds_it() -> None:
    bench = ServoBench(law=pushes_with_all_it_has)
    moving(bench, seconds=0.3)
    ticks = bench.until(lambda: bench.mode is Mode.STOPPING)
    assert ticks <= 250
    assert (bench.event, bench.snapshot.event_joint) == (FaultCode.SATURATED, 2)
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert bench.powered


def parked() -> ServoBench:
    bench = ServoBench()
    bench.run(SETTLE_S + 0.05)
    return bench


def drift(bench: ServoBench, joint: int, degrees: float) -> None:
    for _ in range(100):
        bench.q[joint] += math.radians(degrees) / 100
        bench.tick()


def test_a_braked_joint_that_moves_without_power_is_told_of() -> None:
    bench = parked()
    drift(bench, 1, -0.6)
    assert (bench.mode, bench.event, bench.snapshot.event_joint) == (Mode.OFF, FaultCode.BRAKE_SLIP, 1)
    told = incident_of(bench)
    assert (told.mode_from, told.mode_to) == (Mode.OFF, Mode.OFF)
    assert told.value > told.limit == pytest.approx(math.radians(0.5), rel=0.01)
    assert not bench.powered


@pytest.mark.parametrize(("joint", "degrees"), [(1, 0.4), (4, 20.0)])
def test_a_little_play_and_a_wrist_without_brakes_are_no_slip(joint: int, degrees: float) -> None:
    bench = parked()
    drift(bench, joint, degrees)
    assert bench.event is FaultCode.NONE


def test_an_arm_that_comes_to_rest_after_power_off_slips_not() -> None:
    bench = ServoBench().hold()
    bench.mailbox.request_power(False)
    bench.tick(5)
    drift(bench, 0, 2.0)
    bench.run(0.6)
    assert (bench.mode, bench.event) == (Mode.OFF, FaultCode.NONE)


@pytest.mark.parametrize("ms", [30, 300, 3000])
@pytest.mark.parametrize("sag", [3.0, -3.0])
def test_an_arm_that_sagged_while_its_servo_slept_has_lost_the_guardian_and_not_its_brakes(ms: int, sag: float) -> None:
    bench = tracking(guarded=True)
    bench.skip(ms)
    bench.q[1] += math.radians(sag)
    bench.mail.guardian.takeover, bench.mail.guardian.trips = 1, 1
    bench.discrete = 0
    bench.run(1.0)
    assert (bench.mode, bench.fault, bench.event) == (Mode.FAULT, FaultCode.GUARD_TRIP, FaultCode.GUARD_TRIP)
    assert incident_of(bench).code == FaultCode.GUARD_TRIP
    drift(bench, 1, sag / 5)
    assert bench.event is FaultCode.BRAKE_SLIP


@pytest.mark.parametrize("ms", [100, 1000])
def test_a_servo_that_sleeps_while_its_brakes_close_judges_slip_from_where_it_finds_the_arm(ms: int) -> None:
    bench = ServoBench().hold()
    bench.mailbox.request_power(False)
    bench.tick(5)
    bench.skip(ms)
    drift(bench, 1, 2.0)
    bench.run(0.6)
    assert (bench.mode, bench.event) == (Mode.OFF, FaultCode.NONE)


def test_a_slip_that_happens_while_a_servo_sleeps_is_told_of() -> None:
    bench = parked()
    bench.skip(1000)
    bench.q[1] -= math.radians(0.6)
    bench.tick(1)
    assert bench.event is FaultCode.BRAKE_SLIP


def test_as_long_as_the_board_shows_power_no_brake_has_slipped() -> None:
    bench = ServoBench().hold()
    bench.mailbox.request_power(False)
    bench.status = STATUS_POWER | STATUS_ESTOP_OK | STATUS_CALIBRATED
    bench.run(0.6)
    drift(bench, 1, -2.0)
    assert bench.event is FaultCode.NONE
    bench.status = None
    bench.run(0.3)
    drift(bench, 1, -0.6)
    assert bench.event is FaultCode.BRAKE_SLIP


# ------------------------------------------------------------------------------------------------------- the incident


def test_there_is_no_incident_before_something_happened() -> None:
    assert read_incident(np.zeros(INCIDENT_WORDS, dtype=np.int64)) is None
    bench = tracking()
    bench.mailbox.request_stop()
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert read_incident(bench.state.watch.incident) is None  # asked for


def test_an_incident_tells_what_was_measured_where_and_what_became_of_it() -> None:
    bench = tracking()
    v_max = bench.robot.limits.v_max[0]
    for _ in range(2):
        bench.state.v[0] = 1.55 * v_max
        bench.tick()
    told = incident_of(bench)
    assert (told.number, told.code, told.joint) == (1, FaultCode.VEL_LIMIT, 0)
    assert (told.mode_from, told.mode_to) == (Mode.TRACKING, Mode.STOPPING)
    assert told.tick == bench.snapshot.tick
    assert told.value > told.limit == pytest.approx(1.1 * v_max)
    assert told.measured(bench.robot.prismatic) == f"joint 1: {told.value:.4g} rad/s, limit {told.limit:.4g} rad/s"
    assert told.line(bench.robot.prismatic).startswith("TRACKING -> STOPPING: joint 1: ")
    assert told.to_dict()["name"] == "VEL_LIMIT"


def test_a_sliding_joint_is_told_of_in_metres() -> None:
    stanford = load_robot("stanford")
    joint = int(np.flatnonzero(stanford.prismatic)[0])
    told = Incident(1, 0, 0, int(FaultCode.FOLLOWING), joint, 0.2, 0.1, 5, 7, 3)
    assert told.measured(stanford.prismatic) == f"joint {joint + 1}: 0.2 m, limit 0.1 m"


def test_an_event_without_a_measurement_is_told_of_without() -> None:
    bench = tracking()
    bench.estop_ok = False
    bench.tick()
    told = incident_of(bench)
    assert told.measured(bench.robot.prismatic) == ""
    assert "ESTOP: " in told.line(bench.robot.prismatic)


# ---------------------------------------------------------------------------------------------- boards asked seldom


@pytest.mark.parametrize(
    ("rate_hz", "exchange_ms", "noticed"),
    [(1000.0, 1.0, True), (1000.0, 3.0, True), (1000.0, 4.0, False), (250.0, 4.0, True)],
)
def test_a_board_that_is_asked_so_seldom_that_no_push_is_noticed_is_refused(
    rate_hz: float, exchange_ms: float, noticed: bool
) -> None:
    bench = ServoBench(rate_hz=rate_hz, obeys_model=True, board_timeout_ms=20.0).hold()
    bench.follows, cycles, first = False, round(exchange_ms * 1e-3 * rate_hz), bench.state.tick

    def push(_now_ns: int) -> None:
        bench.q[0] += 0.4 / rate_hz
        bench.frozen = (bench.state.tick - first) % cycles != 0

    bench.before.append(push)
    bench.run(0.08)
    assert (bench.event is not FaultCode.NONE) == noticed
    settings = ServoSettings(rate_hz=rate_hz, exchange_ms=exchange_ms, board_timeout_ms=20.0)
    if noticed:
        check_exchanges(settings)
        return
    with pytest.raises(
        ConfigError, match="would notice no collision and no dead encoder behind a board that is asked every"
    ):
        check_exchanges(settings)
    check_exchanges(ServoSettings(rate_hz=rate_hz, exchange_ms=exchange_ms, position_drives=True))


def test_a_servo_does_not_start_behind_a_board_that_is_asked_too_seldom() -> None:
    settings = ServoSettings(exchange_ms=4.0, unchecked_gains=True)
    with (
        QueuedReport(lambda _line: None) as report,
        pytest.raises(ConfigError, match=r"lower rate_hz to 326 at most, .* every 3\.26 ms at least"),
    ):
        serve("nobody", load_robot("puma560"), settings, False, report, lambda: None)


@pytest.mark.parametrize(
    ("rate_hz", "exchange_ms"),
    [(300.0, 8.0), (300.0, 12.9), (1000.0, 4.0), (1000.0, 12.9), (4000.0, 4.0), (4000.0, 12.9)],
)
def test_the_rate_and_the_time_between_exchanges_that_are_told_are_taken(rate_hz: float, exchange_ms: float) -> None:
    with pytest.raises(ConfigError) as refusal:
        check_exchanges(ServoSettings(rate_hz=rate_hz, exchange_ms=exchange_ms))
    told = re.search(r"to (\d+) at most, .* every ([\d.]+) ms at least", str(refusal.value))
    assert told is not None
    check_exchanges(ServoSettings(rate_hz=float(told[1]), exchange_ms=exchange_ms))
    check_exchanges(ServoSettings(rate_hz=rate_hz, exchange_ms=float(told[2])))


def test_no_rate_is_advised_that_a_deployment_file_does_not_take() -> None:
    with pytest.raises(ConfigError, match=r"every 20 ms: ask the board every 3\.26 ms at least"):
        check_exchanges(ServoSettings(rate_hz=1000.0, exchange_ms=20.0))
