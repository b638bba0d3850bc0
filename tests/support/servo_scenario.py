"""One eventful second of a servo on the bench, for comparing two ways to run it.

python -m tests.support.servo_scenario FILE     saves its telemetry
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from qrobot.servo.memory.telemetry import Rows
from tests.support.servo_bench import ServoBench, play, swing

PERIOD_NS = 10_000_000  # short frames, so that much happens in few cycles


def eventful_runs() -> Rows:
    """The eventful run with the paper's estimator and the default interpolation, then with others."""
    return np.concatenate([eventful_run("difference", "quintic"), eventful_run("observer", "b-spline")])


def eventful_run(velocity: str, interpolation: str) -> Rows:
    """Power-up, motion, a lost frame, a torque joint, a glitch, a refused setpoint, an emergency stop, a reset."""
    bench = ServoBench(
        rate_hz=1000.0, law="qrobot+a", velocity=velocity, interpolation=interpolation, guarded=True
    ).hold()

    def edit(seq: int, modes: list[int], values: np.ndarray) -> None:
        if seq > 8:
            modes[5], values[5] = 2, 1.5
        if seq == 20:
            values[0] = np.nan

    play(
        bench,
        swing(bench.q, np.array([0.2, -0.1, 0.2, 0.3, -0.3, 0.0]), 0.8),
        period_ns=PERIOD_NS,
        dropped={12},
        edit=edit,
    )
    bench.tick(60)
    bench.slip = {1: 9000}
    bench.tick(1)
    bench.slip = {}
    bench.tick(220)
    bench.estop_ok = False
    bench.tick(3)
    bench.estop_ok = True
    bench.mailbox.request_clear()
    bench.tick(5)
    return bench.rows()


if __name__ == "__main__":
    np.save(Path(sys.argv[1]), eventful_runs())
