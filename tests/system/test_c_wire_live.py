"""A control task in C, through the wire client in C, against the processes of a whole arm."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from qrobot.modecodes import Mode
from tests.support.c_programs import needs_compiler
from tests.support.patience import wait_until
from tests.support.processes import RunningArm

ROOT = Path(__file__).parents[2]

pytestmark = [pytest.mark.realtime, needs_compiler]


def test_a_task_in_c_swings_a_joint_and_leaves_the_arm_at_rest(arm: RunningArm, tmp_path: Path) -> None:
    program = tmp_path / "swing"
    source = ROOT / "examples/c/swing_one_joint.c"
    subprocess.run(["cc", "-O2", "-I", ROOT / "qrobot/wire/c", "-o", program, source, "-lm"], check=True)
    arm.wait_for_rest()
    bridge = os.environ | {"QROBOT_BRIDGE": f"127.0.0.1:{arm.arm.bridge.port}"}
    done = subprocess.run([program, "puma560"], capture_output=True, text=True, env=bridge, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    found = re.fullmatch(r"joint 6 of puma560 swung by (\d\.\d+) rad\n", done.stdout)
    assert found is not None
    assert float(found[1]) == pytest.approx(0.628, abs=0.02)
    wait_until(lambda: arm.mode is Mode.HOLDING, "the arm holds")
    arm.wait_for_rest()
