"""Binary outputs: what the program asks for, less what a stop has switched off.

A line that goes off at a stop is locked as long as its program goes on asking for it: nothing comes on again because
somebody has cleared a fault. A line that holds follows its program, and stays as it was left when that has gone.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.config.outputs import N_OUTPUTS
from qrobot.hwif.operations import put_outputs
from qrobot.hwif.registers import DISCRETE_LINES, STATUS_ESTOP_OK
from qrobot.modecodes import Mode
from qrobot.realtime.atomics import load_acquire
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import (
    ServoState,
)

STOPPING: Final = int(Mode.STOPPING)
FAULTED: Final = int(Mode.FAULT)


@lean_kernel
def asked_outputs(params: ServoParameters, state: ServoState, mail: Any) -> int:
    """Outputs that the program asks for, behind which what it has let go of is locked no longer.

    To be read before `stop_stands`, which reads when it was said: what is new is not locked for the silence before it.
    """
    lines = params.outputs.lines
    if lines == 0:
        return 0
    for k in range(N_OUTPUTS):
        let_go = load_acquire(mail.command.outputs_let_go, k)
        if let_go != state.outputs_let_go[k]:
            state.outputs_let_go[k] = let_go
            state.outputs_locked &= ~(1 << k)
    return int(load_acquire(mail.command, "outputs") & lines)  # behind what was let go of, which is told after it


@lean_kernel
def stop_stands(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> bool:
    """The arm is being stopped, or was; its board or the emergency stop is open; or nobody commands it."""
    asked = state.stop_asked != 0 or state.power_locked != 0
    open_chain = state.image_ok == 0 or state.status & STATUS_ESTOP_OK == 0
    silent = now_ns - mail.command.outputs_ns > params.outputs.patience_ns or mail.command.shutdown != 0
    return bool(asked or open_chain or silent or state.mode in (STOPPING, FAULTED))


@lean_kernel
def settle_outputs(params: ServoParameters, state: ServoState, mail: Any, asked: int, stopped: bool) -> None:
    """The outputs of this cycle, and the board's own lines among them in the shadow of DISCRETE.

    `asked` is what `asked_outputs` tells, `stopped` what `stop_stands` does.
    """
    lines = params.outputs
    if lines.lines == 0:
        return
    if stopped:
        state.outputs_locked |= lines.off
    state.outputs_locked &= asked
    state.outputs = asked & ~state.outputs_locked
    word = state.discrete_word & ~DISCRETE_LINES
    for k in range(N_OUTPUTS):
        if state.outputs >> k & 1 != 0:
            word |= lines.discrete[k]
    state.discrete_word = word
    mail.heartbeat.lines, mail.heartbeat.kept = lines.lines, state.outputs & ~lines.off


@lean_kernel
def post_outputs(params: ServoParameters, state: ServoState, n: int) -> int:
    """Tell the modules beside the board what is new, all of it to a board that is new; returns the list's length."""
    if params.outputs.lines == 0 or (state.outputs == state.outputs_sent and state.discrete_sent >= 0):
        return n
    state.outputs_sent = state.outputs
    return put_outputs(state.ops, n, state.outputs)
