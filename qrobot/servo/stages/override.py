"""Input of operator and program beside the setpoints: the speed override, the pause, numbers for the log.

The servo only hands override and pause on, in STATE and to the log: whoever generates the setpoints obeys them,
smoothly and on the path. A stop leaves them as they are; a servo starts with 1 and without a pause.

A program that keeps its path goes back to it when a pause ends. Where there is none, somebody's word to go on is told
as a pause of `NOTICED_NS`; one that somebody asks for meanwhile stays.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.modecodes import Mode
from qrobot.realtime.atomics import load_acquire
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.state import ServoState
from qrobot.wire.vocabulary import LARGEST_OVERRIDE

NOTICED_NS: Final = 250_000_000  # [A] every program has heard of it by then: over two of the longest periods
TRACKING: Final = int(Mode.TRACKING)


@lean_kernel
def take_override(state: ServoState, mail: Any) -> None:
    """Take override, pause and the program's numbers; an override that cannot be leaves the one before in force."""
    command = mail.command
    override = command.override
    if 0.0 <= override <= LARGEST_OVERRIDE:  # not so for NaN
        state.override = override
    resumes = load_acquire(command, "resumes")
    if resumes != state.resumes_seen:
        state.resumed_until_ns = state.t_ns + NOTICED_NS
    if state.mode == TRACKING:  # nothing waits for a word, and what is stopped later does not wait for this one
        state.resumed_until_ns = 0
    state.resumes_seen = resumes
    state.paused = 1 if command.paused != 0 or state.t_ns < state.resumed_until_ns else 0
    for k in range(state.program_signals.size):
        state.program_signals[k] = command.program_signals[k]
