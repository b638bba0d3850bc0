"""The servo stops an arm that comes too near another one, or does not know where that one is (`servo.neighbour`)."""

from __future__ import annotations

from typing import Final

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.event import report_fault
from qrobot.servo.neighbour import DISTANCE, LOOKS, LOOKS_SEEN, MARGIN, SILENT_CYCLES, VERDICT
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

TRACKING: Final = int(Mode.TRACKING)
FENCE: Final = int(FaultCode.FENCE)


@lean_kernel
def watch_neighbours(params: ServoParameters, state: ServoState) -> None:
    """Raise FENCE while an arm moves whose neighbour is too near or not heard of, or at whom nobody looks."""
    if params.neighbour_patience == 0:
        return
    told = state.neighbour
    for k in range(params.n_neighbours):
        told[k, SILENT_CYCLES] = 0.0 if told[k, LOOKS] != told[k, LOOKS_SEEN] else told[k, SILENT_CYCLES] + 1.0
        told[k, LOOKS_SEEN] = told[k, LOOKS]
        stop = told[k, VERDICT] != 0.0 or told[k, SILENT_CYCLES] > params.neighbour_patience
        if stop and state.mode == TRACKING:
            report_fault(state, FENCE, NO_JOINT, told[k, DISTANCE], told[k, MARGIN])
