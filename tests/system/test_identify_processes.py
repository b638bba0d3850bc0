"""`qrobot identify record --go` against a real servo, board, guardian and bridge."""

from __future__ import annotations

from itertools import count
from pathlib import Path

import pytest

from qrobot.config import load_robot
from qrobot.ident.observe import steady_passes
from qrobot.log.read import read_log
from tests.support.patience import PATIENCE_S
from tests.support.processes import RunningArm, qrobot
from tests.support.shared_arm import SharedArm
from tests.support.stall_watch import StreamLostError, unless_stalled

pytestmark = pytest.mark.realtime

POSES, SWEEPS = 12, 18
RECORDING_S = 2.0 * PATIENCE_S


def record_last_swing(arm: RunningArm, log: Path) -> tuple[int, Path]:
    """When it began, and its log. Raises StreamLostError where the servo stopped the arm.

    Its fastest joint goes at 160 degrees a second: what holds its torque for long meanwhile takes it off its path.
    """
    options = ["--arm", arm.name, "--poses", str(POSES), "--first", str(POSES + SWEEPS), "--output", str(log), "--go"]
    begin_ns = arm.now_ns()
    command = qrobot("identify", "record", arm.deployment, *options)
    _, complaints = command.communicate(timeout=RECORDING_S)
    if "the servo stopped the arm" in complaints:
        raise StreamLostError(f"{complaints}; {arm.told_of_the_stop()}")
    assert command.returncode == 0, complaints
    return begin_ns, log


@pytest.mark.thorough
def test_the_last_swing_of_a_plan_is_made_by_a_running_arm_and_recorded(
    arm: RunningArm, shared_arm: SharedArm, tmp_path: Path
) -> None:
    logs = (tmp_path / f"new{run}" / "run.mcap" for run in count())
    begin_ns, log = unless_stalled(lambda: record_last_swing(arm, next(logs)), shared_arm.put_in_order)
    recorded = read_log(log)
    assert (recorded.header.robot, recorded.status.lost) == ("puma560", 0)
    rows = recorded.rows
    assert rows["t_ns"][0] >= begin_ns  # without what the arm did before
    flange = load_robot("puma560").n - 1
    rates = [rows["v_ref"][p.start, flange] for p in steady_passes(rows, 0.001)]
    fast = [rate for rate in rates if abs(rate) > 2.0]  # 70 % of 228 degrees a second, there and back
    assert len(fast) == 2
    assert fast[0] == pytest.approx(-fast[1], rel=0.01)
