"""Time that a program can use, and how long its functions may take: of that time alone."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from qrobot.c_transport import engine
from qrobot.c_transport.engine import Background
from qrobot.c_transport.message import BRIEF, Op
from qrobot.c_transport.usable_time import UsableTime
from qrobot.errors import LinkTimeout

TICKS = os.sysconf("SC_CLK_TCK")
LOOK_S = 0.1


class ToldProcess:
    """What the kernel tells of process 7, in a folder of a test."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def tells(self, used_s: float, *states: str) -> None:
        """The processor time it has had, and the states of its threads."""
        ticks = round(used_s * TICKS)
        user, rest = ticks // 2, " ".join(["0"] * 30)
        for path, state in [("stat", states[0]), *((f"task/{n}/stat", state) for n, state in enumerate(states))]:
            (self.folder / "7" / path).parent.mkdir(parents=True, exist_ok=True)
            (self.folder / "7" / path).write_text(
                f"7 (a) b) {state} 1 2 3 4 5 6 7 8 9 10 {user} {ticks - user} {rest}\n"
            )


@pytest.fixture
def told(tmp_path: Path) -> ToldProcess:
    process = ToldProcess(tmp_path)
    process.tells(3.0, "S", "S")
    return process


@pytest.mark.parametrize(
    ("states", "used_s", "usable_s"),
    [
        ("SS", 0.0, LOOK_S),  # it waits for something
        ("TT", 0.0, LOOK_S),  # it was stopped
        ("SR", 0.02, 0.02),  # it shares a processor
        ("SR", 0.0, 0.0),  # it gets none
        ("RR", 0.2, LOOK_S),  # it has two
    ],
)
def test_what_a_program_waits_for_a_processor_is_not_usable(
    states: str, used_s: float, usable_s: float, told: ToldProcess
) -> None:
    time = UsableTime(7, told.folder)
    told.tells(3.0 + used_s, *states)
    assert time.usable_s(LOOK_S) == pytest.approx(usable_s)


def test_what_was_used_before_does_not_count(told: ToldProcess) -> None:
    time = UsableTime(7, told.folder)
    told.tells(5.0, "R")
    time.begin()
    told.tells(5.04, "R")
    assert time.usable_s(LOOK_S) == pytest.approx(0.04)
    assert time.usable_s(LOOK_S) == pytest.approx(0.0)


def test_of_a_program_that_nobody_knows_all_time_is_usable(told: ToldProcess) -> None:
    assert UsableTime(8, told.folder).usable_s(LOOK_S) == LOOK_S


def test_a_process_of_this_machine_that_sleeps_can_use_all_time() -> None:
    with subprocess.Popen([sys.executable, "-c", "print(flush=True); input()"], stdin=-1, stdout=-1) as process:
        assert process.stdin
        assert process.stdout
        process.stdout.readline()
        time = UsableTime(process.pid)
        while time.usable_s(LOOK_S) < LOOK_S:  # until it has gone to sleep
            pass
        process.communicate(b"\n")


class SharedProcessor(UsableTime):
    """The time of a program that gets a tenth of what passes, and answers after `looks`."""

    def __init__(self, program: socket.socket, looks: int) -> None:
        super().__init__(os.getpid())
        self.left = looks
        self._program = program

    def usable_s(self, passed_s: float) -> float:
        self.left -= 1
        if not self.left:
            self._program.send(bytes(BRIEF))
        return 0.1 * passed_s


@pytest.mark.parametrize(("looks", "late"), [(10, False), (30, True)])
def test_a_function_is_late_by_what_the_program_could_use(
    looks: int, late: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "CALLBACK_S", 0.02)
    monkeypatch.setattr(engine, "_LOOK_S", 0.01)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, theirs:
        background = Background(ours)
        background.time = time = SharedProcessor(theirs, looks)
        if late:
            with pytest.raises(LinkTimeout, match=r"within 0.02 s"):
                background.call(Op.CALL_FUNCTION, 0)
        else:
            background.call(Op.CALL_FUNCTION, 0)
            assert time.left == 0
