"""When a rig takes a servo or a board for ready."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Final

import pytest

from qrobot.hwif.board_memory import create_board_memory
from qrobot.rig.processes import board_ready, guardian_ready, servo_ready
from qrobot.servo.memory.servo_memory import create_servo_memory

ARM: Final = f"ready{os.getpid()}"


@pytest.fixture(scope="module")
def dead() -> int:
    """Id of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_what_a_killed_servo_has_left_does_not_make_the_next_one_ready(dead: int) -> None:
    """The next one owns the memory before it has cleared it and put its own number there."""
    assert not servo_ready(ARM)
    with create_servo_memory(ARM, "puma560", "pd", 6, 1_000_000, 16) as servo:
        assert not servo_ready(ARM)
        servo.front.info.ready = servo.front.guardian.t_ns = 1
        assert servo_ready(ARM)
        assert guardian_ready(ARM, 0)
        servo.header.owner_pid = dead
        assert not servo_ready(ARM)
        assert not guardian_ready(ARM, 0)


def test_what_a_killed_board_has_left_does_not_make_the_next_one_ready(dead: int) -> None:
    assert not board_ready(ARM)
    with create_board_memory(ARM) as board:
        assert not board_ready(ARM)
        board.memory.facts.period_ns, board.memory.shown.sequence = 250_000, 2
        assert board_ready(ARM)
        board.header.owner_pid = dead
        assert not board_ready(ARM)
