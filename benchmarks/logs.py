"""How fast telemetry becomes a log on disk, against how fast it comes."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.rows import Goal, Row, against
from benchmarks.timing import Effort, interleaved
from qrobot.config import load_robot
from qrobot.log.header import LOCKSTEP, header_for
from qrobot.log.record import write_log
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout

ROWS: Final = 200_000
RATES_HZ: Final = (4000, 10_000)


def telemetry(rows: int, n: int) -> Rows:
    """Rows of an arm that moves smoothly with a little noise: they compress as real ones do."""
    random, out = np.random.default_rng(0), TelemetryLayout(n).empty(rows)
    t = np.arange(rows) / RATES_HZ[0]
    out["tick"], out["t_ns"] = np.arange(rows), np.arange(rows) * (1_000_000_000 // RATES_HZ[0])
    for name in ("q_ref", "v_ref", "a_ref", "q", "v", "tau"):
        out[name] = np.sin(t[:, None] + np.arange(n)) + 1e-4 * random.normal(size=(rows, n))
    out["counts"], out["dac"] = (out["q"] * 1e4).astype(np.int64), 2048 + (out["tau"] * 100).astype(np.int64)
    return out


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    robot, many = load_robot("puma560"), effort.times(ROWS)
    data, header = telemetry(many, robot.n), header_for(robot, 250_000, "qrobot", LOCKSTEP)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.mcap"
        best = interleaved({"log": lambda: write_log(path, data, header)}, effort.rounds)["log"]
    for rate in RATES_HZ:
        goal = Goal(2.0, "ratio", at_least=True)
        yield against("log to disk", many / best, "rows/s", f"a servo at {rate} Hz", rate, goal)
