"""Span of the guardian's watch: from before the first write that drives anything until the board shows that none does.

The board holds its last words, so neither what the servo means to write nor what it has posted says what the motors
get. The mark in the servo's heartbeat is therefore set before anything is posted that drives motors, brakes or outputs,
and taken back only when the board

* has taken a list with zero torque and without power, and everything posted before it,
* has shown two new images since, for the one in the making may lack them, and
* shows in the newest that arm power is off.

Until then a servo without power says so again in every cycle. One that has just started is armed as well: nobody knows
what a predecessor has left at the board. On every way to a board an image follows the operations taken before it, or
the board is lost and made safe when it is found again.

While the guardian has the board the servo posts nothing. That is looked at where a list is made, and again where it is
posted, and where it is written to a card: a servo that stalls on its way would undo what the guardian has done
meanwhile.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.hwif.board_memory import IMAGES_TO_SHOW, BoardMemory, Lane
from qrobot.hwif.lanes import posted_so_far, taken_so_far
from qrobot.hwif.registers import STATUS_POWER
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.memory.servo_memory import NOT_TAKEN, TAKEN
from qrobot.servo.modes import wants_power
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import (
    ServoState,
)

SERVO_LANE: Final = int(Lane.SERVO)
NO_LIST: Final = -1


@lean_kernel
def guardian_holds(params: ServoParameters, state: ServoState, mail: Any) -> bool:
    """Whether the guardian has taken the board, so that the servo writes nothing.

    One that has died since holds nothing: a servo without power writes then what makes the board safe.
    """
    if load_acquire(mail.guardian, "takeover") == NOT_TAKEN:
        return False
    timeout_ns = params.guardian_timeout_ns
    silent = timeout_ns != 0 and state.t_ns - mail.guardian.t_ns > timeout_ns
    return bool(wants_power(state.mode) or not silent)


@lean_kernel
def keep_armed(state: ServoState, mail: Any, driven: bool) -> None:
    """Have the guardian watch if the writes about to be posted drive something, or earlier ones may have."""
    state.driven = 1 if driven else 0
    if driven and state.armed == 0:
        store_release(mail.heartbeat, "t_ns", state.began_ns)  # first: no silence of an unarmed servo counts
        state.armed = 1
    store_release(mail.heartbeat, "armed", state.armed)


@lean_kernel
def say_again(state: ServoState) -> bool:
    """Whether a torque of zero has to be written again: the board has not shown it, and a write can be lost."""
    return bool(state.driven == 0 and state.armed != 0)


@lean_kernel
def stands_down(state: ServoState, mail: Any) -> bool:
    """The servo may end: its board carries nothing, it has never written to it, or the guardian has made it safe."""
    return bool(state.armed == 0 or state.started == 0 or load_acquire(mail.guardian, "takeover") == TAKEN)


@lean_kernel
def disarm_when_safe(state: ServoState, mail: Any, board: BoardMemory, held: bool, posted: bool) -> None:
    """Let the guardian stand down, after a cycle, once the board has shown that it carries neither torque nor power.

    Args:
        held: the guardian has the board.
        posted: the lane has taken this cycle's list.
    """
    if state.armed == 0 or state.started == 0:
        return
    head = posted_so_far(board, SERVO_LANE)
    if state.driven != 0 or held or head < state.safe_head:  # the last: another board's memory
        state.safe_head, state.safe_image = NO_LIST, NO_LIST
    elif state.safe_head == NO_LIST:
        state.safe_head = head if posted else NO_LIST
    elif state.safe_image == NO_LIST:
        if taken_so_far(board, SERVO_LANE) >= state.safe_head:
            state.safe_image = state.image_seen
    elif state.image_seen < state.safe_image:
        state.safe_head, state.safe_image = NO_LIST, NO_LIST  # a board that began to count anew
    elif _shown_off(state):
        state.armed = 0
        store_release(mail.heartbeat, "armed", 0)


@lean_kernel
def _shown_off(state: ServoState) -> bool:
    """The newest image was made after the safe list was taken, and shows no power."""
    new = state.image_seen - state.safe_image >= IMAGES_TO_SHOW
    return bool(new and state.image_ok != 0 and state.status & STATUS_POWER == 0)
