"""An encoder whose cable comes off while the arm holds or moves: power goes before the joint has gone five degrees.

Nothing tells it directly: counts and index pulses both stay away, as of a joint at rest. On the way the torque since
the last count does, in every deployment. At rest nothing is known of the joint's friction, and it is the potentiometer
that does, with a calibration table or without; of an arm without potentiometers the promise is weaker, and stands here
too.
"""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.calibration.potentiometers import MOST_SILENCES, are_silent, forget_pots, watch_pots
from qrobot.servo.calibration.state import PLAUSIBLE, PROVEN, REFUTED, SILENT, UNJUDGED, UNPROVEN
from qrobot.servo.checks.potentiometer_monitor import wanted_channels
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.memory.stop_record import read_incident
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.board import BoardOptions
from qrobot.sim_board.emulator import Emulator
from tests.property.test_motor_campaign import random_path
from tests.support.campaign import FRAME_NS, FRAME_S, PUMA, N
from tests.support.dead_encoder import TABLE, Case, SlowArm, run_case
from tests.support.thorough import wide, wide_rows

SPEEDS = (0.02, 0.1, 1.0)
WAYS = ((1.0, 0), (-1.0, 0), (1.0, 3))  # and plants
DEGREES = 5.0
BLIND_DEGREES = 8.0  # without potentiometers


def every(moving: bool, table: bool) -> list[Case]:
    """Joints with brakes, speeds, ways and plants."""
    return [
        Case(joint, sign * speed, moving, table, draw) for joint in (1, 2, 3) for speed in SPEEDS for sign, draw in WAYS
    ]


def _soonest(case: Case) -> float:
    """Seconds in which it is found: on the way, where the counts that a slow joint lacks take longer to come; at rest
    from the first motion of a reference, which takes 0.15 s to its speed.
    """
    if case.moving:
        return 0.15 if abs(case.speed) >= 0.05 else 0.25
    return {0.02: 1.2, 0.1: 0.4, 1.0: 0.2}[abs(case.speed)]


@pytest.mark.sampled(18)
@pytest.mark.parametrize("case", [*every(True, True), *every(False, True)], ids=str)
def test_a_cable_that_comes_off_costs_the_power_within_five_degrees(case: Case) -> None:
    result = run_case(case)
    assert result.code is FaultCode.ENC_STUCK
    assert result.degrees <= DEGREES
    assert result.seconds <= _soonest(case)


@pytest.mark.sampled(12)
@pytest.mark.parametrize("case", every(False, False), ids=str)
def test_without_a_calibration_table_the_potentiometers_see_it_at_rest_all_the_same(case: Case) -> None:
    result = run_case(case)
    assert result.code is FaultCode.ENC_STUCK
    assert result.degrees <= DEGREES
    assert result.seconds <= _soonest(case)


@pytest.mark.parametrize("case", [case for case in every(True, False) if case.draw == 3], ids=str)
def test_nor_is_a_table_needed_on_the_way(case: Case) -> None:
    result = run_case(case)
    assert result.code is FaultCode.ENC_STUCK
    assert result.degrees <= DEGREES
    assert result.seconds <= _soonest(case)


@pytest.mark.sampled(12)
@pytest.mark.parametrize("case", every(moving=True, table=False), ids=str)
def test_without_potentiometers_it_is_found_by_the_torque_since_the_last_count(case: Case) -> None:
    result = run_case(case, pots=False)
    assert result.code is FaultCode.ENC_STUCK
    assert result.degrees <= BLIND_DEGREES
    assert result.seconds <= (0.4 if abs(case.speed) < 0.1 else 0.06)


@pytest.mark.parametrize("case", [case for case in every(False, False) if abs(case.speed) == 1.0], ids=str)
def test_without_potentiometers_a_fast_start_is_cut_as_soon(case: Case) -> None:
    result = run_case(case, pots=False)
    assert result.code is FaultCode.ENC_STUCK
    assert result.degrees <= DEGREES


@pytest.mark.parametrize(("rate_hz", "velocity"), [(2000.0, "observer"), (4000.0, "difference")])
@pytest.mark.parametrize("moving", [False, True])
def test_rate_and_estimator_make_no_difference(rate_hz: float, velocity: str, moving: bool) -> None:
    for joint in (1, 2, 3):
        result = run_case(Case(joint, 0.02, moving, True, 0), rate_hz, velocity=velocity)
        assert result.code is FaultCode.ENC_STUCK
        assert result.degrees <= DEGREES


@pytest.mark.parametrize("cycles", [*wide(2), 3])
def test_behind_a_board_that_is_asked_seldom_it_is_found_as_soon(cycles: int) -> None:
    """What a joint has missed is reckoned over all of the time between two images."""
    for joint, moving in ((1, True), (2, True), (1, False), (3, False)):
        result = run_case(Case(joint, 1.0, moving, False), cycles=cycles, pots=False, board_timeout_ms=20.0)
        assert result.code is FaultCode.ENC_STUCK
        assert result.degrees <= DEGREES
    result = run_case(Case(1, 0.02, False, False), cycles=cycles, pots=False, board_timeout_ms=20.0)
    asked_always = run_case(Case(1, 0.02, False, False), pots=False)
    assert result.degrees <= 1.05 * asked_always.degrees


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_holding_still_an_arm_with_a_dead_encoder_stays_where_it_is(joint: int) -> None:
    arm = SlowArm(Case(joint, 0.0, False, True, 0))
    before = arm.angle
    arm.pull_cable()
    arm.rig.run_for(10.0)
    assert arm.mode is Mode.HOLDING
    assert abs(arm.angle - before) < 1e-3


@pytest.mark.parametrize("table", [False, True])
@pytest.mark.parametrize("draw", [None, 0])
def test_a_brake_that_did_not_release_is_told_by_its_name_where_a_potentiometer_sees_it(
    table: bool, draw: int | None
) -> None:
    for joint in (1, 2, 3):
        arm = SlowArm(Case(joint, 0.3, False, table, draw), 1000.0, f"brake:{joint} stuck")
        result = arm.suffer()
        assert result.code is (FaultCode.BRAKE_STUCK if table else FaultCode.ENC_STUCK)
        assert result.degrees < 0.05
        assert not arm.rig.emulator.powered


@pytest.mark.parametrize("line", ["pot:2 dead", "pot:2 noise 10", "pot:2 wrong 0.3", "adc stuck"])
def test_a_potentiometer_that_fails_does_not_stop_an_arm_whose_encoders_count(line: str) -> None:
    arm = SlowArm(Case(2, 0.05, True, True))
    arm.rig.emulator.faults.add(line)
    for _ in range(150):
        arm.frame()
    assert arm.mode is Mode.TRACKING


LIARS = ("pot:2 dead", "pot:2 noise 10", "pot:2 noise 40", "pot:2 wrong 0.3", "adc stuck")


@pytest.mark.parametrize("line", LIARS)
def test_without_a_table_a_potentiometer_that_was_bad_before_power_stops_nothing_that_moves(line: str) -> None:
    arm = SlowArm(Case(2, 0.05, True, False), 1000.0, line)
    for _ in range(150):
        arm.frame()
    assert arm.mode is Mode.TRACKING


@pytest.mark.parametrize("line", LIARS)
def test_nor_does_it_excuse_an_encoder_that_the_torque_accuses(line: str) -> None:
    arm = SlowArm(Case(2, 0.1, True, False), 1000.0, line)
    for _ in range(30):
        arm.frame()
    arm.pull_cable()
    result = arm.suffer()
    assert result.code is FaultCode.ENC_STUCK
    assert result.degrees <= BLIND_DEGREES


@pytest.mark.parametrize("pot_per_rev", [150.1, -60.0, 400.0])
def test_a_slope_that_the_robot_file_has_wrong_refutes_the_potentiometers_and_stops_nothing(pot_per_rev: float) -> None:
    wired = PUMA.model_copy(update={"transmission": PUMA.transmission.model_copy(update={"pot_per_rev": pot_per_rev})})
    rig = LockstepRig(PUMA, ServoSettings(), Emulator(wired, start="ready", physics="rigid"), keep_telemetry=False)
    rig.run_for(0.3)
    rig.mailbox.request_power(True)
    rig.run_for(0.5)
    for seq, q in enumerate(random_path(5, 20.0)):
        rig.mailbox.push_setpoint(1, seq, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
        rig.run_for(FRAME_S)
    assert read_incident(rig.state.watch.incident) is None
    assert (rig.state.pots.proof[:3] == REFUTED).all()


@pytest.mark.parametrize(("rate_hz", "cycles"), [(1000.0, 1), (4000.0, 1), (500.0, 1), (1000.0, 3)])
def test_without_a_table_potentiometers_are_heard_however_soon_power_is_asked_for(rate_hz: float, cycles: int) -> None:
    settings = {} if cycles == 1 else {"board_timeout_ms": 20.0}
    arm = SlowArm(Case(2, 0.02, False, False, 0), rate_hz, cycles=cycles, after_s=0.005, **settings)
    assert arm.rig.state.pots.verdict == PLAUSIBLE
    arm.pull_cable()
    result = arm.suffer()
    assert result.code is FaultCode.ENC_STUCK
    assert result.degrees <= DEGREES


@pytest.mark.sampled(6)
@pytest.mark.parametrize("table", [False, True])
@pytest.mark.parametrize("speed", [0.05, -0.3, 1.0])
@pytest.mark.parametrize(("rate_hz", "cycles"), [(1000.0, 1), (4000.0, 1), (1000.0, 3)])
def test_what_holds_a_joint_on_its_way_is_pushed_no_harder_than_is_told(
    rate_hz: float, cycles: int, speed: float, table: bool
) -> None:
    """Encoder and potentiometer agree that it stands, so it is no dead encoder; what it pushes may be somebody."""
    settings = {} if cycles == 1 else {"board_timeout_ms": 20.0}
    arm = SlowArm(Case(2, speed, True, table), rate_hz, cycles=cycles, **settings)
    for _ in range(round(max(0.25 / abs(speed), 0.6) / FRAME_S)):
        arm.frame()
    assert arm.rig.state.pots.proof[1] == PROVEN
    arm.rig.emulator.faults.add("brake:2 stuck")
    pushes = []
    for _ in range(round(2.0 / FRAME_S)):
        arm.frame()
        pushes.append(abs(float(arm.rig.state.watch.push[1])))
    told = read_incident(arm.rig.state.watch.incident)
    assert told is not None
    assert (FaultCode(told.code), told.joint) == (FaultCode.COLLISION, 1)
    assert arm.mode is Mode.HOLDING
    assert max(pushes) <= 1.5 * PUMA.guard.unexplained_torque_or_default[1]


@pytest.mark.parametrize("table", [False, True])
def test_an_answer_of_a_sensor_says_nothing_of_potentiometers_that_are_silent(table: bool) -> None:
    rig = LockstepRig(PUMA, ServoSettings(sensor_channels=(6,), calibration=TABLE if table else None))
    state, pots = rig.state, rig.state.pots
    pots.verdict = SILENT
    watch_pots(rig.params, state, -1)
    watch_pots(rig.params, state, 6)
    assert pots.verdict == SILENT
    watch_pots(rig.params, state, 0)
    assert pots.verdict == (UNJUDGED if table else SILENT)  # without one nobody asks them any more


@pytest.mark.parametrize("table", [False, True])
def test_a_sensor_that_is_silent_says_nothing_of_potentiometers_that_are_not(table: bool) -> None:
    rig = LockstepRig(PUMA, ServoSettings(sensor_channels=(6,), calibration=TABLE if table else None))
    silent = rig.state.adc.lost
    silent[6] = 100
    assert not are_silent(rig.params, rig.state)
    silent[2] = MOST_SILENCES
    assert are_silent(rig.params, rig.state)
    forget_pots(rig.params, rig.state)
    assert not are_silent(rig.params, rig.state)


def test_potentiometers_that_nobody_has_heard_take_nothing_from_a_sensor_under_torque() -> None:
    arm = SlowArm(Case(1, 0.0, False, False), sensor_channels=(6,))
    arm.rig.state.pots.verdict = UNJUDGED
    assert wanted_channels(arm.rig.params, arm.rig.state) == 1 << 6


LONG_CONVERSIONS = [(4000.0, 1), (1000.0, 2), (1000.0, 3)]  # of two servo cycles and more: rate, cycles an exchange


@pytest.mark.parametrize(("rate_hz", "cycles"), LONG_CONVERSIONS)
def test_beside_a_sensor_every_potentiometer_is_read_however_slowly(rate_hz: float, cycles: int) -> None:
    arm = SlowArm(Case(1, 0.0, False, True), rate_hz, cycles=cycles, sensor_channels=(6,), board_timeout_ms=20.0)
    before = arm.rig.state.adc.done.copy()
    arm.rig.run_for(2.0)
    done = arm.rig.state.adc.done - before
    assert done[:N].min() >= 0.02 * done.sum()
    assert done[6] >= 0.7 * done.sum()


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("rate_hz", "cycles"), LONG_CONVERSIONS)
def test_so_it_is_beside_a_joint_that_shows_no_count_though_driven(rate_hz: float, cycles: int) -> None:
    arm = SlowArm(Case(1, 0.0, False, True), rate_hz, cycles=cycles, board_timeout_ms=20.0)
    watch, before = arm.rig.state.watch, arm.rig.state.adc.done.copy()
    for _ in range(round(2.0 * rate_hz)):
        watch.driven[2], watch.still_s[2] = 1, 1.0
        arm.rig.ticks(1)
    done = arm.rig.state.adc.done - before
    assert done[:N].min() >= 0.04 * done.sum()
    assert done[2] >= 0.6 * done.sum()


BEYOND = -3.4  # rad of joint 6, where its potentiometer has stood at an end of its track for six turns of its motor


@pytest.mark.parametrize("table", [False, True])
@pytest.mark.parametrize(
    ("cycles", "draw", "creep"), [(1, 0, 0.05), *wide_rows((2, 0, 0.05), (3, 0, -0.05), (3, None, -0.05))]
)
def test_a_potentiometer_at_the_end_of_its_track_accuses_no_encoder(
    cycles: int, draw: int | None, creep: float, table: bool
) -> None:
    """Its reading less what the counts account for goes as far as the motor; a mean of that lags behind."""
    arm = SlowArm(Case(6, 0.0, False, table, draw), cycles=cycles, board_timeout_ms=20.0)
    for far, share in ((-3.8, 0.5), (-3.93, 0.95), (-4.06, 0.5), (-4.19, 0.5)):
        arm.go(far, share)
        arm.go(far + creep, 0.01)
        arm.go(-1.5, share)
    assert read_incident(arm.rig.state.watch.incident) is None
    assert arm.rig.state.pots.trusted[5] == 1
    assert arm.rig.state.pots.proof[5] == PROVEN


@pytest.mark.parametrize("table", [False, True])
@pytest.mark.parametrize("speed", [1.0, 0.1, -0.1, -1.0])
def test_nor_does_it_excuse_one_whose_joint_must_have_moved(speed: float, table: bool) -> None:
    """It would stand as well if the motor stood."""
    arm = SlowArm(Case(6, speed, False, table))
    arm.go(BEYOND)
    assert abs(arm.rig.state.sensors[5]) < 0.02  # V: its track begins at 0
    arm.pull_cable()
    result = arm.suffer()
    assert result.code is FaultCode.ENC_STUCK
    assert result.degrees <= DEGREES


def test_a_potentiometer_that_goes_with_its_encoder_is_trusted_without_a_table() -> None:
    arm = SlowArm(Case(1, 0.5, True, False))
    assert arm.rig.state.pots.proof[0] == UNPROVEN
    for _ in range(30):
        arm.frame()
    assert arm.rig.state.pots.proof[0] == PROVEN


@pytest.mark.parametrize("proof", [PROVEN, REFUTED])
def test_what_a_potentiometer_has_shown_without_a_table_counts_until_power_goes(proof: int) -> None:
    rig = LockstepRig(PUMA, ServoSettings(), Emulator(PUMA, physics="rigid"), keep_telemetry=False)
    pots = rig.state.pots
    rig.run_for(0.2)
    rig.mailbox.request_power(True)
    rig.run_for(0.1)
    assert (pots.proof == UNPROVEN).all()
    pots.proof[:] = proof
    rig.mailbox.request_power(False)
    rig.run_for(0.05)
    rig.mailbox.request_power(True)
    rig.run_for(0.1)
    assert (pots.proof == UNPROVEN).all()


@pytest.mark.parametrize("table", [False, True])
def test_the_coarse_converter_of_revision_e_accuses_no_slow_joint(table: bool) -> None:
    settings = ServoSettings(calibration=TABLE if table else None)
    plant = Emulator(PUMA, physics="rigid", options=BoardOptions(revision_f=False))
    rig = LockstepRig(PUMA, settings, plant, keep_telemetry=False)
    rig.run_for(0.3)
    rig.mailbox.request_power(True)
    rig.run_for(0.5)
    start = np.array(rig.mailbox.snapshot().q_setpoint)
    for seq in range(500):
        q = start + 0.004 * seq * FRAME_S * np.array([1.0, -1.0, 1.0, 1.0, 1.0, 1.0])
        rig.mailbox.push_setpoint(1, seq, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
        rig.run_for(FRAME_S)
    assert Mode(rig.mailbox.snapshot().mode) is Mode.TRACKING


@pytest.mark.parametrize(
    ("rate_hz", "velocity", "draw", "cycles"),
    [
        (1000.0, "difference", 2, 3),
        *wide_rows((1000.0, "difference", 2, 1), (4000.0, "observer", 3, 1), (1000.0, "observer", 3, 2)),
    ],
)
def test_a_wrong_model_and_an_unknown_load_are_no_dead_encoder(
    rate_hz: float, velocity: str, draw: int, cycles: int
) -> None:
    settings = {} if cycles == 1 else {"board_timeout_ms": 20.0}
    arm = SlowArm(Case(1, 0.0, False, True, draw), rate_hz, cycles=cycles, velocity=velocity, **settings)
    path = random_path(draw, 30.0)
    slow = path[0] + np.cumsum(np.repeat(np.diff(path[:200], axis=0) / 20.0, 3, axis=0), axis=0)
    home = np.linspace(arm.start, path[0], 150)
    rows = np.vstack([home, slow, np.linspace(slow[-1], path[0], 150), path])
    for seq, q in enumerate(rows):
        arm.rig.mailbox.push_setpoint(1, seq, arm.rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * N, q.tolist())
        arm.rig.run_for(FRAME_S)
    assert read_incident(arm.rig.state.watch.incident) is None
    assert arm.mode is Mode.TRACKING
