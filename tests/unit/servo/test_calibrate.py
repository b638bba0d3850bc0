"""Calibration in lock-step: counters come out exact, or every reason why not is a code of its own."""

from __future__ import annotations

import itertools
import signal
from collections.abc import Callable

import numpy as np
import pytest

from qrobot.errors import ConfigError, LinkTimeout, ServoFault
from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.hwif.registers import DISCRETE, DISCRETE_CALIBRATED, ENC_LOAD
from qrobot.modecodes import Mode
from qrobot.model.transmission import count_word
from qrobot.rig.interrupts import interrupted_by_signals
from qrobot.rig.table_maker import make_table
from qrobot.servo.calibration.state import DEFAULT_INDEXES, PLAUSIBLE, Stage
from qrobot.servo.calibration.table import CalibrationTable
from qrobot.servo.event import report_fault
from qrobot.servo.memory.mailbox import ServoMailbox
from qrobot.servo.memory.published_state import FLAG_CALIBRATED, FLAG_ESTOP_OK
from qrobot.servo.memory.stop_record import read_incident
from qrobot.servo.operator.calibration_client import run_calibration
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.faults import FaultPlan
from tests.support.calibrating import PUMA, TABLE, CalibratingRig, random_pose
from tests.support.servo_bench import ServoBench, Write
from tests.support.signals import at_once, default_signals


def refused(rig: CalibratingRig, code: FaultCode, joint: int) -> None:
    """Held where it is, not calibrated, with the reason."""
    assert rig.mode is Mode.UNCALIBRATED
    assert rig.event == (code, joint)
    assert not rig.emulator.calibrated
    assert rig.emulator.powered
    rig.run_for(0.3)
    assert np.abs(rig.emulator.v).max() < 0.01


# --- what comes out ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [1000.0, 4000.0])
def test_counters_come_out_exact_and_the_arm_is_held_where_it_is(rate_hz: float) -> None:
    rig = CalibratingRig(random_pose(1), rate_hz=rate_hz).calibrating(until=Stage.MARKING)
    before = rig.emulator.q
    rig.finish()
    assert rig.mode is Mode.HOLDING
    assert rig.exact()
    assert rig.emulator.calibrated
    assert np.abs(rig.emulator.q - before).max() < 1e-4
    assert rig.seen.flags & FLAG_CALIBRATED
    assert np.abs(rig.seen.q - rig.emulator.q).max() < 2e-4


def test_the_wrist_comes_after_joint_four_and_the_pulses_agree() -> None:
    rig, joints = CalibratingRig(), []
    rig.powered().mailbox.request_calibration()
    rig.run_for(0.05)
    while rig.mode is Mode.CALIBRATING:
        joints.append(rig.mailbox.calibration().joint)
        rig.run_for(0.05)
    assert sorted(set(joints[:-40])) == list(range(PUMA.n))
    found = rig.mailbox.calibration()
    assert found.votes.tolist() == [5] * PUMA.n
    assert (found.misfit < 15.0).all()
    assert (found.margin > 100.0).all()


@pytest.mark.parametrize("indexes", [3, 14])
def test_three_pulses_are_enough_and_fourteen_possible(indexes: int) -> None:
    rig = CalibratingRig(random_pose(2))
    report = rig.calibrate(indexes)
    assert report.indexes == indexes
    assert report.votes == [indexes] * PUMA.n
    assert rig.exact()


@pytest.mark.parametrize("end", ["q_min", "q_max"])
def test_at_the_end_of_its_range_an_arm_makes_room_for_itself(end: str) -> None:
    pose = getattr(PUMA.limits, end).copy()
    pose[-1] *= 0.5  # beyond that its potentiometer's track ends
    rig = CalibratingRig(pose)
    rig.powered().mailbox.request_calibration()
    low, high = rig.emulator.q, rig.emulator.q
    for _ in range(600):
        rig.run_for(0.1)
        low, high = np.minimum(low, rig.emulator.q), np.maximum(high, rig.emulator.q)
        if rig.mode is not Mode.CALIBRATING:
            break
    assert rig.mode is Mode.HOLDING
    assert rig.exact()
    assert (low > PUMA.limits.q_min - 0.05).all()
    assert (high < PUMA.limits.q_max + 0.05).all()


def test_backlash_and_tenfold_noise_of_the_potentiometers_do_not_matter() -> None:
    rig = CalibratingRig(random_pose(3))
    rig.emulator.bundle.board.analog["backlash"] = 0.3
    rig.emulator.bundle.board.analog["noise"] = 50.0
    rig.calibrate()
    assert rig.exact()


def test_a_joint_that_stops_on_an_encoders_edge_is_nudged_until_its_counter_is_quiet() -> None:
    rig = CalibratingRig(np.radians([43.3, -122.8, 183.6, -55.7, -21.9, 158.5]), seed=11)
    rig.calibrate()
    assert rig.exact()


def test_before_calibration_the_potentiometers_give_a_rough_pose_that_carries_the_arm() -> None:
    pose = np.radians([20.0, 0.0, 90.0, 10.0, 30.0, 50.0])  # stretched level: 37 to 46 N m on joint 2
    rig = CalibratingRig(pose).powered()
    assert rig.mode is Mode.UNCALIBRATED
    assert np.abs(rig.seen.q - pose).max() < 0.03
    rig.run_for(1.0)
    assert np.abs(rig.emulator.q - pose).max() < 0.004


def test_motion_never_exceeds_the_creeping_speed_by_much() -> None:
    rig = CalibratingRig(random_pose(4))
    rig.powered().mailbox.request_calibration()
    fastest = np.zeros(PUMA.n)
    rig.run_for(0.1)
    while rig.mode is Mode.CALIBRATING:
        fastest = np.maximum(fastest, np.abs(rig.emulator.v))
        rig.run_for(0.02)
    assert (fastest < 1.5 * rig.params.creep_speed).all()
    assert (rig.params.creep_speed <= 0.3).all()


# --- a board that is calibrated ------------------------------------------------------------------------------------


def test_a_servo_started_again_adopts_a_calibrated_board_without_moving_it() -> None:
    first = CalibratingRig(random_pose(5))
    first.calibrate()
    first.run_for(0.5)
    standing = first.emulator.q
    second = CalibratingRig(emulator=first.emulator)
    second.run_for(0.5)
    assert second.seen.flags & FLAG_CALIBRATED
    assert np.abs(second.seen.q - second.emulator.q).max() < 2e-4
    assert second.powered().mode is Mode.HOLDING
    assert np.abs(second.emulator.q - standing).max() < 0.005
    assert second.calibrate().was_calibrated
    assert second.exact()


def contradicted() -> CalibratingRig:
    """A calibrated board, one of whose counters is two motor turns off."""
    rig = CalibratingRig(calibrated=True)
    rig.emulator.bundle.board.encoders.counter[3] += 2 * 1000
    rig.emulator.connect(rig.board, rig.now_ns)
    return rig


def test_counters_that_the_potentiometers_contradict_get_no_power_and_are_mended_by_a_calibration() -> None:
    rig = contradicted()
    rig.powered()
    assert rig.mode is Mode.OFF
    assert rig.event == (FaultCode.CAL_MISMATCH, 3)
    assert not rig.emulator.powered
    assert not rig.calibrate().was_calibrated
    assert rig.exact()


@pytest.mark.parametrize("seconds", [0.0, 0.01, 0.5])
def test_counters_that_are_contradicted_are_mended_though_nobody_has_asked_for_power(seconds: float) -> None:
    """So long after the servo has met the board."""
    rig = contradicted()
    rig.run_for(seconds)
    assert not rig.calibrate(3).was_calibrated
    assert rig.exact()


def ask_beside_an_emergency_stop(rig: CalibratingRig) -> None:
    rig.board.panel.estop = 1
    rig.run_for(0.1)
    rig.powered()
    rig.board.panel.estop = 0


def ask_beside_a_stop(rig: CalibratingRig) -> None:
    rig.mailbox.request_stop()
    rig.powered()


@pytest.mark.parametrize(
    ("ask", "told"), [(ask_beside_an_emergency_stop, FaultCode.ESTOP), (ask_beside_a_stop, FaultCode.POWER_STOPPED)]
)
def test_counters_that_are_contradicted_are_mended_whatever_has_been_told_last(
    ask: Callable[[CalibratingRig], None], told: FaultCode
) -> None:
    rig = contradicted()
    rig.powered()
    rig.mailbox.request_power(False)
    rig.run_for(0.1)
    ask(rig)
    assert rig.event[0] is told
    assert not rig.seen.flags & FLAG_CALIBRATED
    assert not rig.calibrate(3).was_calibrated
    assert rig.exact()


def test_an_arm_with_right_counters_is_not_powered_to_find_that_out() -> None:
    rig = CalibratingRig(calibrated=True)
    assert rig.calibrate().was_calibrated
    assert rig.seen.pots_verdict == PLAUSIBLE
    assert rig.mailbox.memory.command.power_ons == 0


@pytest.mark.parametrize("table", [TABLE, None])
def test_of_a_board_that_is_away_nobody_says_that_it_has_kept_its_counters(table: CalibrationTable | None) -> None:
    rig = CalibratingRig(calibrated=True, table=table)
    rig.run_for(0.5)
    assert rig.seen.flags & FLAG_CALIBRATED

    def wait(_seconds: float) -> None:
        for _ in range(20):
            rig.compute()  # no image comes meanwhile

    wait(0.0)
    assert not rig.seen.flags & FLAG_CALIBRATED
    assert rig.seen.flags & FLAG_ESTOP_OK  # nobody has seen it pressed
    with pytest.raises(ServoFault, match="no arm power: BOARD_GONE") as refusal:
        run_calibration(rig.mailbox, wait)
    assert refusal.value.code == FaultCode.BOARD_GONE


def test_counters_that_have_jumped_are_not_calibrated_before_the_fault_is_cleared_either() -> None:
    rig = CalibratingRig(calibrated=True).powered()
    rig.emulator.bundle.board.encoders.counter[3] += 2 * 1000
    rig.run_for(0.1)
    assert rig.event == (FaultCode.ENC_JUMP, 3)
    assert not rig.seen.flags & FLAG_CALIBRATED
    with pytest.raises(ServoFault, match="in mode FAULT, not OFF: joint 4: ENC_JUMP"):
        rig.calibrate()


@pytest.mark.parametrize("code", [FaultCode.ENC_STUCK, FaultCode.ENC_SIGN])
def test_an_encoder_that_did_not_count_has_to_be_calibrated_and_can_be(code: FaultCode) -> None:
    """What it has not counted is lost, and may be less than the potentiometers can tell."""
    rig = CalibratingRig(calibrated=True).powered()
    rig.emulator.bundle.board.encoders.counter[1] -= 20
    report_fault(rig.state, code, 1)
    rig.run_for(0.5)
    assert (rig.mode, rig.event) == (Mode.FAULT, (code, 1))
    assert not rig.seen.flags & FLAG_CALIBRATED
    assert not rig.emulator.calibrated
    rig.mailbox.request_power(False)
    rig.mailbox.request_clear()
    rig.run_for(0.2)
    assert not rig.calibrate().was_calibrated
    assert rig.exact()


def test_without_a_table_an_arm_stays_as_calibrated_as_it_was() -> None:
    rig = CalibratingRig(calibrated=True, table=None).powered()
    report_fault(rig.state, FaultCode.ENC_STUCK, 1)
    rig.run_for(0.1)
    assert rig.mode is Mode.FAULT
    assert rig.emulator.calibrated


@pytest.mark.parametrize("table", [TABLE, None])
def test_counters_that_have_jumped_are_calibrated_in_no_cycle_after_the_fault_is_cleared(
    table: CalibrationTable | None,
) -> None:
    rig = CalibratingRig(calibrated=True, table=table).powered()
    rig.emulator.bundle.board.encoders.counter[3] += 2 * 1000
    rig.run_for(0.1)
    rig.mailbox.request_power(False)
    rig.mailbox.request_clear()
    for _ in range(100):  # the board tells some cycles later that they are not
        rig.run_for(0.001)
        assert not rig.seen.flags & FLAG_CALIBRATED
    assert rig.seen.mode == Mode.OFF


def test_power_asked_for_at_once_waits_for_the_potentiometers() -> None:
    rig = CalibratingRig(calibrated=True)
    rig.mailbox.request_power(True)
    rig.ticks(5)
    assert not rig.emulator.powered
    rig.run_for(0.2)
    assert rig.mode is Mode.HOLDING


def test_potentiometers_that_do_not_answer_keep_the_arm_without_power_until_they_do() -> None:
    rig = CalibratingRig(calibrated=True, conversion_ns=1 << 50).powered()
    assert rig.mode is Mode.OFF
    assert rig.event[0] is FaultCode.CAL_MISMATCH
    rig.emulator.bundle.board.options["conversion_ns"] = 20_000
    rig.mailbox.request_power(False)
    rig.run_for(0.1)
    assert rig.powered().mode is Mode.HOLDING
    assert rig.emulator.calibrated


def test_counters_that_lost_turns_while_the_arm_had_no_power_get_it_no_more() -> None:
    rig = CalibratingRig(calibrated=True)
    rig.mailbox.request_power(True)
    rig.run_for(0.1)
    assert rig.mode is Mode.HOLDING
    rig.mailbox.request_power(False)
    rig.run_for(0.02)
    assert rig.mode is Mode.OFF
    for _ in range(100):  # two motor turns of joint 4, which has no brake: its encoder is plugged in again afterwards
        rig.emulator.bundle.board.encoders.counter[3] += 20
        rig.ticks(1)
    rig.run_for(0.1)
    assert rig.event[0] is FaultCode.NONE
    rig.mailbox.request_power(True)
    rig.run_for(0.1)
    assert (rig.mode, rig.event) == (Mode.OFF, (FaultCode.CAL_MISMATCH, 3))
    assert not rig.emulator.powered


def test_a_pose_that_the_potentiometers_tell_late_is_no_slip_of_brakes_and_one_that_follows_is_told() -> None:
    rig = CalibratingRig(conversion_ns=1 << 50)
    rig.run_for(0.3)  # the brakes have caught the arm
    assert np.abs(rig.seen.q - rig.emulator.q).max() > 0.5
    rig.emulator.bundle.board.options["conversion_ns"] = 20_000
    rig.run_for(0.1)
    assert np.abs(rig.seen.q - rig.emulator.q).max() < 0.03
    assert read_incident(rig.state.watch.incident) is None
    for _ in range(round(1.2e3 * PUMA.guard.brake_slip)):
        rig.emulator.bundle.plant.q[1] += 1e-3
        rig.ticks(1)
    assert rig.event == (FaultCode.BRAKE_SLIP, 1)


@pytest.mark.parametrize("joint", range(PUMA.n))
def test_a_calibrated_arm_at_the_end_of_its_range_gets_power_from_both_converters(joint: int) -> None:
    pose = PUMA.poses["park"].copy()
    for end in (PUMA.limits.q_min, PUMA.limits.q_max):
        pose[joint] = end[joint]
        for revision_f in (True, False):
            rig = CalibratingRig(pose, calibrated=True, revision_f=revision_f).powered()
            assert rig.mode is Mode.HOLDING


# --- lost counts ---------------------------------------------------------------------------------------------------


def moved(rig: CalibratingRig, joint: int, turns: float) -> None:
    """Carry a held joint through so many motor turns, with the watch for what pushes it out of the way."""
    bundle = rig.emulator.bundle
    rig.params.watch.unexplained[:] = rig.params.watch.impossible[:] = np.inf
    way = turns * 2.0 * np.pi / PUMA.transmission.gear[joint]
    for step in range(200):
        bundle.plant.q[joint] += way / 200
        rig.state.q_ref[joint] += way / 200
        rig.state.knots[:, joint] += way / 200
        rig.ticks(3)
        if step and rig.mode is Mode.FAULT:
            return


@pytest.mark.parametrize("joint", range(PUMA.n))
def test_whole_counters_stay_calibrated_over_many_index_pulses(joint: int) -> None:
    rig = CalibratingRig(calibrated=True).powered()
    moved(rig, joint, 4.0)
    assert rig.mode is Mode.HOLDING
    assert rig.emulator.calibrated


def test_counts_lost_are_found_at_the_next_index_pulse_and_end_the_calibration() -> None:
    rig = CalibratingRig(calibrated=True).powered()
    moved(rig, 4, 2.0)
    rig.emulator.bundle.board.encoders.counter[4] -= 5
    moved(rig, 4, 1.2)
    assert rig.mode is Mode.FAULT
    assert rig.event == (FaultCode.ENC_LOSS, 4)
    rig.run_for(0.1)
    assert not rig.emulator.calibrated
    rig.mailbox.request_power(False)
    rig.mailbox.request_clear()
    rig.run_for(0.2)
    rig.calibrate()
    assert rig.exact()


def test_three_counts_are_forgiven() -> None:
    rig = CalibratingRig(calibrated=True).powered()
    rig.emulator.bundle.board.encoders.counter[4] += 3
    moved(rig, 4, 2.5)
    assert rig.mode is Mode.HOLDING


# --- why not -------------------------------------------------------------------------------------------------------


def test_without_a_table_it_says_so_and_holds_as_ever() -> None:
    rig = CalibratingRig(table=None).powered()
    rig.mailbox.request_calibration()
    rig.run_for(0.1)
    refused(rig, FaultCode.CAL_NO_TABLE, NO_JOINT)


def test_a_potentiometer_outside_the_table_is_a_mismatch() -> None:
    rig = CalibratingRig().powered()
    rig.emulator.bundle.board.analog.zero[1] += 15_000.0
    rig.mailbox.request_calibration()
    refused(rig.finish(), FaultCode.CAL_MISMATCH, 1)


def test_a_potentiometer_that_reads_nothing_keeps_the_arm_without_power() -> None:
    rig = CalibratingRig()
    rig.emulator.bundle.board.analog.zero[1], rig.emulator.bundle.board.analog.slope[1] = 0.0, 0.0
    rig.powered()
    assert rig.mode is Mode.OFF
    assert rig.event == (FaultCode.CAL_MISMATCH, 1)


def test_a_dead_potentiometer_has_no_majority() -> None:
    rig = CalibratingRig().powered()
    analog = rig.emulator.bundle.board.analog
    analog.zero[2] += analog.slope[2] * analog.wiper[2]
    analog.slope[2] = 0.0
    rig.mailbox.request_calibration()
    refused(rig.finish(), FaultCode.CAL_VOTE, 2)


def test_a_missing_index_pulse_is_tried_twice_and_then_told_within_a_few_turns() -> None:
    rig = CalibratingRig().powered()
    rig.emulator.bundle.board.encoders.counts_per_rev[0] = 1 << 40
    start = rig.emulator.q[0]
    rig.mailbox.request_calibration()
    refused(rig.finish(), FaultCode.CAL_INDEX, 0)
    turn = 2.0 * np.pi / PUMA.transmission.gear[0]
    assert abs(rig.emulator.q[0] - start) < 4.0 * turn


def test_a_joint_whose_last_index_pulse_is_missed_begins_again_where_it_began() -> None:
    """People keep away by as much as one attempt takes."""
    rig = CalibratingRig().calibrating()
    encoders, turn = rig.emulator.bundle.board.encoders, 2.0 * np.pi / PUMA.transmission.gear[0]
    progress, whole, way = rig.mailbox.memory.calibration, int(encoders.counts_per_rev[0]), [float(rig.emulator.q[0])]

    def until(over: Callable[[], bool]) -> None:
        for _ in range(4000):
            if over():
                return
            rig.ticks(10)
            way.append(float(rig.emulator.q[0]))
        raise AssertionError(f"never: {rig.stage.name} of joint {progress.joint}, {rig.event}")

    until(lambda: int(progress.found) == DEFAULT_INDEXES - 1)
    encoders.counts_per_rev[0] = 1 << 40
    until(lambda: rig.stage is Stage.BACKING)
    encoders.counts_per_rev[0] = whole
    until(lambda: rig.stage is Stage.SWEEPING)
    assert way[-1] == pytest.approx(way[0], abs=0.1 * turn)
    assert rig.finish().mode is Mode.HOLDING
    assert rig.exact()
    assert max(way) - way[0] < (DEFAULT_INDEXES + 2) * turn


def test_an_index_pulse_where_none_can_be_is_told() -> None:
    rig = CalibratingRig().powered()
    rig.emulator.bundle.board.encoders.counts_per_rev[4] = 400
    rig.mailbox.request_calibration()
    refused(rig.finish(), FaultCode.CAL_INDEX, 4)


@pytest.mark.parametrize(
    ("fault", "codes"),
    [
        ("pot:3 noise 10", {None}),
        ("pot:3 dead", {FaultCode.CAL_MISMATCH, FaultCode.CAL_VOTE}),
        ("pot:3 wrong 3", {FaultCode.CAL_MISMATCH, FaultCode.CAL_VOTE}),
        ("adc stuck", {FaultCode.CAL_MISMATCH, FaultCode.CAL_VOTE}),
        ("index:3 missing", {FaultCode.CAL_INDEX}),
        ("index:3 double", {FaultCode.CAL_INDEX}),
        ("encoder:3 scale 1.01", {FaultCode.CAL_INDEX}),
        ("encoder:3 lost 500", {FaultCode.CAL_INDEX}),
        ("board slow 5", {FaultCode.BOARD_GONE}),  # older than its time-out of 1 ms
    ],
)
def test_with_a_broken_part_it_is_exact_or_refused(fault: str, codes: set[FaultCode | None]) -> None:
    emulator = Emulator(PUMA, physics="rigid", calibrated=False, faults=FaultPlan.parse([fault]))
    assert CalibratingRig(emulator=emulator).outcome() in codes


@pytest.mark.parametrize("joint", [0, 4])
def test_an_obstacle_ends_it_before_the_torque_is_large(joint: int) -> None:
    rig = CalibratingRig().calibrating(joint=joint)
    limit = rig.params.creep_torque[joint]
    rig.board.panel.push[joint] = -round(1.2e6 * limit)
    rig.run_for(0.2)
    assert rig.event == (FaultCode.CAL_BLOCKED, joint)
    assert rig.mode is Mode.UNCALIBRATED


def test_a_range_too_short_for_the_pulses_wanted_is_told_before_anything_moves() -> None:
    limits = PUMA.limits.model_copy(update={"q_min": PUMA.poses["park"] - 0.3, "q_max": PUMA.poses["park"] + 0.3})
    rig = CalibratingRig(robot=PUMA.model_copy(update={"limits": limits})).powered()
    rig.mailbox.request_calibration(14)
    start = rig.emulator.q
    rig.run_for(0.2)
    refused(rig, FaultCode.CAL_ROOM, 0)
    assert np.abs(rig.emulator.q - start).max() < 1e-3


@pytest.mark.parametrize("stage", [Stage.BACKING, Stage.SWEEPING])
def test_the_end_of_the_range_ends_it_whatever_the_plan_was(stage: Stage) -> None:
    rig = CalibratingRig(PUMA.limits.q_max - 0.02).calibrating(until=stage)
    rig.params.q_min[0], rig.params.q_max[0] = rig.seen.q[0] + 0.2, rig.seen.q[0] - 0.2
    rig.run_for(0.1)
    refused(rig, FaultCode.CAL_ROOM, 0)


@pytest.mark.parametrize("stage", [Stage.SWEEPING, Stage.SETTLING])
def test_a_stop_ends_it_and_the_arm_stays_held(stage: Stage) -> None:
    rig = CalibratingRig().calibrating(until=stage)
    joint = rig.mailbox.calibration().joint
    rig.mailbox.request_stop()
    rig.run_for(0.2)
    refused(rig, FaultCode.CAL_STOPPED, joint)


@pytest.mark.parametrize("late", [True, False])
def test_a_stop_while_the_counters_are_loaded_lets_them_be_and_the_arm_stays_held(late: bool) -> None:
    """`late`: the stop comes before the image with the new counters, else with it."""
    rig = CalibratingRig().calibrating(until=Stage.SETTLING)
    while rig.state.cal.still + 1 < rig.params.settle_cycles:
        rig.ticks(1)
    rig.compute()
    assert rig.stage is Stage.LOADING
    rig.ticks(0 if late else 1)
    rig.mailbox.request_stop()
    rig.compute()
    rig.run_for(0.2)
    assert rig.mode is Mode.HOLDING
    assert rig.emulator.powered
    assert rig.emulator.calibrated
    assert rig.exact()


@pytest.mark.parametrize("exchange_ms", [2, 40])
def test_loaded_counters_are_waited_for_however_rarely_the_board_is_asked(exchange_ms: int) -> None:
    """Each exchange brings an image of what the one before has found posted."""
    bench = ServoBench(calibrated=False, exchange_ms=exchange_ms, board_timeout_ms=2.0 * exchange_ms).hold()
    bench.follows = False
    state, posted, shift = bench.state, list[Write](), 1000
    cal, since, cycles = state.cal, len(bench.writes), itertools.count()
    cal.before[:], cal.words[:] = state.raw, state.raw
    cal.words[0] = count_word(int(state.raw[0]) + shift)
    cal.load, cal.moved, cal.waited, cal.stage = 1, 0, 0, int(Stage.LOADING)
    state.mode = int(Mode.CALIBRATING)

    def exchange(_now_ns: int) -> None:
        bench.frozen = (next(cycles) + 1) % exchange_ms != 0
        if not bench.frozen:
            bench.slip[0] = shift * any(write.offset == ENC_LOAD for write in posted)
            bench.calibrated = any(write.offset == DISCRETE and write.value & DISCRETE_CALIBRATED for write in posted)
            posted[:] = bench.writes[since:]

    bench.before.append(exchange)
    bench.tick()
    bench.until(lambda: bench.mode is not Mode.CALIBRATING)
    assert (bench.mode, bench.event) == (Mode.HOLDING, FaultCode.NONE)


@pytest.mark.parametrize("stops", [False, True])
@pytest.mark.parametrize("cycles", range(4))
def test_power_that_is_taken_while_the_counters_are_loaded_goes_once_they_are(cycles: int, stops: bool) -> None:
    """As Ctrl-C of `qrobot calibrate` does it, which stops the arm as well."""
    rig = CalibratingRig().calibrating(until=Stage.SETTLING)
    while rig.state.cal.still + 1 < rig.params.settle_cycles:
        rig.ticks(1)
    rig.compute()
    assert rig.stage is Stage.LOADING
    rig.ticks(cycles)
    if stops:
        rig.mailbox.request_stop()
    rig.mailbox.request_power(False)
    rig.compute()
    rig.run_for(0.2)
    assert rig.mode is Mode.OFF
    assert not rig.emulator.powered
    assert rig.emulator.calibrated
    assert rig.exact()


def test_an_arm_one_of_whose_joints_counts_the_other_way_with_its_potentiometer_is_calibrated() -> None:
    phase, each = PUMA.transmission.index_phase, PUMA.transmission.counts_per_rev
    transmission = PUMA.transmission.model_copy(
        update={
            "count_sign": PUMA.transmission.count_sign * [-1, 1, 1, 1, 1, 1],
            "index_phase": np.array([-phase[0], *phase[1:]]) % each,
            "pot_per_rev": np.array([150.1, *[-150.1] * 5]),
        }
    )
    robot = PUMA.model_copy(update={"transmission": transmission})
    table = make_table(Emulator(robot, physics="rigid"))
    assert CalibratingRig(random_pose(5), robot=robot, table=table).outcome() is None


def test_power_off_ends_it() -> None:
    rig = CalibratingRig().calibrating(joint=1)
    rig.mailbox.request_power(False)
    rig.run_for(0.2)
    assert rig.mode is Mode.OFF
    assert rig.event == (FaultCode.CAL_STOPPED, 1)
    assert not rig.emulator.powered


def test_a_count_lost_between_reading_and_loading_spoils_the_attempt() -> None:
    rig = CalibratingRig().calibrating(until=Stage.LOADING)
    rig.emulator.bundle.board.encoders.counter[3] += 1
    rig.emulator.connect(rig.board, rig.now_ns)
    rig.run_for(0.1)
    refused(rig, FaultCode.CAL_MOVED, NO_JOINT)


def test_a_board_that_does_not_show_the_calibrated_bit_in_time_is_left_without_it() -> None:
    rig = CalibratingRig().calibrating(until=Stage.MARKING)
    rig.params.load_patience = 0
    rig.ticks(1)
    refused(rig, FaultCode.CAL_MOVED, NO_JOINT)


def test_an_arm_that_is_shaken_is_not_loaded() -> None:
    rig = CalibratingRig().calibrating(until=Stage.SETTLING)
    for shake in range(300):
        rig.board.panel.push[0] = 60_000_000 * (-1) ** shake
        rig.run_for(0.02)
        if rig.mode is not Mode.CALIBRATING:
            break
    rig.board.panel.push[0] = 0
    refused(rig, FaultCode.CAL_MOVED, 0)


def test_after_a_refusal_the_next_attempt_succeeds() -> None:
    rig = CalibratingRig().calibrating(joint=2)
    rig.mailbox.request_stop()
    rig.run_for(0.3)
    rig.calibrate()
    assert rig.exact()


# --- the commander's side ------------------------------------------------------------------------------------------


def test_the_client_leaves_power_as_it_was() -> None:
    off = CalibratingRig()
    off.calibrate(3)
    off.run_for(0.3)
    assert off.mode is Mode.OFF
    on = CalibratingRig().powered()
    on.calibrate(3)
    assert on.mode is Mode.HOLDING


def test_the_client_tells_the_servos_reason() -> None:
    rig = CalibratingRig().powered()
    rig.emulator.bundle.board.encoders.counts_per_rev[4] = 400
    with pytest.raises(ServoFault, match="joint 5: CAL_INDEX: an index pulse was missing") as refusal:
        rig.calibrate()
    assert refusal.value.code == FaultCode.CAL_INDEX


@pytest.mark.parametrize("joint", [0, 2])
def test_the_client_follows_a_calibration_that_is_under_way(joint: int) -> None:
    rig = CalibratingRig().calibrating(3, joint=joint)
    report = rig.calibrate()
    assert report.votes == [3] * PUMA.n
    assert rig.mode is Mode.HOLDING
    assert rig.exact()


@pytest.mark.parametrize("halt", [ServoMailbox.request_stop, ServoMailbox.request_power_off])
@pytest.mark.parametrize("mode", [Mode.OFF, Mode.UNCALIBRATED])
def test_a_stop_before_a_calibration_begins_is_not_overruled(mode: Mode, halt: Callable[[ServoMailbox], None]) -> None:
    """In the moment between two requests of the client."""
    rig, halted = CalibratingRig(), []

    def wait(seconds: float) -> None:
        rig.run_for(seconds)
        if not halted and rig.mode is mode:
            halted.append(halt(rig.mailbox))

    with pytest.raises(ServoFault, match="not calibrated: CAL_STOPPED"):
        run_calibration(rig.mailbox, wait, 3)
    assert rig.mailbox.memory.command.calibrations == 0
    rig.run_for(1.0)
    assert rig.mode is Mode.OFF


def powering() -> CalibratingRig:
    rig = CalibratingRig()
    rig.run_for(0.3)
    rig.mailbox.request_power(True)
    for _ in range(200):
        if rig.mode is not Mode.OFF:  # the potentiometers have been read
            break
        rig.ticks(1)
    return rig


def stopped_by_hand() -> CalibratingRig:
    rig = CalibratingRig().powered()
    rig.board.panel.estop = 1
    rig.run_for(0.1)
    return rig


@pytest.mark.parametrize(("begin", "mode"), [(powering, Mode.POWERING), (stopped_by_hand, Mode.FAULT)])
def test_the_client_touches_nothing_in_a_mode_in_which_it_refuses(begin, mode: Mode) -> None:
    rig = begin()
    assert rig.mode is mode
    asked = np.copy(rig.mail.command).tobytes()
    with pytest.raises(ServoFault, match=f"in mode {mode.name}, not OFF"):
        rig.calibrate()
    assert np.copy(rig.mail.command).tobytes() == asked
    assert rig.mode is mode


def test_the_client_does_not_wait_for_a_servo_that_has_died() -> None:
    rig, waited_s = CalibratingRig(), [0.0]

    def wait(seconds: float) -> None:
        if rig.mode is Mode.CALIBRATING:
            waited_s[0] += seconds
        else:
            rig.run_for(seconds)

    with pytest.raises(LinkTimeout, match="the servo does not run any more"):
        run_calibration(rig.mailbox, wait)
    assert 1.0 < waited_s[0] < 2.0


def test_both_signals_of_a_session_that_is_closed_stop_a_calibration_that_was_under_way() -> None:
    rig = CalibratingRig().calibrating()
    with default_signals(signal.SIGTERM, signal.SIGHUP), interrupted_by_signals(), pytest.raises(KeyboardInterrupt):
        run_calibration(rig.mailbox, lambda _seconds: at_once(signal.SIGTERM, signal.SIGHUP))
    rig.run_for(0.5)
    refused(rig, FaultCode.CAL_STOPPED, 0)


def test_what_stopped_the_last_calibration_does_not_refuse_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its process may be kept from running for some cycles at any place."""
    rig = CalibratingRig().calibrating()
    rig.mailbox.request_stop()
    rig.run_for(0.1)
    rig.mailbox.request_power(False)
    rig.run_for(1.0)
    assert (rig.mode, rig.event) == (Mode.OFF, (FaultCode.CAL_STOPPED, 0))
    request_power = rig.mailbox.request_power

    def late(on: bool) -> None:
        rig.ticks(3)
        request_power(on)

    monkeypatch.setattr(rig.mailbox, "request_power", late)
    assert rig.calibrate(3).votes == [3] * PUMA.n


@pytest.mark.parametrize("indexes", [1, 2, 15, -3])
def test_the_client_refuses_a_number_of_pulses_that_is_not_possible(indexes: int) -> None:
    with pytest.raises(ConfigError, match="3 to 14 are possible"):
        CalibratingRig().calibrate(indexes)
