"""The newest event: a code, and the joint it speaks of or `NO_JOINT`. Nobody writes one without the other."""

from __future__ import annotations

from typing import Any

from qrobot.faultcodes import NO_JOINT
from qrobot.realtime.jit import lean_kernel


@lean_kernel
def note_event(state: Any, code: int, joint: int = NO_JOINT) -> None:
    """Make `code` the newest event of a `ServoState`; 0 takes back what was said."""
    state.event = code
    state.event_joint = joint
