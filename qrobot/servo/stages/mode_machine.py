"""The mode machine: requests, faults and the end of stops, judged once a tick against the table in `modes`.

Every fault is raised as a pending code during the tick; the worst one (lowest stop category) is acted on at its end, in
the same tick, before anything is written to the board.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import FaultCode
from qrobot.hwif.registers import DISCRETE_CALIBRATED, STATUS_CALIBRATED, STATUS_ESTOP_OK, STATUS_POWER
from qrobot.modecodes import Mode
from qrobot.realtime.atomics import load_acquire
from qrobot.realtime.jit import lean_kernel, part_kernel
from qrobot.servo.calibration.potentiometers import answer_pots, forget_trials, has_table
from qrobot.servo.calibration.state import (
    DEFAULT_INDEXES,
    FEWEST_INDEXES,
    IMPLAUSIBLE,
    MOST_INDEXES,
    PLAUSIBLE,
    Stage,
)
from qrobot.servo.checks.board_clock import clock_is_fast
from qrobot.servo.event import report_event, report_fault
from qrobot.servo.hold import allow_range, hold_position, hold_reference
from qrobot.servo.kernels.interpolation_polynomials import N_KNOTS
from qrobot.servo.kernels.interpolator import line_through, room_duration, stop_duration
from qrobot.servo.laws.law_swap import fall_back, forget_bias
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT, TORQUE_SETPOINT, drop_all_frames
from qrobot.servo.memory.stop_record import CODE as INCIDENT_CODE
from qrobot.servo.memory.stop_record import note_incident
from qrobot.servo.modes import gives_torque, set_mode, wants_power
from qrobot.servo.parameters import PUT_BACK_NS, STANDSTILL_RAD_S, ServoParameters
from qrobot.servo.stages.collision_stop import begin_yielding, forget_yielding
from qrobot.servo.stages.override import NOTICED_NS
from qrobot.servo.stages.setpoint_stream import (
    REFUSALS,
    end_stream,
    forget_waiting,
    start_stream,
    stream_ready,
    stream_silent,
)
from qrobot.servo.state import (
    ADOPT_JUMPED,
    ServoState,
)
from qrobot.servo.stop_categories import category_of

OFF: Final = int(Mode.OFF)
POWERING: Final = int(Mode.POWERING)
UNCALIBRATED: Final = int(Mode.UNCALIBRATED)
CALIBRATING: Final = int(Mode.CALIBRATING)
HOLDING: Final = int(Mode.HOLDING)
TRACKING: Final = int(Mode.TRACKING)
STOPPING: Final = int(Mode.STOPPING)
FAULTED: Final = int(Mode.FAULT)

NONE: Final = int(FaultCode.NONE)
ESTOP: Final = int(FaultCode.ESTOP)
BOARD_GONE: Final = int(FaultCode.BOARD_GONE)
BOARD_JOINTS: Final = int(FaultCode.BOARD_JOINTS)
BOARD_CLOCK: Final = int(FaultCode.BOARD_CLOCK)
POWER_LOST: Final = int(FaultCode.POWER_LOST)
POWER_NO_ACK: Final = int(FaultCode.POWER_NO_ACK)
GUARD_LOST: Final = int(FaultCode.GUARD_LOST)
GUARD_TRIP: Final = int(FaultCode.GUARD_TRIP)
STREAM_LOST: Final = int(FaultCode.STREAM_LOST)
RESET_DENIED: Final = int(FaultCode.RESET_DENIED)
MOVING_AT_START: Final = int(FaultCode.MOVING_AT_START)
CAL_MISMATCH: Final = int(FaultCode.CAL_MISMATCH)
CAL_STOPPED: Final = int(FaultCode.CAL_STOPPED)
POWER_STOPPED: Final = int(FaultCode.POWER_STOPPED)
CAL_NO_TABLE: Final = int(FaultCode.CAL_NO_TABLE)
COLLISION: Final = int(FaultCode.COLLISION)
SATURATED: Final = int(FaultCode.SATURATED)
ENC_STUCK: Final = int(FaultCode.ENC_STUCK)
ENC_SIGN: Final = int(FaultCode.ENC_SIGN)
PUSHES: Final = (COLLISION, SATURATED)  # told of an arm that is held, too, where they stop nothing
STAGE_IDLE: Final = int(Stage.IDLE)
LOADING: Final = int(Stage.LOADING)  # the stages from here on move nothing

# A clear that cannot be granted at once is tried for this long (the guardian needs a cycle to hand back the board).
CLEAR_PATIENCE_NS: Final = 100_000_000


@lean_kernel
def _end_torque_mode(params: ServoParameters, state: ServoState) -> None:
    """Joints driven by torque setpoints go on from where they are, at the speed they have, for the stop to end it."""
    for j in range(state.q.size):
        if state.joint_modes[j] == TORQUE_SETPOINT:
            state.joint_modes[j] = POSITION_SETPOINT
            state.torque_setpoint[j] = 0.0
            state.v_ref[j] = state.v[j]
            line_through(
                state.knots, state.rounding, params.first_knot, j, state.phase, state.q[j], state.v[j] / state.rate
            )


@lean_kernel
def begin_stop(params: ServoParameters, state: ServoState, mail: Any, now_ns: int, after: int) -> None:
    """Start a controlled stop on the path; `after` is the mode it ends in. A worse end replaces a milder one."""
    if state.mode == STOPPING:
        if after == FAULTED or state.after_stop == HOLDING:
            state.after_stop = after
        return
    end_stream(state, mail)
    _end_torque_mode(params, state)
    state.after_stop = after
    state.stop_since_ns = now_ns
    state.rate_at_stop = state.rate
    gentle = stop_duration(state.v_ref, params.a_stop, params.shortest_stop_s)
    state.stop_seconds = max(params.shortest_stop_s, min(gentle, _room_ahead(params, state)))  # harder rather than out
    set_mode(state, STOPPING)


@lean_kernel
def _room_ahead(params: ServoParameters, state: ServoState) -> float:
    """Seconds in which a stop ends within the range: from the speed at hand, and from those on the path ahead."""
    room = _room(params, state, state.v_ref)
    for i in range(params.first_knot, N_KNOTS - 1):
        for j in range(state.q.size):
            state.scratch[j] = (state.knots[i + 1, j] - state.knots[i, j]) * state.rate
        room = min(room, _room(params, state, state.scratch))
    return room


@lean_kernel
def _room(params: ServoParameters, state: ServoState, v: Any) -> float:
    return room_duration(
        state.q_ref, v, state.range_min, state.range_max, params.stop_overshoot_s, params.range_margin
    )  # fmt: skip


@lean_kernel
def guardian_alive(params: ServoParameters, mail: Any, now_ns: int) -> bool:
    """The guardian's heartbeat is fresh, or none is required.

    None comes from the future, but for one that was made before the time of an emulated arm was put back.
    """
    timeout_ns = params.guardian_timeout_ns
    early_ns = timeout_ns + (PUT_BACK_NS if params.board_slips != 0 else 0)
    return timeout_ns == 0 or -early_ns <= now_ns - mail.guardian.t_ns <= timeout_ns


@lean_kernel
def watch_surroundings(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Raise what the board, the guardian and the operator's chain call for."""
    mode, status = state.mode, state.status
    if mail.guardian.takeover != 0:
        report_fault(state, GUARD_TRIP)
    if state.image_ok == 0:
        if mode == OFF:
            report_event(state, BOARD_GONE)  # nothing is driven: no fault, but no power either
        else:
            report_fault(state, BOARD_GONE)
    elif wants_power(mode):
        if status & STATUS_ESTOP_OK == 0:
            report_fault(state, ESTOP)
        if gives_torque(mode) and status & STATUS_POWER == 0:
            report_fault(state, POWER_LOST)
    if wants_power(mode) and not guardian_alive(params, mail, now_ns):
        report_fault(state, GUARD_LOST)


@lean_kernel
def _at_rest(state: ServoState) -> bool:
    still = True
    for j in range(state.v.size):
        still = still and abs(state.v[j]) <= STANDSTILL_RAD_S
    return still


@lean_kernel
def _leave_off(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Power is wanted: grant the request or say why not."""
    if state.image_ok == 0:
        report_event(state, BOARD_GONE)
    elif 0 < state.board_joints < state.q.size:
        report_event(state, BOARD_JOINTS)  # a joint would have an angle that nobody has measured
    elif clock_is_fast(state):
        report_event(state, BOARD_CLOCK)
    elif state.status & STATUS_ESTOP_OK == 0:
        report_event(state, ESTOP)
    elif not guardian_alive(params, mail, now_ns):
        report_event(state, GUARD_LOST)
    elif not _at_rest(state):
        report_event(state, MOVING_AT_START)
    elif not answer_pots(params, state):
        state.power_seen = 0  # as if asked in the next cycle: the potentiometers are being read
        report_event(state, NONE)  # what was said of an earlier request is no answer to this one
    elif has_table(params) and state.pots.verdict > PLAUSIBLE:
        report_event(state, CAL_MISMATCH, state.pots.suspect)
    else:
        report_event(state, NONE)
        state.powering_since_ns = now_ns
        set_mode(state, POWERING)


@lean_kernel
def _watch_power_up(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    if state.status & STATUS_POWER != 0:
        hold_position(state)
        allow_range(params, state)
        for k in range(state.memory.size):
            state.memory[k] = 0.0
        forget_bias(state.swap)
        forget_trials(state)
        forget_yielding(state)  # the stop that gave way may have ended in a fault
        drop_all_frames(mail)
        set_mode(state, HOLDING if state.status & STATUS_CALIBRATED != 0 else UNCALIBRATED)
    elif now_ns - state.powering_since_ns > params.power_timeout_ns:
        report_event(state, POWER_NO_ACK)
        set_mode(state, OFF)


@lean_kernel
def _forget_calibration(state: ServoState) -> None:
    """Declare counters that the potentiometers contradict not calibrated, when asked to calibrate without power."""
    if state.pots.verdict == IMPLAUSIBLE:
        state.discrete_word &= ~DISCRETE_CALIBRATED
        state.adopt = ADOPT_JUMPED
        report_event(state, NONE)


@lean_kernel
def _loads_counters(state: ServoState) -> bool:
    """True while a calibration loads its counters, some cycles at rest.

    They are waited for, whoever wants to end it: their new words would look like a jump.
    """
    return bool(state.mode == CALIBRATING and state.cal.stage >= LOADING)


@lean_kernel
def begin_calibration(params: ServoParameters, state: ServoState, indexes: int) -> None:
    """Leave UNCALIBRATED for CALIBRATING, or say why not; `indexes` pulses a joint, 0 for the default."""
    if not has_table(params):
        report_event(state, CAL_NO_TABLE)
        return
    wanted = indexes if indexes > 0 else DEFAULT_INDEXES
    state.cal.wanted = min(max(wanted, FEWEST_INDEXES), MOST_INDEXES)
    state.cal.stage, state.cal.speed = STAGE_IDLE, 0.0
    report_event(state, NONE)
    set_mode(state, CALIBRATING)


@lean_kernel
def _obey_calibration(params: ServoParameters, state: ServoState, mail: Any, stopped: bool) -> None:
    """Begin a calibration when asked to, end it when asked to stop; of the two in one cycle the stop counts."""
    mode = state.mode
    calibrations = load_acquire(mail.command, "calibrations")
    asked = calibrations != state.calibrates_seen
    state.calibrates_seen = calibrations
    if mode == CALIBRATING and stopped and not _loads_counters(state):
        report_event(state, CAL_STOPPED, state.cal.joint_now)
        hold_position(state)
        set_mode(state, UNCALIBRATED)
    elif mode == UNCALIBRATED and asked and stopped:
        report_event(state, CAL_STOPPED)
    elif mode == UNCALIBRATED and asked:
        begin_calibration(params, state, mail.command.indexes)
    elif mode == OFF and asked:
        _forget_calibration(state)


@lean_kernel
def _watch_stream(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    play, code, joint = stream_ready(params, state, mail, now_ns)
    if code != 0:
        report_event(state, code, joint)
    elif play:
        if state.event == state.watch.incident[INCIDENT_CODE] or state.event in REFUSALS or state.event in PUSHES:
            report_event(state, NONE)  # of the time before: should it happen again, it is an event of its own
        start_stream(params, state, now_ns)
        set_mode(state, TRACKING)


@lean_kernel
def _leave_fault(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Grant a clear once the cause is gone; say so when it does not go."""
    if state.clear_until_ns == 0:
        return
    mail.heartbeat.trips_seen = mail.guardian.trips  # asks the guardian to hand the board back
    estop_ok = state.status & STATUS_ESTOP_OK != 0
    if state.image_ok != 0 and estop_ok and mail.guardian.takeover == 0 and guardian_alive(params, mail, now_ns):
        if state.glitches != 0:
            state.adopt = ADOPT_JUMPED
        if state.law_failed != 0:
            fall_back(state.swap)
        state.fault, state.law_failed, state.clear_until_ns = 0, 0, 0
        report_event(state, NONE)
        set_mode(state, OFF)
    elif now_ns > state.clear_until_ns:
        report_event(state, RESET_DENIED)
        state.clear_until_ns = 0


@lean_kernel
def _power_off(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """The power request is gone: stop first when moving, and let counters be loaded."""
    state.stop_asked = 1  # outputs that a stop ends do not go on without power because nothing moved
    if state.mode in (TRACKING, STOPPING):
        begin_stop(params, state, mail, now_ns, OFF)
    elif state.mode != FAULTED and not _loads_counters(state):
        if state.mode == CALIBRATING:
            report_event(state, CAL_STOPPED, state.cal.joint_now)
        elif state.mode == POWERING and state.power_locked != 0:  # by a stop or a power-off, not by its level
            report_event(state, POWER_STOPPED)
        set_mode(state, OFF)


@lean_kernel
def power_wanted(state: ServoState, mail: Any) -> int:
    """1 while the commander wants power and nobody has taken it away since they asked for it.

    `asked_anew` tells whether they have asked in this cycle. What takes power away is read first: said after a request,
    it is not seen before it.
    """
    power_offs = load_acquire(mail.command, "power_offs")
    asked = load_acquire(mail.command, "power") != 0
    power_ons = load_acquire(mail.command, "power_ons")  # behind the level, which is set after it
    state.asked_anew = 1 if power_ons != state.ons_seen else 0
    if not asked or state.asked_anew != 0:
        state.power_locked = 0
    if power_offs != state.offs_seen:
        state.stop_asked = 1  # also where there is no power: outputs that a stop ends go off
        if asked:  # of the two in one cycle the safe one counts
            state.power_locked = 1
    state.offs_seen, state.ons_seen = power_offs, power_ons
    return 1 if asked and state.power_locked == 0 and mail.command.shutdown == 0 else 0


@lean_kernel
def _tell_halt(state: ServoState, now_ns: int) -> None:
    """Remember that somebody has asked for a stop, or for an end of power, until another stream is followed.

    And a little longer: who sent the first frame of that stream may not have heard of the stop.
    """
    if state.stop_asked != 0:
        state.halted, state.halted_ns = 1, now_ns
    elif state.mode == TRACKING and now_ns - state.halted_ns > NOTICED_NS:
        state.halted = 0


@part_kernel
def handle_requests(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Act on what the commander asks and on what the present mode waits for.

    Every counter is read once in a cycle: what is compared is what is remembered, and nothing raised in between is
    lost. Stops are read before what they may take back, so that one which was said after it is not seen before it.
    """
    stops, clears = load_acquire(mail.command, "stops"), load_acquire(mail.command, "clears")
    stopped, cleared = stops != state.stops_seen, clears != state.clears_seen
    state.stops_seen, state.clears_seen = stops, clears
    state.stop_asked = 1 if stopped else 0
    power = power_wanted(state, mail)
    asked_now = power == 1 and (state.power_seen == 0 or state.asked_anew != 0)
    if stopped and power == 1 and (state.mode == POWERING or (state.mode == OFF and asked_now)):  # to be asked for anew
        state.power_locked, power, asked_now = 1, 0, False
        report_event(state, POWER_STOPPED)
    state.power_seen = power
    _obey_calibration(params, state, mail, stopped)
    mode = state.mode
    if stopped and mode != TRACKING:  # also while stopping: a stream that waits for the end of the stop is meant too
        forget_waiting(state, mail)
    if power == 0 and wants_power(mode):
        _power_off(params, state, mail, now_ns)
    elif mode == OFF:
        if asked_now:
            _leave_off(params, state, mail, now_ns)
    elif mode == POWERING:
        _watch_power_up(params, state, mail, now_ns)
    elif mode == HOLDING:
        _watch_stream(params, state, mail, now_ns)
    elif mode == TRACKING:
        if stopped:
            begin_stop(params, state, mail, now_ns, HOLDING)
        elif stream_silent(params, state, mail, now_ns):
            report_fault(state, STREAM_LOST)
    elif mode == FAULTED:
        if cleared:
            state.clear_until_ns = now_ns + CLEAR_PATIENCE_NS
        _leave_fault(params, state, mail, now_ns)
    _tell_halt(state, now_ns)


@lean_kernel
def apply_faults(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Act on the worst code of this tick."""
    code = state.pending
    if code == 0:
        return
    report_event(state, code, state.pending_joint)
    state.pending = 0
    mode, category = state.mode, category_of(code)
    if code in (ENC_STUCK, ENC_SIGN) and has_table(params):  # what it did not count, or counted the wrong way, is lost
        state.discrete_word &= ~DISCRETE_CALIBRATED
    if code in PUSHES and mode in (TRACKING, STOPPING):
        begin_yielding(state, code)
    if category == 0 or (category == 1 and mode not in (TRACKING, STOPPING)):
        state.fault = code
        end_stream(state, mail)
        set_mode(state, FAULTED)
    elif category == 1:
        state.fault = code
        begin_stop(params, state, mail, now_ns, FAULTED)
    elif mode == TRACKING:
        begin_stop(params, state, mail, now_ns, HOLDING)
    if state.mode != mode:
        note_incident(
            state.watch.incident, now_ns, state.tick, code, state.event_joint, state.pending_value,
            state.pending_limit, mode, state.mode, state.next_seq - 1,
        )  # fmt: skip


@lean_kernel
def finish_stop(state: ServoState) -> None:
    """The stop has come to rest: go where it was meant to end. One that gave way is held where it got to."""
    if state.after_stop == HOLDING and state.watch.yields != 0:
        hold_position(state)
    elif state.after_stop == HOLDING:
        hold_reference(state)
    forget_yielding(state)
    set_mode(state, state.after_stop)
