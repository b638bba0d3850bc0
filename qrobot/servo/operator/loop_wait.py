"""Waits of operator requests for the servo's loop, which may not run."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from qrobot.errors import LinkTimeout
from qrobot.realtime.deadline import Deadline, comes_true
from qrobot.servo.memory.mailbox import ServoMailbox

LOOP_PATIENCE_S: Final = 0.5
_POLL_S: Final = 0.002
_EDGE_TICKS: Final = 2  # then the servo has looked


def await_loop(condition: Callable[[], bool], seconds: float = 0.0) -> None:
    """Wait for what the loop does, which takes so many seconds. Raises LinkTimeout when it does not run."""
    if not comes_true(condition, Deadline(LOOP_PATIENCE_S + seconds), _POLL_S):
        raise LinkTimeout("the servo's loop does not run: if the arm is not at rest, use the emergency stop")


def seen_by_loop(mailbox: ServoMailbox) -> Callable[[], bool]:
    """Tells whether the loop has seen what has been requested until now."""
    tick = mailbox.snapshot().tick
    return lambda: bool(mailbox.snapshot().tick >= tick + _EDGE_TICKS)
