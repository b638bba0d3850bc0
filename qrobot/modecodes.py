"""Numbers of the servo's modes. They are part of the wire protocol and of every log."""

from __future__ import annotations

from enum import IntEnum
from typing import Any


class Mode(IntEnum):
    """Modes in which the servo keeps the arm; `qrobot.servo.modes` says which may follow which."""

    OFF = 0
    POWERING = 1
    UNCALIBRATED = 2
    CALIBRATING = 3
    HOLDING = 4
    TRACKING = 5
    STOPPING = 6
    FAULT = 7


def mode_name(mode: Any) -> str:
    """Name of a mode number, also of one this version does not know."""
    try:
        return Mode(int(mode)).name
    except ValueError:
        return f"MODE_{int(mode)}"
