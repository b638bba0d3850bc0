"""How soon the servo reacts to each fault, and the test that makes it happen: what the page of faults adds to the code.

A test holds this table to the tests it names.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tables import raised_codes, table

from qrobot.faultcodes import EXPLANATION, FaultCode
from qrobot.servo.modes import StopCategory
from qrobot.servo.stop_categories import stop_category

CAMPAIGN: Final = "tests/property/test_fault_campaign.py"
BREAKS: Final = f"{CAMPAIGN}::test_what_breaks_on_the_way_stops_the_arm_in_time"
STREAM: Final = f"{CAMPAIGN}::test_what_goes_wrong_with_the_stream_ends_on_the_path"
CYCLE: Final = "tests/unit/servo/test_cycle_faults.py"
SUPERVISOR: Final = "tests/unit/servo/test_mode_machine.py"


CALIBRATE: Final = "tests/unit/servo/test_calibrate.py"
ENCODER: Final = "tests/property/test_encoder_campaign.py"
MOTOR: Final = "tests/property/test_motor_campaign.py"
WATCHES: Final = "tests/unit/servo/test_watches.py"
GENTLE: Final = "calibration ends; the arm stays held"


class Fact(NamedTuple):
    """Bound from the injection to the reaction, the test that injects it, and whether there is anything to clear."""

    bound: str
    test: str
    latches: bool = True


F = FaultCode
FACTS: Final = {
    F.ENC_STUCK: Fact(
        "3 ms (3 cycles) at 1 rad/s; 5 degrees with a calibration table, at 0.02 rad/s and from rest too",
        f"{ENCODER}::test_a_cable_that_comes_off_costs_the_power_within_five_degrees",
    ),
    F.ENC_JUMP: Fact("3 cycles; a single jump is held back", BREAKS),
    F.ENC_SIGN: Fact(
        "3 to 8 ms of torque before the motor has gone its way once; mostly it shows as RUNAWAY, at the first motion",
        f"{MOTOR}::test_an_encoder_that_turns_round_before_its_motor_has_gone_its_way_is_called_that",
    ),
    F.ENC_LOSS: Fact(
        "the next index pulse",
        f"{CALIBRATE}::test_counts_lost_are_found_at_the_next_index_pulse_and_end_the_calibration",
    ),
    F.BOARD_GONE: Fact(
        "1 cycle when all words read ones; 4 cycles or the board's time-out when nothing is new", BREAKS
    ),
    F.VEL_LIMIT: Fact(
        "the second cycle in a row that measures it",
        f"{CYCLE}::test_a_joint_too_fast_while_tracking_is_stopped_on_the_path_and_then_cut",
    ),
    F.DAC_STUCK: Fact("40 ms after the COLLISION it began as while the joint moves, else 0.3 s", BREAKS),
    F.RUNAWAY: Fact(
        "50 ms and 3 degrees from standstill",
        f"{MOTOR}::test_a_motor_at_full_torque_is_cut_within_50_ms_and_3_degrees",
    ),
    F.BRAKE_STUCK: Fact(
        "half a motor turn of the model, while encoder and potentiometer stand; without a calibration table ENC_STUCK",
        f"{ENCODER}::test_a_brake_that_did_not_release_is_told_by_its_name_where_a_potentiometer_sees_it",
    ),
    F.BRAKE_SLIP: Fact(
        "the cycle that measures half a degree; told once",
        f"{MOTOR}::test_a_brake_that_slips_is_told_of_within_100_ms_of_half_a_degree",
        False,
    ),
    F.SATURATED: Fact(
        "`guard.saturation_s`, 0.5 s; 5 ms where the joint has fallen behind by 70 % of its following error",
        f"{WATCHES}::test_a_torque_at_its_limit_for_half_a_second_stops_the_arm_and_holds_it",
    ),
    F.COLLISION: Fact("15 ms", f"{MOTOR}::test_an_arm_that_hits_something_stops_on_its_path_and_stays_held"),
    F.OVERRUN: Fact(
        "the third late cycle in a row, or the one that makes them 1 % of a second",
        f"{WATCHES}::test_three_late_cycles_in_a_row_stop_the_arm_and_cut_it",
    ),
    F.LAW_SLOW: Fact(
        "3 cycles", f"{WATCHES}::test_a_law_longer_than_the_cycle_is_replaced_and_the_arm_stopped_after_three_cycles"
    ),
    F.LAW_BOUNDS: Fact(
        "the cycle in which it happens",
        "tests/unit/servo/test_guarded_copies.py::test_a_law_that_writes_beside_its_arrays_is_replaced_and_stops_the_arm",
    ),
    F.FOLLOWING: Fact("the cycle that measures it", f"{CYCLE}::test_an_arm_that_is_not_where_it_should_be_is_cut"),
    F.JOINT_LIMIT: Fact(
        "the cycle that measures it", f"{CYCLE}::test_a_joint_that_leaves_its_range_and_the_margin_is_cut"
    ),
    F.POWER_LOST: Fact("1 cycle after STATUS shows it", BREAKS),
    F.POWER_NO_ACK: Fact("3 s", f"{CAMPAIGN}::test_power_that_does_not_come_on_is_given_up_after_three_seconds"),
    F.POWER_STOPPED: Fact(
        "the same cycle", f"{SUPERVISOR}::test_a_stop_before_power_is_on_takes_the_request_back", False
    ),
    F.ESTOP: Fact("2 cycles", BREAKS),
    F.GUARD_TRIP: Fact(
        "the guardian's time-out and one of its looks",
        "tests/unit/servo/test_guardian.py::test_an_armed_servo_that_falls_silent_loses_the_board_within_the_bound_and_one_look",
    ),
    F.GUARD_LOST: Fact(
        "twice the guardian's time-out",
        f"{CYCLE}::test_a_servo_without_its_guardian_stops_the_arm_within_ten_milliseconds",
    ),
    F.LAW_NAN: Fact(
        "the same cycle; no such torque is written",
        f"{CYCLE}::test_a_law_that_breaks_while_tracking_is_replaced_and_the_arm_stopped",
    ),
    F.BOARD_CLOCK: Fact(
        "two whole seconds of images; without power it is refused then",
        "tests/unit/servo/test_board_clock.py::test_a_clock_that_goes_faster_than_ours_stops_the_arm_within_two_seconds",
    ),
    F.BOARD_JOINTS: Fact(
        "power is refused", f"{SUPERVISOR}::test_power_is_refused_with_the_reason_and_not_given_later_by_itself", False
    ),
    F.MOVING_AT_START: Fact(
        "power is refused", f"{SUPERVISOR}::test_power_is_refused_with_the_reason_and_not_given_later_by_itself", False
    ),
    F.STREAM_LOST: Fact(
        "two frames and a quarter after the last one, or when the next is due to which no way leads back", STREAM
    ),
    F.SP_INVALID: Fact("when the frame is due; it is not played", STREAM),
    F.SP_LIMIT: Fact("when the frame is due; it is not played", STREAM),
    F.SP_STEP: Fact("when the frame is due; it is not played", STREAM),
    F.START_POSE: Fact(
        "the stream is refused",
        "tests/unit/servo/test_setpoint_stream.py::test_a_stream_that_does_not_begin_where_the_arm_stands_is_refused",
    ),
    F.CAL_MISMATCH: Fact(
        "power or calibration is refused",
        f"{CALIBRATE}::test_counters_that_the_potentiometers_contradict_get_no_power_and_are_mended_by_a_calibration",
    ),
    F.CAL_VOTE: Fact(GENTLE, f"{CALIBRATE}::test_a_dead_potentiometer_has_no_majority"),
    F.CAL_INDEX: Fact(
        "a few revolutions of the motor",
        f"{CALIBRATE}::test_a_missing_index_pulse_is_tried_twice_and_then_told_within_a_few_turns",
    ),
    F.CAL_BLOCKED: Fact(GENTLE, f"{CALIBRATE}::test_an_obstacle_ends_it_before_the_torque_is_large"),
    F.CAL_ROOM: Fact(GENTLE, f"{CALIBRATE}::test_the_end_of_the_range_ends_it_whatever_the_plan_was"),
    F.CAL_STOPPED: Fact(GENTLE, f"{CALIBRATE}::test_a_stop_ends_it_and_the_arm_stays_held"),
    F.CAL_MOVED: Fact(GENTLE, f"{CALIBRATE}::test_an_arm_that_is_shaken_is_not_loaded"),
    F.CAL_NO_TABLE: Fact("calibration is refused", f"{CALIBRATE}::test_without_a_table_it_says_so_and_holds_as_ever"),
    F.IO_LOST: Fact(
        "the cycle after its time-out, or after the interface has failed; told while the arm is held or moves, and "
        "nothing stops",
        f"{WATCHES}::test_a_lost_module_is_told_of_once_and_stops_nothing",
        False,
    ),
    F.CFG_GAIN: Fact(
        "the servo does not start; gains asked for while it runs are refused",
        "tests/unit/servo/test_stability.py::test_gains_far_outside_are_refused_by_joint",
        False,
    ),
    F.HOLD_TO_RUN: Fact(
        "100 ms after the key was let go",
        "tests/unit/servo/test_hold_to_run.py::test_a_key_let_go_or_a_link_lost_stops_the_arm_on_its_path_within_100_ms",
    ),
    F.T1_LIMIT: Fact(
        "the cycle in which the reference or the measured motion is too fast",
        "tests/unit/servo/test_reduced_speed.py::test_a_fast_program_is_stopped_on_its_path_before_the_tool_is_faster",
    ),
    F.FENCE: Fact(
        "the last cycle in which a stop ends before the fence",
        "tests/unit/servo/test_fence_watch.py::test_setpoints_into_a_fence_are_stopped_before_it",
    ),
    F.RATE: Fact(
        "the servo does not start on a real board; with an emulated one it is told",
        "tests/unit/servo/test_rate_test.py::test_a_rate_that_is_not_kept_is_told_with_one_that_would_be",
        False,
    ),
    F.RT_BUDGET: Fact(
        "the servo does not start on a real board; with an emulated one it is told",
        "tests/unit/servo/test_rate_test.py::test_the_loop_stays_below_what_the_kernel_leaves_it",
        False,
    ),
    F.PAGEFAULT: Fact(
        "told within a second, and counted in `qrobot ctl status --json`; nothing stops",
        "tests/unit/servo/test_rate_test.py::test_page_faults_of_a_thread_are_counted_from_when_it_is_ready",
        False,
    ),
    F.RESET_DENIED: Fact("0.1 s after the clear", BREAKS),
}
CLEARED: Final = {
    StopCategory.CATEGORY_0: "a clear once the cause is gone, then a request for power",
    StopCategory.CATEGORY_1: "a clear once the cause is gone, then a request for power",
    StopCategory.CATEGORY_2: "nothing to clear",
}

COUNTS_LOST: Final = (F.ENC_STUCK, F.ENC_JUMP, F.ENC_SIGN, F.ENC_LOSS)


def reactions() -> str:
    """Every code the servo raises: meaning, stop, bound, what clears it, and the test that makes it happen."""
    raised = raised_codes()
    return table(
        ("code", "what happened", "category", "reaction within", "cleared by", "injected by"),
        (_row(code) for code in sorted(FaultCode) if code.name in raised and code),
    )


def _row(code: FaultCode) -> tuple[object, ...]:
    fact = FACTS.get(code, Fact("", ""))
    category = stop_category(code)
    test = f"`{fact.test}`" if fact.test else ""
    cleared = CLEARED[category if fact.latches else StopCategory.CATEGORY_2]
    cleared += ", and `qrobot calibrate` where the arm has a table" if code in COUNTS_LOST else ""
    return (
        f"{code.name} ({code.value})", EXPLANATION[code][0], int(category), fact.bound, cleared, test,
    )  # fmt: skip
