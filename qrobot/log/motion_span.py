"""The part of a log in which the arm is led: runs that waited differently before it have one time axis then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from qrobot.log.read import Log
from qrobot.modecodes import Mode

MOVING: Final = 1e-3  # rad/s or m/s of a desired velocity that is motion [A]
BESIDE_S: Final = 1.0  # shown before the first motion and after the last


def around_motion(logs: Sequence[Log]) -> list[Log]:
    """The same logs from a second before their first motion to a second after their last.

    All begin equally long before it, so that `time_s` of their first motions agrees. A log without motion stays whole.
    """
    spans = [_motion(log) for log in logs]
    lead_s = min([BESIDE_S, *(float(log.time_s[span[0]]) for log, span in zip(logs, spans, strict=True) if span)])
    return [_cut(log, span, lead_s) if span else log for log, span in zip(logs, spans, strict=True)]


def _motion(log: Log) -> tuple[int, int] | None:
    """Rows of the first and the last cycle with a desired velocity; None when there is none."""
    led = (np.abs(log.rows["v_ref"]) > MOVING).any(axis=1) & (log.rows["mode"] == Mode.TRACKING)
    rows = np.flatnonzero(led)
    return (int(rows[0]), int(rows[-1])) if rows.size else None


def _cut(log: Log, span: tuple[int, int], lead_s: float) -> Log:
    begin_s, end_s = log.time_s[list(span)]
    first, last = np.searchsorted(log.time_s, [begin_s - lead_s, end_s + BESIDE_S])
    return replace(log, rows=log.rows[first : last + 1])
