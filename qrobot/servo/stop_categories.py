"""Stop category of each code, after IEC 60204-1 (`modes.StopCategory`)."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.faultcodes import FaultCode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.modes import StopCategory

_CATEGORY: Final[dict[FaultCode, StopCategory]] = {
    FaultCode.VEL_LIMIT: StopCategory.CATEGORY_1,
    FaultCode.JOINT_LIMIT: StopCategory.CATEGORY_1,
    FaultCode.BOARD_CLOCK: StopCategory.CATEGORY_1,
    FaultCode.ENC_LOSS: StopCategory.CATEGORY_1,
    FaultCode.GUARD_LOST: StopCategory.CATEGORY_1,
    FaultCode.LAW_NAN: StopCategory.CATEGORY_1,
    FaultCode.LAW_SLOW: StopCategory.CATEGORY_1,
    FaultCode.LAW_BOUNDS: StopCategory.CATEGORY_1,
    FaultCode.OVERRUN: StopCategory.CATEGORY_1,
    **{code: StopCategory.CATEGORY_2 for code in FaultCode if code.name.startswith("CAL_")},
    FaultCode.STREAM_LOST: StopCategory.CATEGORY_2,
    FaultCode.SP_INVALID: StopCategory.CATEGORY_2,
    FaultCode.SP_LIMIT: StopCategory.CATEGORY_2,
    FaultCode.SP_STEP: StopCategory.CATEGORY_2,
    FaultCode.START_POSE: StopCategory.CATEGORY_2,
    FaultCode.POWER_NO_ACK: StopCategory.CATEGORY_2,
    FaultCode.POWER_STOPPED: StopCategory.CATEGORY_2,
    FaultCode.RESET_DENIED: StopCategory.CATEGORY_2,
    FaultCode.SATURATED: StopCategory.CATEGORY_2,
    FaultCode.IO_LOST: StopCategory.CATEGORY_2,
    FaultCode.COLLISION: StopCategory.CATEGORY_2,
    FaultCode.CFG_GAIN: StopCategory.CATEGORY_2,
    FaultCode.RATE: StopCategory.CATEGORY_2,
    FaultCode.RT_BUDGET: StopCategory.CATEGORY_2,
    FaultCode.PAGEFAULT: StopCategory.CATEGORY_2,
    FaultCode.HOLD_TO_RUN: StopCategory.CATEGORY_2,
    FaultCode.T1_LIMIT: StopCategory.CATEGORY_2,
    FaultCode.FENCE: StopCategory.CATEGORY_2,
}


def stop_category(code: FaultCode) -> StopCategory:
    """Stop category that follows from a code; whatever the table does not soften is category 0."""
    return _CATEGORY.get(code, StopCategory.CATEGORY_0)


_CATEGORY_BY_NUMBER: Final = np.zeros(256, dtype=np.int64)
for _code in FaultCode:
    _CATEGORY_BY_NUMBER[_code] = stop_category(_code)


@lean_kernel
def category_of(code: int) -> int:
    """Stop category of a code number; category 0 for a number out of range."""
    if 0 <= code < _CATEGORY_BY_NUMBER.size:
        return int(_CATEGORY_BY_NUMBER[code])
    return 0
