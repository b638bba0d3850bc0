"""The last line before a fence: an arm that could not come to rest before one is stopped (`fences.gate`).

Programs keep the margin of each fence by themselves (`motion.planning.fence_check`); this watch trusts none of them. It
takes the measured motion, so that jogs, hand guiding and setpoints of other makers are stopped as well.
"""

from __future__ import annotations

from typing import Final

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.fences.gate import OUTSIDE, gate_at
from qrobot.fences.table import N_ROWS
from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.event import report_fault
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

TRACKING: Final = int(Mode.TRACKING)
FENCE: Final = int(FaultCode.FENCE)


@lean_kernel
def watch_fences(params: ServoParameters, state: ServoState) -> None:
    """Raise a fence that the arm would enter if it were not stopped now."""
    if params.fence_gate == 0:
        return
    if state.mode != TRACKING:
        state.fence_rows[3 * N_ROWS :] = OUTSIDE  # where it stands when it begins is where it may go on from
        return
    verdict = state.fence_verdict
    gate_at(params.fence_gate)(  # [:]: the pointer takes plain arrays, not fields of a record
        state.q[:], state.v[:], params.a_stop[:], params.stop_overshoot_s[:], params.fence_words[:],
        state.fence_work[:], state.fence_rows[:], state.fence_place[:], verdict[:],
    )  # fmt: skip
    if verdict[0] != 0.0:
        report_fault(state, FENCE, NO_JOINT, verdict[1], 0.0)
