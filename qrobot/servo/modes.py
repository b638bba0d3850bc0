"""The modes of the servo. The table below *is* the state machine; its picture in the docs is generated from it.

Rules:

* torque leaves the DACs only in the modes of `TORQUE_ON`; arm power is requested only in those of `POWER_ON`;
* only TRACKING follows setpoints; every way out of it leads through STOPPING into HOLDING, or into OFF where
  power off was asked for, unless a fault leads to FAULT;
* FAULT is latched: it is left for OFF alone, by an explicit clear once its cause is gone, and never moves the arm;
* power comes back only by an explicit request made in OFF.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any, Final

import numpy as np

from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel


class StopCategory(IntEnum):
    """Stop categories of IEC 60204-1, and how the servo ends each."""

    CATEGORY_0 = 0  # torque and power off at once, brakes close
    CATEGORY_1 = 1  # controlled stop, then power off
    CATEGORY_2 = 2  # controlled stop, then hold


TRANSITIONS: Final[dict[Mode, dict[Mode, str]]] = {
    Mode.OFF: {
        Mode.POWERING: "power requested",
        Mode.FAULT: "feedback or process fault",
    },
    Mode.POWERING: {
        Mode.UNCALIBRATED: "power is on, counters not calibrated",
        Mode.HOLDING: "power is on, counters calibrated",
        Mode.OFF: "power request withdrawn, stopped, or no power in time",
        Mode.FAULT: "category 0 or 1 fault",
    },
    Mode.UNCALIBRATED: {
        Mode.CALIBRATING: "calibrate",
        Mode.OFF: "power off requested",
        Mode.FAULT: "category 0 or 1 fault",
    },
    Mode.CALIBRATING: {
        Mode.HOLDING: "counters loaded",
        Mode.UNCALIBRATED: "calibration stopped, or it failed",
        Mode.OFF: "power off requested",
        Mode.FAULT: "category 0 or 1 fault",
    },
    Mode.HOLDING: {
        Mode.TRACKING: "setpoints arrive and begin where the arm stands",
        Mode.OFF: "power off requested",
        Mode.FAULT: "category 0 or 1 fault",
    },
    Mode.TRACKING: {
        Mode.STOPPING: "stop or power off requested, or category 1 or 2 fault, as a lost stream",
        Mode.FAULT: "category 0 fault",
    },
    Mode.STOPPING: {
        Mode.HOLDING: "at rest after a category 2 stop",
        Mode.OFF: "at rest, power off was requested",
        Mode.FAULT: "at rest after a category 1 stop, or category 0 fault",
    },
    Mode.FAULT: {
        Mode.OFF: "cleared, and the cause is gone",
    },
}

POWER_ON: Final = frozenset(
    {Mode.POWERING, Mode.UNCALIBRATED, Mode.CALIBRATING, Mode.HOLDING, Mode.TRACKING, Mode.STOPPING}
)
TORQUE_ON: Final = frozenset({Mode.UNCALIBRATED, Mode.CALIBRATING, Mode.HOLDING, Mode.TRACKING, Mode.STOPPING})

_N_MODES: Final = len(Mode)


def _allowed_matrix() -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    allowed = np.zeros((_N_MODES, _N_MODES), dtype=np.bool_)
    for origin, targets in TRANSITIONS.items():
        for target in targets:
            allowed[origin, target] = True
    return allowed


_ALLOWED: Final = _allowed_matrix()
_POWER: Final = np.array([mode in POWER_ON for mode in Mode])
_TORQUE: Final = np.array([mode in TORQUE_ON for mode in Mode])


@lean_kernel
def may_follow(origin: int, target: int) -> bool:
    """True when the table lets `target` follow `origin`."""
    return bool(_ALLOWED[origin, target])


@lean_kernel
def wants_power(mode: int) -> bool:
    """True when arm power is to be enabled in this mode."""
    return bool(_POWER[mode])


@lean_kernel
def gives_torque(mode: int) -> bool:
    """True when the DACs may carry the law's torque in this mode."""
    return bool(_TORQUE[mode])


@lean_kernel
def set_mode(state: Any, mode: int) -> None:
    """Change the mode of a `ServoState`, if the table has such a transition."""
    if may_follow(state.mode, mode):
        state.mode = mode


def mermaid() -> str:
    """The state diagram of the documentation."""
    lines = ["stateDiagram-v2", "    [*] --> OFF"]
    lines += [
        f"    {origin.name} --> {target.name}: {why}"
        for origin, targets in TRANSITIONS.items()
        for target, why in targets.items()
    ]
    return "\n".join(lines) + "\n"


@lean_kernel
def gives_way(state: Any) -> bool:
    """The arm may be pushed from its setpoint: it is led, it complies with what it has met, or its law is soft."""
    yields = state.guided != 0 or (state.watch.reaction != 0 and state.watch.yields != 0)
    return bool(state.law_failed == 0 and (state.swap.compliant != 0 or yields))
