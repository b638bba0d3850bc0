"""Hold to run: a stream that moves the arm only while somebody holds a key, as ISO 10218-1 wants it of manual jogging.

Whoever commands says so of a stream, and then, again and again, that the key is held. When that stays away - the key is
released, the link lost, the program or its key hangs - an arm that moves is stopped on its path, and held.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.event import report_fault
from qrobot.servo.memory.setpoint_queue import TORQUE_SETPOINT
from qrobot.servo.parameters import PUT_BACK_NS, ServoParameters
from qrobot.servo.state import ServoState

HOLD_TO_RUN: Final = int(FaultCode.HOLD_TO_RUN)
TRACKING: Final = int(Mode.TRACKING)
PATIENCE_NS: Final = (
    70_000_000  # [A] two frames of 28 ms and a quarter; the stop begins within 100 ms, as faults.md says
)
EARLY_NS: Final = 10_000_000  # [A] by which a word may have come after the beginning of the cycle that sees it


@lean_kernel
def hear_key(params: ServoParameters, state: ServoState, held_ns: int) -> None:
    """Take what was said last of the key, at `held_ns`, but as said in this cycle at the latest.

    It may have come since the cycle began, or before the time of an emulated arm was put back; what lies farther in the
    future was never said, and counts for nothing.
    """
    if held_ns != state.key_told_ns:
        state.key_told_ns = state.key_ns = held_ns
    early_ns = EARLY_NS + (PUT_BACK_NS if params.board_slips != 0 else 0)
    if 0 < state.key_ns - state.began_ns <= early_ns:
        state.key_ns = state.began_ns


@lean_kernel
def key_is_held(asked: int, stream: int, held_ns: int, now_ns: int) -> bool:
    """True while `stream` may move: no key is asked for, or it was said to be held not long ago, and not in future."""
    return asked != stream + 1 or 0 <= now_ns - held_ns <= PATIENCE_NS


@lean_kernel
def watch_key(params: ServoParameters, state: ServoState, mail: Any) -> None:
    """Stop an arm that moves without its key, or gives way without it."""
    hear_key(params, state, mail.command.held_ns)
    if state.mode != TRACKING:
        return
    if key_is_held(mail.command.held_stream, state.stream, state.key_ns, state.began_ns):
        return
    for j in range(state.v_ref.size):
        if state.v_ref[j] != 0.0 or state.joint_modes[j] == TORQUE_SETPOINT:
            report_fault(state, HOLD_TO_RUN, NO_JOINT, (state.began_ns - state.key_ns) * 1e-9, PATIENCE_NS * 1e-9)
            return
