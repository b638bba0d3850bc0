"""Tracking errors of a run, and the punctuality of its cycles."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from qrobot.config.scene import FORCE_AXES
from qrobot.log.read import Log
from qrobot.modecodes import Mode
from qrobot.servo.memory.telemetry import sampled
from qrobot.units import NS_PER_S


@dataclass(frozen=True)
class WakeUp:
    """Wake-up error of the cycles, us: how long after its planned time each began."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True)
class TrackingSummary:
    """One run's row in the table of `qrobot demo`.

    Attributes:
        max_abs_error: per joint, largest |desired - measured| of tracking cycles with an image, rad or m; NaN
            when there is none.
        rms_error: per joint, root mean square of the same.
        tracking_cycles: cycles in mode TRACKING.
        cycles: all cycles in the log.
        dropout_cycles: cycles without a new image, in which positions were carried on.
        late_cycles: cycles that began more than half a period late.
        skipped_cycles: cycles of the grid that never began.
        lost_rows: cycles that are missing from the log.
        wakeup_us: wake-up error over all cycles; NaN when there are none.
        faults: codes in the order in which they appeared, see `faultcodes.FaultCode`.
    """

    max_abs_error: tuple[float, ...]
    rms_error: tuple[float, ...]
    tracking_cycles: int
    cycles: int
    dropout_cycles: int
    late_cycles: int
    skipped_cycles: int
    lost_rows: int
    wakeup_us: WakeUp
    faults: tuple[int, ...]

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON; NaN becomes None."""
        return {key: plain_numbers(value) for key, value in asdict(self).items()}


def plain_numbers(value: Any) -> Any:
    """The same for JSON: NaN, which it does not know, becomes None."""
    if isinstance(value, dict):
        return {key: plain_numbers(item) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [plain_numbers(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def tracking_summary(log: Log) -> TrackingSummary:
    """Numbers of one log."""
    tracking, seen = log.rows["mode"] == Mode.TRACKING, sampled(log.rows)
    error = log.tracking_error[tracking & seen]
    return TrackingSummary(
        max_abs_error=_per_joint(np.max, np.abs(error)),
        rms_error=tuple(math.sqrt(value) for value in _per_joint(np.mean, error**2)),
        tracking_cycles=int(tracking.sum()),
        cycles=log.rows.size,
        dropout_cycles=int((~seen).sum()),
        late_cycles=int((log.rows["late_ns"] > log.header.period_ns / 2).sum()),
        skipped_cycles=_skipped_cycles(log),
        lost_rows=log.status.lost,
        wakeup_us=_wake_up(log.rows["late_ns"]),
        faults=_faults(log),
    )


def _faults(log: Log) -> tuple[int, ...]:
    codes, first = np.unique(log.rows["fault"], return_index=True)
    return tuple(int(code) for code in codes[first.argsort()] if code != 0)


def _per_joint(reduce: Any, values: NDArray[np.float64]) -> tuple[float, ...]:
    if not len(values):
        return (math.nan,) * int(values.shape[1])
    return tuple(float(value) for value in reduce(values, axis=0))


def _skipped_cycles(log: Log) -> int:
    """Points of the time grid without a cycle; rows lost by the recorder are none, because the tick counts them."""
    points = np.rint(np.diff(log.rows["t_ns"]) / log.header.period_ns)
    return int((points - np.diff(log.rows["tick"])).sum())


def _wake_up(late_ns: NDArray[np.int64]) -> WakeUp:
    if not late_ns.size:
        return WakeUp(math.nan, math.nan, math.nan)
    p50, p99, largest = np.percentile(late_ns / 1e3, [50, 99, 100])
    return WakeUp(float(p50), float(p99), float(largest))


def wall_clock(log: Log) -> str:
    """Begin of the log, UTC; empty when its time is virtual."""
    if not (log.rows.size and log.header.wall_offset_ns):
        return ""
    began_s = (int(log.rows["t_ns"][0]) + log.header.wall_offset_ns) / NS_PER_S
    try:
        return datetime.fromtimestamp(began_s, UTC).isoformat(timespec="milliseconds")
    except (ValueError, OverflowError, OSError):  # beyond the calendar: its header is damaged
        return ""


def sensed(log: Log) -> list[str]:
    """The least and the greatest of each component of a wrist's sensor, then of each signal; empty without."""
    told = []
    for k, axis in enumerate(FORCE_AXES):
        known = log.rows["force"][:, k][~np.isnan(log.rows["force"][:, k])]
        if known.size:
            unit = "N" if axis.startswith("f") else "N m"
            told.append(f"{axis} {known.min():.4g} to {known.max():.4g} {unit}")
    for k, name in enumerate(log.signal_names):
        values = log.rows["signals"][:, k]
        if values.size:
            told.append(f"{name} {values.min():.4g} to {values.max():.4g}")
    for k, name in enumerate(log.program_signal_names):
        known = log.rows["program_signals"][:, k][~np.isnan(log.rows["program_signals"][:, k])]
        if known.size:
            told.append(f"{name} {known.min():.4g} to {known.max():.4g}")
    return told
