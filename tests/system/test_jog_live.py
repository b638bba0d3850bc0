"""`qrobot jog` at a terminal of its own, against processes in real time: the arm moves while a key is held."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from qrobot.modecodes import Mode
from tests.support.patience import PATIENCE_S, give_time, wait_until
from tests.support.processes import RunningArm

pytestmark = pytest.mark.realtime

REPEAT_S = 0.03  # of a terminal
HELD_S, RELEASED_S = 1.5, 0.5  # a key that was let go, or seemed so to a machine that stalled, has to be released
FAR_RAD = 0.03


class Terminal:
    """A terminal with `qrobot jog` in it."""

    def __init__(self, arm: RunningArm) -> None:
        self._arm = arm
        self.begin()

    def begin(self) -> None:
        """Start the command, and wait until it has the arm."""
        self._arm.wait_for_rest()
        self.keys, far = pty.openpty()
        command = [sys.executable, "-m", "qrobot", "jog", "--deployment", str(self._arm.deployment)]
        self.process = subprocess.Popen(
            [*command, "--arm", self._arm.name], stdin=far, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        os.close(far)
        self._arm.wait_for(Mode.TRACKING)

    def type(self, key: str) -> None:
        """Press a key, and wait for as long as a terminal does until it repeats it."""
        os.write(self.keys, key.encode())
        give_time(REPEAT_S)

    def hold(self, key: str, until: Callable[[], bool]) -> bool:
        """Hold a key until something is so or `HELD_S` are over, then release it; whether it is so.

        On a machine that stalls the servo takes the key for released, and the command ends: then it is started again.
        """
        deadline = time.monotonic() + HELD_S
        while not until() and time.monotonic() < deadline:
            self.type(key)
        is_so = until()
        give_time(RELEASED_S)
        if not is_so and self.process.poll() is not None:
            assert "HOLD_TO_RUN" in self.end()
            self.begin()
        return is_so

    def end(self) -> str:
        """Quit; what was said."""
        os.write(self.keys, b"q")
        said = "".join(self.process.communicate(timeout=PATIENCE_S))
        os.close(self.keys)
        return said


@pytest.fixture
def terminal(arm: RunningArm) -> Iterator[Terminal]:
    terminal = Terminal(arm)
    yield terminal
    terminal.process.kill()


def test_a_joint_moves_while_its_key_is_held_and_is_at_rest_once_it_is_let_go(
    arm: RunningArm, terminal: Terminal
) -> None:
    began = arm.snapshot().q
    terminal.type("1")
    give_time(0.5)  # let go, so that the next key is no other one while this is held
    wait_until(lambda: terminal.hold(",", lambda: abs(arm.snapshot().q[0] - began[0]) > FAR_RAD), "the waist turns")
    arm.wait_for_rest()
    there = arm.snapshot().q
    assert np.abs((there - began)[1:3]).max() < FAR_RAD / 3
    said = terminal.end()
    assert arm.mode is Mode.HOLDING
    assert "joint 1 (waist)" in said
    assert terminal.process.returncode == 0 or "HOLD_TO_RUN" in said  # by a machine that stalled
