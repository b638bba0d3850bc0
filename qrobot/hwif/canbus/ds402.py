"""The state machine of a drive (CiA 402, IEC 61800-7-201): status words, and the control word that leads on."""

from __future__ import annotations

from enum import Enum
from typing import Final

ERROR_CODE: Final = 0x603F
MODE_WANTED: Final = 0x6060
MODE_SHOWN: Final = 0x6061
DEVICE_TYPE: Final = 0x1000
PROFILE: Final = 402  # low word of the device type

CYCLIC_POSITION: Final = 8  # modes of operation
CYCLIC_TORQUE: Final = 10

DISABLE_VOLTAGE: Final = 0x0000
SHUTDOWN: Final = 0x0006
SWITCH_ON: Final = 0x0007
ENABLE_OPERATION: Final = 0x000F
QUICK_STOP: Final = 0x0002
FAULT_RESET: Final = 0x0080


class DriveState(Enum):
    """States, with the mask and the value of the status word that show them (table 30)."""

    NOT_READY = (0x4F, 0x00)
    SWITCH_ON_DISABLED = (0x4F, 0x40)
    READY = (0x6F, 0x21)
    SWITCHED_ON = (0x6F, 0x23)
    ENABLED = (0x6F, 0x27)
    QUICK_STOPPED = (0x6F, 0x07)
    FAULT_REACTION = (0x4F, 0x0F)
    FAULT = (0x4F, 0x08)


_UP: Final = {
    DriveState.SWITCH_ON_DISABLED: SHUTDOWN,
    DriveState.READY: SWITCH_ON,
    DriveState.SWITCHED_ON: ENABLE_OPERATION,
    DriveState.ENABLED: ENABLE_OPERATION,
    DriveState.QUICK_STOPPED: DISABLE_VOLTAGE,
    DriveState.FAULT: FAULT_RESET,
}


def state_of(status: int) -> DriveState:
    """State that a status word shows; one that shows none is taken for NOT_READY."""
    for state in DriveState:
        mask, value = state.value
        if status & mask == value:
            return state
    return DriveState.NOT_READY


def towards_operation(status: int) -> int:
    """Control word of the next step to OPERATION ENABLED."""
    return _UP.get(state_of(status), DISABLE_VOLTAGE)
