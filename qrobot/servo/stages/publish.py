"""What the servo says of each cycle: the state for whoever looks, the heartbeat, the telemetry row."""

from __future__ import annotations

from typing import Any, Final

from qrobot.hwif.registers import (
    N_ADCS,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_INPUTS,
    STATUS_POWER,
)
from qrobot.realtime.atomics import store_release
from qrobot.realtime.flat_record import float_bits
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.laws.law import SIGNALS_AT
from qrobot.servo.memory.mailbox import (
    BEAT_T_NS,
    CALIBRATION_STAGE,
    COMMAND_HAND,
    FLAG_AT_REST,
    FLAG_CALIBRATED,
    FLAG_ESTOP_OK,
    FLAG_GUARDED,
    FLAG_POWERED,
    FLAG_UNSEEN,
    FORCE_AXES,
    STATE_EVENT,
    STATE_FAULT,
    STATE_FLAGS,
    STATE_HAND,
    STATE_INPUTS,
    STATE_JOINT,
    STATE_LATE,
    STATE_MISSED,
    STATE_MODE,
    STATE_OUTPUTS,
    STATE_SEQ,
    STATE_T_NS,
    STATE_TICK,
    STATE_VECTORS,
    publish_calibration,
    publish_state,
)
from qrobot.servo.memory.telemetry import N_SIGNALS
from qrobot.servo.modes import Mode
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.stages.mode_machine import (
    guardian_alive,
)
from qrobot.servo.state import (
    ServoState,
)

CALIBRATING: Final = int(Mode.CALIBRATING)


@lean_kernel
def publish(params: ServoParameters, state: ServoState, mail: Any, now_ns: int, late_ns: int) -> None:
    """Publish heartbeat and state; fill the telemetry row (the loop appends it)."""
    n = state.q.size
    state.flag_bits = compose_flags(params, state, mail, now_ns)
    block = state.block
    block[STATE_T_NS], block[STATE_TICK] = now_ns, state.tick
    block[STATE_MODE], block[STATE_FAULT] = state.mode, state.fault
    block[STATE_EVENT], block[STATE_JOINT] = state.event, state.joint
    block[STATE_FLAGS], block[STATE_SEQ] = state.flag_bits, state.next_seq - 1
    block[STATE_MISSED], block[STATE_LATE] = state.missed, state.late
    block[STATE_INPUTS], block[STATE_HAND] = state.status & STATUS_INPUTS, mail[COMMAND_HAND]
    block[STATE_OUTPUTS] = state.outputs
    for j in range(n):
        block[STATE_VECTORS + j] = float_bits(state.q[j])
        block[STATE_VECTORS + n + j] = float_bits(state.v[j])
        block[STATE_VECTORS + 2 * n + j] = float_bits(state.tau[j])
        block[STATE_VECTORS + 3 * n + j] = float_bits(state.q_ref[j])
    for k in range(FORCE_AXES):
        block[STATE_VECTORS + 4 * n + k] = float_bits(state.wrench[k])
    publish_state(mail, n, block)
    if state.mode == CALIBRATING or mail[CALIBRATION_STAGE] != 0:
        cal = state.cal
        publish_calibration(mail, n, cal, cal.stage, cal.joint_now, cal.found, cal.wanted)
    store_release(mail, BEAT_T_NS, state.began_ns)
    fill_row(state, now_ns, late_ns)


@lean_kernel
def compose_flags(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> int:
    """FLAG_* of this tick."""
    status, flags = state.status, 0
    if state.image_ok != 0 and status & STATUS_POWER != 0:
        flags |= FLAG_POWERED
    if status & STATUS_CALIBRATED != 0:
        flags |= FLAG_CALIBRATED
    if status & STATUS_ESTOP_OK != 0:
        flags |= FLAG_ESTOP_OK
    if guardian_alive(params, mail, now_ns):
        flags |= FLAG_GUARDED
    at_rest = True
    for j in range(state.v_ref.size):
        at_rest = at_rest and state.v_ref[j] == 0.0
    return flags | FLAG_AT_REST if at_rest else flags


@lean_kernel
def fill_row(state: ServoState, now_ns: int, late_ns: int) -> None:
    """The telemetry row, in the order of `servo.memory.telemetry`."""
    row, n = state.row, state.q.size
    row[0], row[1], row[2], row[3] = state.tick, now_ns, late_ns, state.busy_ns
    row[4], row[5] = state.mode, state.event
    row[6] = state.next_seq - 1
    row[7] = state.flag_bits | state.unseen * FLAG_UNSEEN | state.clipped << 8 | state.misses << 16
    for j in range(n):
        row[8 + j] = float_bits(state.q_ref[j])
        row[8 + n + j] = float_bits(state.v_ref[j])
        row[8 + 2 * n + j] = float_bits(state.a_ref[j])
        row[8 + 3 * n + j] = float_bits(state.q[j])
        row[8 + 4 * n + j] = float_bits(state.v[j])
        row[8 + 5 * n + j] = float_bits(state.tau[j])
        row[8 + 6 * n + j] = state.counts[j]
        row[8 + 7 * n + j] = state.dac[j]
        row[8 + 8 * n + j] = float_bits(state.gravity[j])
        row[8 + 9 * n + j] = float_bits(state.friction[j])
    at = 8 + 10 * n
    for k in range(N_ADCS):
        row[at + k] = float_bits(state.sensors[k])
    at += N_ADCS
    for k in range(FORCE_AXES):
        row[at + k] = float_bits(state.wrench[k])
    at += FORCE_AXES
    for k in range(N_SIGNALS):
        row[at + k] = float_bits(state.memory[SIGNALS_AT + k])
    at += N_SIGNALS
    row[at] = state.status & STATUS_INPUTS
    row[at + 1] = state.outputs
    row[at + 2] = state.joint
