"""The one way to report a code: as an event, which is only told, as a warning, or as a fault, which is acted upon.

| reported by      | is told                                   | stops the arm                        |
|------------------|-------------------------------------------|--------------------------------------|
| `report_event`   | at once, in place of what was told before | no                                   |
| `report_warning` | unless something is told already          | no                                   |
| `report_fault`   | when it is acted upon (`apply_faults`)    | as its stop category says, the worst |

Nobody writes a code without the joint it speaks of, `NO_JOINT` for none. `state` is a `ServoState`.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import NO_JOINT
from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.stop_categories import category_of

FAULTED: Final = int(Mode.FAULT)


@lean_kernel
def report_event(state: Any, code: int, joint: int = NO_JOINT) -> None:
    """Make `code` the newest event; 0 takes back what was told."""
    state.event = code
    state.event_joint = joint


@lean_kernel
def report_warning(state: Any, code: int, joint: int = NO_JOINT) -> None:
    """Report something that stops nothing, unless something is told already."""
    if state.event == 0:
        report_event(state, code, joint)


@lean_kernel
def report_fault(state: Any, code: int, joint: int = NO_JOINT, value: float = 0.0, limit: float = 0.0) -> None:
    """Report a code that stops the arm, in this tick.

    Of several the one with the lowest stop category counts, then the first.

    `value` was measured where `limit` is allowed, in the unit of `faultcodes.quantity_of`. In FAULT nothing
    worse can come, and the event says what became of a clear.
    """
    if code == 0 or state.mode == FAULTED:
        return
    if state.pending == 0 or category_of(code) < category_of(state.pending):
        state.pending = code
        state.pending_joint = joint
        state.pending_value, state.pending_limit = value, limit
