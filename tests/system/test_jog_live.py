"""`qrobot jog` at a terminal of its own, against processes in real time: the arm moves while a key is held."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from qrobot.modecodes import Mode
from tests.support.patience import PATIENCE_S, give_time, wait_until
from tests.support.processes import RunningArm

pytestmark = pytest.mark.realtime

REPEAT_S = 0.03  # of a terminal
FAR_RAD = 0.03


class Terminal:
    """A terminal with `qrobot jog` in it."""

    def __init__(self, arm: RunningArm) -> None:
        self.keys, far = pty.openpty()
        command = [sys.executable, "-m", "qrobot", "jog", "--deployment", str(arm.deployment), "--arm", arm.name]
        self.process = subprocess.Popen(command, stdin=far, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        os.close(far)

    def type(self, key: str) -> bool:
        """Press a key, and wait for as long as a terminal does until it repeats it. Always true."""
        os.write(self.keys, key.encode())
        give_time(REPEAT_S)
        return True

    def end(self) -> str:
        """Quit; what was said."""
        os.write(self.keys, b"q")
        said = "".join(self.process.communicate(timeout=PATIENCE_S))
        os.close(self.keys)
        return said


@pytest.fixture
def terminal(arm: RunningArm) -> Iterator[Terminal]:
    arm.wait_for_rest()
    terminal = Terminal(arm)
    yield terminal
    terminal.process.kill()


def test_a_joint_moves_while_its_key_is_held_and_is_at_rest_once_it_is_let_go(
    arm: RunningArm, terminal: Terminal
) -> None:
    arm.wait_for(Mode.TRACKING)  # it is in command
    began = arm.snapshot().q
    terminal.type("1")
    give_time(0.5)  # let go, so that the next key is no other one while this is held
    wait_until(lambda: terminal.type(",") and abs(arm.snapshot().q[0] - began[0]) > FAR_RAD, "the waist turns")
    arm.wait_for_rest()
    there = arm.snapshot().q
    assert np.abs((there - began)[1:3]).max() < FAR_RAD / 3
    said = terminal.end()
    assert arm.mode is Mode.HOLDING
    assert "joint 1 (waist)" in said
    assert terminal.process.returncode == 0 or "HOLD_TO_RUN" in said  # by a machine that stalled
