"""Rows of telemetry that a setpoint which came late has bent: the servo goes straight on, and then leads back."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from qrobot.servo.memory.telemetry import Rows
from qrobot.units import NS_PER_MS
from tests.support.processes import UNHURRIED_MS

MISSED_BITS: Final = 16  # of the flags: from here on, the frames missed one after the other
BENT_FRAMES: Final = 5  # [A] after one that is missed: a reference is made of four setpoints


def in_time(rows: Rows, heard: Rows | None = None) -> np.ndarray[Any, Any]:
    """Whether neither the newest setpoint nor one of those before it, that the reference is made of, came late.

    Setpoints come at the longest sample period. `heard` are the rows up to the last one that came, where the stream is
    lost behind it and that is what is looked at. Shape (rows,).
    """
    heard = rows if heard is None else heard
    missed_ns = heard["t_ns"][(heard["flags"] >> MISSED_BITS) != 0]
    after = np.searchsorted(missed_ns, rows["t_ns"] - int(BENT_FRAMES * UNHURRIED_MS * NS_PER_MS), side="left")
    return after == np.searchsorted(missed_ns, rows["t_ns"], side="right")
