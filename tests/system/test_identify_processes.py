"""`qrobot identify record --go` against a real servo, board, guardian and bridge."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from qrobot.config import load_robot
from qrobot.config.deployment import load_deployment
from qrobot.ident.observe import steady_passes
from qrobot.log.read import read_log
from qrobot.rig.deployed import ArmProcesses
from qrobot.rig.processes import ProcessRig
from tests.support.processes import left_behind, qrobot, write_deployment

pytestmark = pytest.mark.realtime

POSES, SWEEPS = 12, 18
RECORDING_S = 120.0


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[ArmProcesses]:
    path = write_deployment(tmp_path)
    arm = load_deployment(path).arm[0]
    with ProcessRig(tmp_path / "processes") as rig:
        processes = ArmProcesses(rig, str(path), arm)
        processes.start("board", "servo", "guardian", "bridge")
        yield processes
    assert left_behind(arm.name) == []


def test_the_last_swing_of_a_plan_is_made_by_a_running_arm_and_recorded(
    processes: ArmProcesses, tmp_path: Path
) -> None:
    log, last = tmp_path / "new" / "run.mcap", str(POSES + SWEEPS)
    options = ["--arm", processes.arm.name, "--poses", str(POSES), "--first", last, "--output", str(log), "--go"]
    command = qrobot("identify", "record", processes.deployment, *options)
    _, complaints = command.communicate(timeout=RECORDING_S)
    assert command.returncode == 0, complaints
    recorded = read_log(log)
    assert (recorded.header.robot, recorded.status.lost) == ("puma560", 0)
    flange = load_robot("puma560").n - 1
    rates = [recorded.rows["v_ref"][p.start, flange] for p in steady_passes(recorded.rows, 0.001)]
    fast = [rate for rate in rates if abs(rate) > 2.0]  # 70 % of 228 degrees a second, there and back
    assert len(fast) == 2
    assert fast[0] == pytest.approx(-fast[1], rel=0.01)
