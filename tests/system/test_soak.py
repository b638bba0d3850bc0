"""A short soak: random moves in lock-step at 4 kHz, and nothing of what an hour must not show."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.soak import FRAME_NS, MEMORY_BOUND, CountedLog, RandomMoves, Soak, soak
from qrobot.config import load_robot
from qrobot.errors import QRobotError
from qrobot.servo.memory.telemetry import TelemetryLayout

ROBOT = load_robot("puma560")


@pytest.mark.thorough
def test_twenty_seconds_of_random_moves_leave_no_fault_no_gap_and_no_error_above_its_bound(tmp_path: Path) -> None:
    report = tmp_path / "out" / "soak.json"
    # A process of its own: what other tests have left behind in this one would count as growth, or hide it.
    command = [sys.executable, "-m", "benchmarks", "soak", "--hours", f"{20 / 3600}", "--seed", "3", "--rigid"]
    process = subprocess.run([*command, "--json", str(report)], cwd=Path(__file__).parents[2], check=False, timeout=500)
    found = json.loads(report.read_text())
    assert (process.returncode, found["failures"]) == (0, [])
    assert found["cycles"] == found["logged"] > 80_000
    assert found["moves"] >= 4
    assert min(found["largest_error"]) > 1e-5  # every joint has moved


def test_nothing_is_left_in_its_folder(tmp_path: Path) -> None:
    result = soak(1.0 / 3600.0, physics="rigid", folder=tmp_path)
    assert result.cycles == result.logged
    assert list(tmp_path.iterdir()) == []


def test_each_failure_is_named() -> None:
    good = Soak(cycles=10, logged=10, largest_error=(0.001,))
    assert good.failures == []
    for change, named in (
        ({"logged": 9}, "1 of 10 cycles"),
        ({"fault": "FOLLOWING"}, "FOLLOWING"),
        ({"largest_error": (0.02,)}, "tracking error"),
        ({"largest_error": (float("nan"),)}, "tracking error"),
        ({"growth": MEMORY_BOUND + 1}, "memory"),
    ):
        assert named in replace(good, **change).failures[0]  # type: ignore[arg-type]


def test_a_gap_in_the_log_is_found(tmp_path: Path) -> None:
    rows = TelemetryLayout(ROBOT.n).empty(8)
    rows["tick"] = [1, 2, 3, 4, 6, 7, 8, 9]
    log = CountedLog(tmp_path, ROBOT, 250_000)
    log.append(rows, flush=True)
    with pytest.raises(QRobotError, match="after cycle 0"):
        log.close()


def test_random_moves_repeat_with_their_seed_and_stay_inside_the_range() -> None:
    def path(seed: int) -> list[list[float]]:
        moves = RandomMoves(ROBOT, seed, ROBOT.poses["ready"])
        return [moves.next_frame().tolist() for _ in range(300)]

    first = np.array(path(1))
    assert first.tolist() == path(1) != path(2)
    assert (first > ROBOT.limits.q_min).all()
    assert (first < ROBOT.limits.q_max).all()
    assert np.abs(np.diff(first, axis=0)).max() < 1.1 * FRAME_NS * 1e-9
