"""Input of operator and program beside the setpoints: the speed override, the pause, numbers for the log.

The servo only hands override and pause on, in STATE and to the log: whoever generates the setpoints obeys them,
smoothly and on the path. A stop leaves them as they are; a servo starts with 1 and without a pause.
"""

from __future__ import annotations

from typing import Any

from qrobot.realtime.jit import lean_kernel
from qrobot.servo.state import ServoState
from qrobot.wire.vocabulary import LARGEST_OVERRIDE


@lean_kernel
def take_override(state: ServoState, mail: Any) -> None:
    """Take override, pause and the program's numbers; an override that cannot be leaves the one before in force."""
    command = mail.command
    override = command.override
    if 0.0 <= override <= LARGEST_OVERRIDE:  # not so for NaN
        state.override = override
    state.paused = 1 if command.paused != 0 else 0
    for k in range(state.program_signals.size):
        state.program_signals[k] = command.program_signals[k]
