"""A C program started by itself, in real time over the bridge."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from qrobot.servo.modes import Mode
from tests.support.c_programs import EXAMPLES, compiled, needs_compiler
from tests.support.processes import RunningArm, running_arms, wait_until
from tests.support.puma import PARK

pytestmark = [pytest.mark.realtime, needs_compiler]


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningArm]:
    with running_arms(tmp_path_factory.mktemp("c-live"), period_ms=28.0) as (running,):
        yield running


def under_way(program: Path, running: RunningArm) -> subprocess.Popen[str]:
    """The program, when it has left the park pose."""
    environment = os.environ | {"QROBOT_BRIDGE": f"{running.arm.bridge.host}:{running.arm.bridge.port}"}
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    process = subprocess.Popen([program], env=environment, text=True, **pipes)
    for far in (False, True):
        wait_until(lambda far=far: process.poll() is not None or _away(running, far), "the arm leaves the park pose")
    assert process.poll() is None, process.communicate()[1]
    return process


def _away(running: RunningArm, far: bool) -> bool:
    seen = running.snapshot()
    off = np.abs(np.asarray(seen.q) - PARK).max()
    return seen.mode == Mode.TRACKING and bool(off > 0.1 if far else off < 0.02)


def test_the_arm_stops_when_return_is_hit_and_when_the_program_is_interrupted_s04(
    running: RunningArm, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    program = compiled(EXAMPLES / "c" / "s04_stop_on_keyboard.c", tmp_path, "-O2")
    with under_way(program, running) as process:
        said, complaint = process.communicate("\n")
    assert (process.returncode, complaint) == (0, "")
    assert "was in P" not in said
    assert "LOC is now" in said
    running.wait_for(Mode.HOLDING)
    with under_way(program, running) as process:
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate()
    assert process.returncode == 130
    assert complaint == "\ns04_stop_on_keyboard: interrupted; the arm is brought to rest\n"
    assert running.mode is Mode.HOLDING
    assert np.abs(np.asarray(running.snapshot().v)).max() < 0.02
