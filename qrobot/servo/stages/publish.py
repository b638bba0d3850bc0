"""Publish each cycle: the state for other processes, the heartbeat, the telemetry row."""

from __future__ import annotations

from typing import Any, Final

from qrobot.hwif.registers import STATUS_CALIBRATED, STATUS_ESTOP_OK, STATUS_INPUTS, STATUS_POWER
from qrobot.modecodes import Mode
from qrobot.realtime.atomics import store_release
from qrobot.realtime.flat_record import copy_fields
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.calibration.potentiometers import has_table
from qrobot.servo.calibration.state import IMPLAUSIBLE, PLAUSIBLE
from qrobot.servo.laws.law import SIGNALS_AT
from qrobot.servo.memory.published_state import (
    FLAG_AT_REST,
    FLAG_CALIBRATED,
    FLAG_ESTOP_OK,
    FLAG_GUARDED,
    FLAG_HALTED,
    FLAG_NO_TORQUES,
    FLAG_PAUSED,
    FLAG_POWERED,
    publish_state,
)
from qrobot.servo.memory.telemetry import FLAG_UNSEEN
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.stages.inputs import GLITCHES_TO_FAULT
from qrobot.servo.stages.mode_machine import guardian_alive
from qrobot.servo.state import ServoState

CALIBRATING: Final = int(Mode.CALIBRATING)


@lean_kernel
def publish(params: ServoParameters, state: ServoState, mail: Any, now_ns: int, late_ns: int) -> None:
    """Publish heartbeat and state; fill the telemetry row (the loop appends it)."""
    state.pots_verdict = state.pots.verdict if has_table(params) else PLAUSIBLE
    state.flag_bits = compose_flags(params, state, mail, now_ns)
    state.setpoint_seq = state.next_seq - 1
    state.inputs, state.hand = state.status & STATUS_INPUTS, mail.command.hand
    publish_state(mail, state)
    if state.mode == CALIBRATING or mail.calibration.stage != 0:
        publish_calibration(mail, state.cal)
    store_release(mail.heartbeat, "t_ns", state.began_ns)
    fill_row(state, late_ns)


@lean_kernel
def publish_calibration(mail: Any, calibration: Any) -> None:
    """Tell how far a calibration (`servo.calibration.state`) is."""
    now = mail.calibration
    now.stage, now.joint, now.found, now.wanted = (
        calibration.stage,
        calibration.joint_now,
        calibration.found,
        calibration.wanted,
    )
    copy_fields(calibration, mail.results)


@lean_kernel
def _counters_are_doubted(state: ServoState) -> bool:
    """True of counters that have jumped, or that the potentiometers contradict."""
    return bool(state.glitches >= GLITCHES_TO_FAULT or state.pots_verdict == IMPLAUSIBLE)


@lean_kernel
def compose_flags(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> int:
    """FLAG_* of this tick."""
    status, flags = state.status, 0
    calibrated = status & state.discrete_word & STATUS_CALIBRATED  # a board tells some cycles later what it was told
    if state.image_ok != 0 and status & STATUS_POWER != 0:
        flags |= FLAG_POWERED
    if state.image_ok != 0 and calibrated != 0 and not _counters_are_doubted(state):
        flags |= FLAG_CALIBRATED
    if status & STATUS_ESTOP_OK != 0:
        flags |= FLAG_ESTOP_OK
    if guardian_alive(params, mail, now_ns):
        flags |= FLAG_GUARDED
    if state.halted != 0:
        flags |= FLAG_HALTED
    if state.paused != 0:
        flags |= FLAG_PAUSED
    if params.position_drives != 0:
        flags |= FLAG_NO_TORQUES
    at_rest = True
    for j in range(state.v_ref.size):
        at_rest = at_rest and state.v_ref[j] == 0.0
    return flags | FLAG_AT_REST if at_rest else flags


@lean_kernel
def fill_row(state: ServoState, late_ns: int) -> None:
    """Fill the telemetry row with the fields of the state that it tells."""
    state.late_ns = late_ns + state.skipped_ns
    told = state.flag_bits & ~FLAG_HALTED  # whose bit is FLAG_UNSEEN in a row
    state.flag_word = told | state.unseen * FLAG_UNSEEN | state.clipped << 8 | state.misses << 16
    for k in range(state.signals.size):
        state.signals[k] = state.memory[SIGNALS_AT + k]
    copy_fields(state, state.row)
