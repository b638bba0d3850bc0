"""A C program started by itself, in real time over the bridge."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from qrobot.modecodes import Mode
from qrobot.servo.memory.telemetry import Rows
from tests.support.c_programs import EXAMPLES, compiled, needs_compiler
from tests.support.patience import wait_until
from tests.support.processes import RunningArm
from tests.support.puma import PARK

pytestmark = [pytest.mark.realtime, needs_compiler, pytest.mark.usefixtures("own_cache")]


def under_way(program: Path, arm: RunningArm) -> subprocess.Popen[str]:
    """The program, when it has left the park pose."""
    environment = os.environ | {"QROBOT_BRIDGE": f"{arm.arm.bridge.host}:{arm.arm.bridge.port}"}
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    with arm.new_cycles() as cycles:
        process = subprocess.Popen([program], env=environment, text=True, **pipes)
        departure = Departure(cycles)
        wait_until(lambda: process.poll() is not None or departure.seen(), "the arm leaves the park pose")
    assert process.poll() is None, process.communicate()[1]
    return process


class Departure:
    """Looks whether a program has brought the arm to the park pose, and away from there, in these cycles."""

    def __init__(self, cycles: Callable[[], Rows]) -> None:
        self._cycles, self._was_there = cycles, False

    def seen(self) -> bool:
        rows = self._cycles()
        for off in np.abs(rows["q"][rows["mode"] == Mode.TRACKING] - PARK).max(axis=1, initial=0.0):
            self._was_there = self._was_there or off < 0.02
            if self._was_there and off > 0.05:
                return True
        return False


def test_the_arm_stops_when_return_is_hit_and_when_the_program_is_interrupted_s04(
    arm: RunningArm, tmp_path: Path
) -> None:
    program = compiled(EXAMPLES / "c" / "s04_stop_on_keyboard.c", tmp_path, "-O2")
    with under_way(program, arm) as process:
        said, complaint = process.communicate("\n")
    assert (process.returncode, complaint) == (0, "")
    assert "was in P" not in said
    assert "LOC is now" in said
    arm.wait_for(Mode.HOLDING)
    with under_way(program, arm) as process:
        process.send_signal(signal.SIGINT)
        _, complaint = process.communicate()
    assert process.returncode == 130
    assert complaint == "\ns04_stop_on_keyboard: interrupted; the arm is brought to rest\n"
    assert arm.mode is Mode.HOLDING
    arm.wait_for_rest()
