"""Logs for tests: rows with recognisable contents."""

from __future__ import annotations

import numpy as np

from qrobot.log.header import LogHeader
from qrobot.servo.modes import Mode
from qrobot.servo.telemetry import Rows, TelemetryLayout

PERIOD_NS = 250_000
START_NS = 5_000_000_000


def make_header(n: int = 6, period_ns: int = PERIOD_NS) -> LogHeader:
    return LogHeader(robot="sample", joint_names=tuple(f"joint{j + 1}" for j in range(n)), period_ns=period_ns)


def make_rows(n_rows: int, n: int = 6, first: int = 0) -> Rows:
    """Rows `first`.. of a run: every field of every row differs from its neighbours."""
    rows = TelemetryLayout(n).empty(n_rows)
    k = np.arange(first, first + n_rows)
    rows["tick"], rows["t_ns"] = k, START_NS + k * PERIOD_NS
    rows["late_ns"], rows["busy_ns"], rows["mode"] = 1000 + k % 7, 2000 + k % 11, Mode.TRACKING
    for i, name in enumerate(("q_ref", "v_ref", "a_ref", "q", "v", "tau")):
        rows[name] = np.sin(1e-3 * k[:, None] + np.arange(n) + i)
    rows["counts"], rows["dac"] = k[:, None] + np.arange(n), 2048 + np.arange(n)
    return rows
