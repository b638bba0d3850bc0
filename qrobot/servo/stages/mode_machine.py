"""Which mode follows: requests, faults and the end of stops, judged once a tick against the table in `modes`.

Every fault is raised as a pending code during the tick; the worst one (lowest stop category) is acted on at its end, in
the same tick, before anything is written to the board.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.hwif.registers import STATUS_CALIBRATED, STATUS_ESTOP_OK, STATUS_POWER
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.calibration.potentiometers import has_table, pots_judged
from qrobot.servo.calibration.state import (
    DEFAULT_INDEXES,
    FEWEST_INDEXES,
    IMPLAUSIBLE,
    JOINT_NOW,
    MOST_INDEXES,
    PLAUSIBLE,
    SPEED,
    STAGE,
    SUSPECT,
    VERDICT,
    WANTED,
    Stage,
)
from qrobot.servo.checks.limit_checks import category_of
from qrobot.servo.checks.monitor_state import YIELDS
from qrobot.servo.event import note_event
from qrobot.servo.laws.law_swap import fall_back, forget_bias
from qrobot.servo.memory.mailbox import (
    BEAT_TRIPS_SEEN,
    COMMAND_CALIBRATE,
    COMMAND_CLEARS,
    COMMAND_INDEXES,
    COMMAND_OFFS,
    COMMAND_POWER,
    COMMAND_SHUTDOWN,
    COMMAND_STOPS,
    GUARD_T_NS,
    GUARD_TAKEOVER,
    GUARD_TRIPS,
)
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT, TORQUE_SETPOINT, drop_all_frames
from qrobot.servo.memory.stop_record import note_incident
from qrobot.servo.modes import Mode, gives_torque, may_follow, wants_power
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.stages.collision_stop import forget_yielding
from qrobot.servo.stages.dropout_hold import note_lag
from qrobot.servo.stages.interpolator import line_through, rest_at, room_duration, stop_duration
from qrobot.servo.stages.setpoint_stream import end_stream, forget_waiting, start_stream, stream_ready, stream_silent
from qrobot.servo.state import (
    ADOPT,
    ADOPT_JUMPED,
    AFTER_STOP,
    CALIBRATES_SEEN,
    CLEAR_UNTIL_NS,
    CLEARS_SEEN,
    DISCRETE_WORD,
    FAULT,
    GLITCHES,
    IMAGE_OK,
    JOINT,
    LAW_FAILED,
    MODE,
    NEXT_SEQ,
    OFFS_SEEN,
    PENDING,
    PENDING_JOINT,
    PENDING_LIMIT,
    PENDING_VALUE,
    PHASE,
    POWER_LOCKED,
    POWER_SEEN,
    POWERING_SINCE_NS,
    RATE,
    RATE_AT_STOP,
    STATUS,
    STOP_SECONDS,
    STOP_SINCE_NS,
    STOPS_SEEN,
    TICK,
    ServoState,
)

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
POWER_LOST: Final = int(FaultCode.POWER_LOST)
POWER_NO_ACK: Final = int(FaultCode.POWER_NO_ACK)
GUARD_LOST: Final = int(FaultCode.GUARD_LOST)
GUARD_TRIP: Final = int(FaultCode.GUARD_TRIP)
STREAM_LOST: Final = int(FaultCode.STREAM_LOST)
RESET_DENIED: Final = int(FaultCode.RESET_DENIED)
MOVING_AT_START: Final = int(FaultCode.MOVING_AT_START)
CAL_MISMATCH: Final = int(FaultCode.CAL_MISMATCH)
CAL_STOPPED: Final = int(FaultCode.CAL_STOPPED)
CAL_NO_TABLE: Final = int(FaultCode.CAL_NO_TABLE)
COLLISION: Final = int(FaultCode.COLLISION)
STAGE_IDLE: Final = int(Stage.IDLE)

# A clear that cannot be granted at once is tried for this long (the guardian needs a cycle to hand back the board).
CLEAR_PATIENCE_NS: Final = 100_000_000
PUT_BACK_NS: Final = 1_000_000_000  # by which the time of an emulated arm is put back at once, at most [A]
STANDSTILL_RAD_S: Final = 0.05  # faster than this the arm is not at rest: no power


@lean_kernel
def report_fault(state: ServoState, code: int, joint: int = NO_JOINT, value: float = 0.0, limit: float = 0.0) -> None:
    """Note a code for this tick; of several the one with the lowest stop category counts, then the first.

    `value` was measured where `limit` is allowed, in the unit of `faultcodes.quantity_of`. In FAULT nothing
    worse can come, and the event says what became of a clear.
    """
    if code == 0 or state.i[MODE] == FAULTED:
        return
    if state.i[PENDING] == 0 or category_of(code) < category_of(state.i[PENDING]):
        state.i[PENDING] = code
        state.i[PENDING_JOINT] = joint
        state.f[PENDING_VALUE], state.f[PENDING_LIMIT] = value, limit


@lean_kernel
def set_mode(state: ServoState, mode: int) -> None:
    """Change mode, if the table has such a transition."""
    if may_follow(state.i[MODE], mode):
        state.i[MODE] = mode


@lean_kernel
def hold_position(state: ServoState) -> None:
    """Make the measured position the reference, at rest."""
    for j in range(state.q.size):
        state.q_ref[j], state.v_ref[j], state.a_ref[j] = state.q[j], 0.0, 0.0
        state.joint_modes[j] = POSITION_SETPOINT
        state.torque_setpoint[j] = 0.0
    rest_at(state.knots, state.q_ref)
    note_lag(state)


@lean_kernel
def hold_reference(state: ServoState) -> None:
    """Stay at the reference, at rest."""
    for j in range(state.q.size):
        state.v_ref[j], state.a_ref[j] = 0.0, 0.0
        state.joint_modes[j] = POSITION_SETPOINT
        state.torque_setpoint[j] = 0.0
    rest_at(state.knots, state.q_ref)


@lean_kernel
def allow_range(params: ServoParameters, state: ServoState) -> None:
    """At power-up: the robot's range, and where the arm stands outside it the way back."""
    for j in range(state.q.size):
        q, margin = state.q[j], params.range_margin[j]
        state.range_min[j] = params.q_min[j] if q >= params.q_min[j] else q - margin
        state.range_max[j] = params.q_max[j] if q <= params.q_max[j] else q + margin


@lean_kernel
def narrow_range(params: ServoParameters, state: ServoState) -> None:
    """An arm on its way back into its range does not leave it any further again."""
    for j in range(state.q.size):
        q, margin = state.q[j], params.range_margin[j]
        state.range_min[j] = max(state.range_min[j], min(params.q_min[j], q - margin))
        state.range_max[j] = min(state.range_max[j], max(params.q_max[j], q + margin))


@lean_kernel
def _end_torque_mode(params: ServoParameters, state: ServoState) -> None:
    """Joints driven by torque setpoints go on from where they are, at the speed they have, for the stop to end it."""
    for j in range(state.q.size):
        if state.joint_modes[j] == TORQUE_SETPOINT:
            state.joint_modes[j] = POSITION_SETPOINT
            state.torque_setpoint[j] = 0.0
            state.v_ref[j] = state.v[j]
            line_through(state.knots, params.first_knot, j, state.f[PHASE], state.q[j], state.v[j] / state.f[RATE])


@lean_kernel
def begin_stop(params: ServoParameters, state: ServoState, mail: Any, now_ns: int, after: int) -> None:
    """Start a controlled stop on the path; `after` is the mode it ends in. A worse end replaces a milder one."""
    if state.i[MODE] == STOPPING:
        if after == FAULTED or state.i[AFTER_STOP] == HOLDING:
            state.i[AFTER_STOP] = after
        return
    end_stream(state, mail)
    _end_torque_mode(params, state)
    state.i[AFTER_STOP] = after
    state.i[STOP_SINCE_NS] = now_ns
    state.f[RATE_AT_STOP] = state.f[RATE]
    gentle = stop_duration(state.v_ref, params.a_stop, params.shortest_stop_s)
    room = room_duration(
        state.q_ref, state.v_ref, state.range_min, state.range_max, params.stop_overshoot_s, params.range_margin
    )
    state.f[STOP_SECONDS] = max(params.shortest_stop_s, min(gentle, room))  # harder rather than out of range
    set_mode(state, STOPPING)


@lean_kernel
def guardian_alive(params: ServoParameters, mail: Any, now_ns: int) -> bool:
    """The guardian's heartbeat is fresh, or none is required.

    None comes from the future, but for one that was made before the time of an emulated arm was put back.
    """
    timeout_ns = params.guardian_timeout_ns
    early_ns = timeout_ns + (PUT_BACK_NS if params.board_slips != 0 else 0)
    return timeout_ns == 0 or -early_ns <= now_ns - mail[GUARD_T_NS] <= timeout_ns


@lean_kernel
def watch_surroundings(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Raise what the board, the guardian and the operator's chain call for."""
    mode, status = state.i[MODE], state.i[STATUS]
    if mail[GUARD_TAKEOVER] != 0:
        report_fault(state, GUARD_TRIP)
    if state.i[IMAGE_OK] == 0:
        if mode == OFF:
            note_event(state, BOARD_GONE)  # nothing is driven: no fault, but no power either
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
    if state.i[IMAGE_OK] == 0:
        note_event(state, BOARD_GONE)
    elif state.i[STATUS] & STATUS_ESTOP_OK == 0:
        note_event(state, ESTOP)
    elif not guardian_alive(params, mail, now_ns):
        note_event(state, GUARD_LOST)
    elif not _at_rest(state):
        note_event(state, MOVING_AT_START)
    elif not pots_judged(params, state):
        state.i[POWER_SEEN] = 0  # as if asked in the next cycle: the potentiometers are being read
        note_event(state, NONE)  # what was said of an earlier request is no answer to this one
    elif has_table(params) and state.pots.i[VERDICT] > PLAUSIBLE:
        note_event(state, CAL_MISMATCH, state.pots.i[SUSPECT])
    else:
        note_event(state, NONE)
        state.i[POWERING_SINCE_NS] = now_ns
        set_mode(state, POWERING)


@lean_kernel
def _watch_power_up(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    if state.i[STATUS] & STATUS_POWER != 0:
        hold_position(state)
        allow_range(params, state)
        for k in range(state.memory.size):
            state.memory[k] = 0.0
        forget_bias(state.swap)
        drop_all_frames(mail)
        set_mode(state, HOLDING if state.i[STATUS] & STATUS_CALIBRATED != 0 else UNCALIBRATED)
    elif now_ns - state.i[POWERING_SINCE_NS] > params.power_timeout_ns:
        note_event(state, POWER_NO_ACK)
        set_mode(state, OFF)


@lean_kernel
def _forget_calibration(state: ServoState) -> None:
    """Without power, asked to calibrate counters that the potentiometers contradict: they are not calibrated at all."""
    if state.pots.i[VERDICT] == IMPLAUSIBLE:
        state.i[DISCRETE_WORD] &= ~STATUS_CALIBRATED
        state.i[ADOPT] = ADOPT_JUMPED
        note_event(state, NONE)


@lean_kernel
def begin_calibration(params: ServoParameters, state: ServoState, indexes: int) -> None:
    """Leave UNCALIBRATED for CALIBRATING, or say why not; `indexes` pulses a joint, 0 for the default."""
    if not has_table(params):
        note_event(state, CAL_NO_TABLE)
        return
    wanted = indexes if indexes > 0 else DEFAULT_INDEXES
    state.cal.i[WANTED] = min(max(wanted, FEWEST_INDEXES), MOST_INDEXES)
    state.cal.i[STAGE], state.cal.f[SPEED] = STAGE_IDLE, 0.0
    note_event(state, NONE)
    set_mode(state, CALIBRATING)


@lean_kernel
def _obey_calibration(params: ServoParameters, state: ServoState, mail: Any, stopped: bool) -> None:
    """Begin a calibration when asked to, end it when asked to stop."""
    mode = state.i[MODE]
    asked = mail[COMMAND_CALIBRATE] != state.i[CALIBRATES_SEEN]
    state.i[CALIBRATES_SEEN] = mail[COMMAND_CALIBRATE]
    if mode == CALIBRATING and stopped:
        note_event(state, CAL_STOPPED, state.cal.i[JOINT_NOW])
        hold_position(state)
        set_mode(state, UNCALIBRATED)
    elif mode == UNCALIBRATED and asked:
        begin_calibration(params, state, mail[COMMAND_INDEXES])
    elif mode == OFF and asked:
        _forget_calibration(state)


@lean_kernel
def _watch_stream(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    play, code, joint = stream_ready(params, state, mail, now_ns)
    if code != 0:
        note_event(state, code, joint)
    elif play:
        forget_yielding(state)  # what stopped the last one may have ended in a fault
        start_stream(params, state, now_ns)
        set_mode(state, TRACKING)


@lean_kernel
def _leave_fault(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Grant a clear once the cause is gone; say so when it does not go."""
    if state.i[CLEAR_UNTIL_NS] == 0:
        return
    mail[BEAT_TRIPS_SEEN] = mail[GUARD_TRIPS]  # asks the guardian to hand the board back
    estop_ok = state.i[STATUS] & STATUS_ESTOP_OK != 0
    if state.i[IMAGE_OK] != 0 and estop_ok and mail[GUARD_TAKEOVER] == 0 and guardian_alive(params, mail, now_ns):
        if state.i[GLITCHES] != 0:
            state.i[ADOPT] = ADOPT_JUMPED
        if state.i[LAW_FAILED] != 0:
            fall_back(state.swap)
        state.i[FAULT], state.i[LAW_FAILED], state.i[CLEAR_UNTIL_NS] = 0, 0, 0
        note_event(state, NONE)
        set_mode(state, OFF)
    elif now_ns > state.i[CLEAR_UNTIL_NS]:
        note_event(state, RESET_DENIED)
        state.i[CLEAR_UNTIL_NS] = 0


@lean_kernel
def _power_off(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """The power request is gone: stop first when moving."""
    if state.i[MODE] == TRACKING or state.i[MODE] == STOPPING:
        begin_stop(params, state, mail, now_ns, OFF)
    elif state.i[MODE] != FAULTED:
        if state.i[MODE] == CALIBRATING:
            note_event(state, CAL_STOPPED, state.cal.i[JOINT_NOW])
        set_mode(state, OFF)


@lean_kernel
def power_wanted(state: ServoState, mail: Any) -> int:
    """1 while the commander wants power and nobody has taken it away since they asked for it."""
    asked = mail[COMMAND_POWER] != 0
    if mail[COMMAND_OFFS] != state.i[OFFS_SEEN]:
        state.i[POWER_LOCKED] = 1
    if not asked:
        state.i[POWER_LOCKED] = 0
    state.i[OFFS_SEEN] = mail[COMMAND_OFFS]
    return 1 if asked and state.i[POWER_LOCKED] == 0 and mail[COMMAND_SHUTDOWN] == 0 else 0


@lean_kernel
def handle_requests(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Act on what the commander asks and on what the present mode waits for."""
    power = power_wanted(state, mail)
    asked_now = power == 1 and state.i[POWER_SEEN] == 0
    cleared = mail[COMMAND_CLEARS] != state.i[CLEARS_SEEN]
    stopped = mail[COMMAND_STOPS] != state.i[STOPS_SEEN]
    state.i[POWER_SEEN], state.i[CLEARS_SEEN] = power, mail[COMMAND_CLEARS]
    state.i[STOPS_SEEN] = mail[COMMAND_STOPS]
    _obey_calibration(params, state, mail, stopped)
    mode = state.i[MODE]
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
            state.i[CLEAR_UNTIL_NS] = now_ns + CLEAR_PATIENCE_NS
        _leave_fault(params, state, mail, now_ns)


@lean_kernel
def apply_faults(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Act on the worst code of this tick."""
    code = state.i[PENDING]
    if code == 0:
        return
    note_event(state, code, state.i[PENDING_JOINT])
    state.i[PENDING] = 0
    mode, category = state.i[MODE], category_of(code)
    if code == COLLISION and mode in (TRACKING, STOPPING):
        state.watch.i[YIELDS] = 1
    if category == 0 or (category == 1 and mode not in (TRACKING, STOPPING)):
        state.i[FAULT] = code
        end_stream(state, mail)
        set_mode(state, FAULTED)
    elif category == 1:
        state.i[FAULT] = code
        begin_stop(params, state, mail, now_ns, FAULTED)
    elif mode == TRACKING:
        begin_stop(params, state, mail, now_ns, HOLDING)
    if state.i[MODE] != mode:
        note_incident(
            state.watch.incident, now_ns, state.i[TICK], code, state.i[JOINT], state.f[PENDING_VALUE],
            state.f[PENDING_LIMIT], mode, state.i[MODE], state.i[NEXT_SEQ] - 1,
        )  # fmt: skip


@lean_kernel
def finish_stop(state: ServoState) -> None:
    """The stop has come to rest: go where it was meant to end. After a collision the arm is held where it got to."""
    if state.i[AFTER_STOP] == HOLDING and state.watch.i[YIELDS] != 0:
        hold_position(state)
    elif state.i[AFTER_STOP] == HOLDING:
        hold_reference(state)
    forget_yielding(state)
    set_mode(state, state.i[AFTER_STOP])
