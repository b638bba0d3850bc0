"""`qrobot identify record --go` against a real servo, board, guardian and bridge."""

from __future__ import annotations

from pathlib import Path

import pytest

from qrobot.config import load_robot
from qrobot.ident.observe import steady_passes
from qrobot.log.read import read_log
from tests.support.patience import PATIENCE_S
from tests.support.processes import RunningArm, qrobot

pytestmark = pytest.mark.realtime

POSES, SWEEPS = 12, 18
RECORDING_S = 2.0 * PATIENCE_S


def test_the_last_swing_of_a_plan_is_made_by_a_running_arm_and_recorded(arm: RunningArm, tmp_path: Path) -> None:
    log, last = tmp_path / "new" / "run.mcap", str(POSES + SWEEPS)
    options = ["--arm", arm.name, "--poses", str(POSES), "--first", last, "--output", str(log), "--go"]
    begin_ns = arm.now_ns()
    command = qrobot("identify", "record", arm.deployment, *options)
    _, complaints = command.communicate(timeout=RECORDING_S)
    assert command.returncode == 0, complaints
    recorded = read_log(log)
    assert (recorded.header.robot, recorded.status.lost) == ("puma560", 0)
    rows = recorded.rows
    assert rows["t_ns"][0] >= begin_ns  # without what the arm did before
    flange = load_robot("puma560").n - 1
    rates = [rows["v_ref"][p.start, flange] for p in steady_passes(rows, 0.001)]
    fast = [rate for rate in rates if abs(rate) > 2.0]  # 70 % of 228 degrees a second, there and back
    assert len(fast) == 2
    assert fast[0] == pytest.approx(-fast[1], rel=0.01)
