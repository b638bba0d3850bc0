"""When a rig takes a servo or a board for ready."""

from __future__ import annotations

import errno
import fcntl
import os
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Final, cast

import pytest

from qrobot.config.deployment import load_deployment
from qrobot.errors import LinkBusy, LinkError
from qrobot.hwif.board_memory import create_board_memory
from qrobot.realtime.compile_progress import COMPILING
from qrobot.realtime.shared_memory import HEADER_WORDS, SharedMemory
from qrobot.rig.deployed import require_free_port
from qrobot.rig.process_starter import ProcessStarter, Started
from qrobot.rig.processes import (
    ProcessPlan,
    ProcessRig,
    board_ready,
    guardian_ready,
    servo_ready,
)
from qrobot.servo.memory.servo_memory import PLACE_LAYOUT, create_servo_memory, guardian_place
from tests.support.processes import shared_starter, write_deployment

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


def test_what_another_process_serves_is_not_taken_for_what_was_started(
    dead: int,
) -> None:
    with create_servo_memory(ARM, "puma560", "pd", 6, 1_000_000, 16) as servo:
        servo.front.info.ready = servo.front.guardian.t_ns = 1
        assert servo_ready(ARM, os.getpid())
        assert not servo_ready(ARM, dead)
        assert not guardian_ready(ARM, 0, os.getpid())
        with SharedMemory.create(guardian_place(ARM), PLACE_LAYOUT, HEADER_WORDS):
            assert guardian_ready(ARM, 0, os.getpid())
            assert not guardian_ready(ARM, 0, dead)
    with create_board_memory(ARM) as board:
        board.memory.facts.period_ns, board.memory.shown.sequence = 250_000, 2
        assert board_ready(ARM, os.getpid())
        assert not board_ready(ARM, dead)


def test_what_another_rig_has_begun_is_not_begun_beside_it_and_keeps_its_output(tmp_path: Path) -> None:
    plan = ProcessPlan("board", ["board", "--help"])
    with ProcessRig(tmp_path, shared_starter()) as first, ProcessRig(tmp_path, shared_starter()) as second:
        first.start(plan)
        first.children["board"].output.write_text("its words")
        with pytest.raises(LinkBusy, match="board is not started: another process starts it"):
            second.start(plan)
        assert second.children == {}
        assert "its words" in first.children["board"].output.read_text()
    with ProcessRig(tmp_path, shared_starter()) as third:
        third.start(plan)


class Lives:
    """A process that runs until it is ended, and one that starts nothing else."""

    pid = os.getpid()

    def __init__(self) -> None:
        self.status: int | None = None

    def prepare(self) -> None:
        pass

    def start(self, *_: object) -> Started:
        return cast("Started", self)

    def poll(self) -> int | None:
        return self.status

    def send_signal(self, _number: int) -> None:
        self.status = 0

    def wait(self, _patience_s: float) -> None:
        pass


@pytest.mark.realtime
def test_who_waits_for_a_process_hears_what_that_compiles_each_line_once(tmp_path: Path) -> None:
    """What it compiled before its turn is over, and what it says later is its own matter."""
    output, told = tmp_path / "board.txt", list[str]()
    waiting, first, second = (f"{COMPILING} {number} of 40, once: a" for number in (40, 1, 5))
    prints = iter(["", f"hello\n{first}\n", f"{first}\n", f"{first}\nqrobot: {second}\n", "on its way\n"])

    def ready(pid: int) -> bool:
        if pid == 0:
            return False
        text = next(prints, None)
        output.write_text(f"qrobot: {waiting}\n{text or ''}")
        return text is None

    class Compiles(Lives):
        def start(self, *_: object) -> Started:
            output.write_text(f"qrobot: {waiting}\n")
            return super().start()

    with ProcessRig(tmp_path, cast("ProcessStarter", Compiles()), told.append) as rig:
        rig.start(ProcessPlan("board", ["board"], ready))
    assert told == [f"board: {first}", f"board: {second}", "board is ready"]


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("status", "said", "told"),
    [
        (1, "", "it said nothing"),
        (-9, "OFF -> TRACKING\n", "it was killed by SIGKILL$"),
        (-6, "Fatal Python error\n", "it was killed by SIGABRT; Fatal Python error"),
        (-6, "", "it was killed by SIGABRT$"),
    ],
)
def test_a_process_that_died_as_it_compiled_has_not_complained_of_that(
    tmp_path: Path, status: int, said: str, told: str
) -> None:
    class Dies(Lives):
        def start(self, *_: object) -> Started:
            (tmp_path / "board.txt").write_text(f"{said}qrobot: {COMPILING} 4 of 40, once: a\n")
            self.status = status
            return super().start()

    with ProcessRig(tmp_path, cast("ProcessStarter", Dies())) as rig, pytest.raises(LinkError, match=told):
        rig.start(ProcessPlan("board", ["board"], lambda _pid: False))


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP])
def test_where_the_folder_of_the_output_knows_no_locks_processes_start_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def no_locks(_file: object, _operation: int) -> None:
        raise OSError(number, os.strerror(number))

    with ProcessRig(tmp_path, shared_starter()) as rig:
        monkeypatch.setattr(fcntl, "flock", no_locks)
        rig.start(ProcessPlan("board", ["board", "--help"]))
        monkeypatch.undo()
        assert rig.children["board"].process.pid


def test_what_a_killed_board_has_left_does_not_make_the_next_one_ready(dead: int) -> None:
    assert not board_ready(ARM)
    with create_board_memory(ARM) as board:
        assert not board_ready(ARM)
        board.memory.facts.period_ns, board.memory.shown.sequence = 250_000, 2
        assert board_ready(ARM)
        board.header.owner_pid = dead
        assert not board_ready(ARM)


@pytest.mark.parametrize(("runs", "advice"), [(True, "runs already"), (False, "Choose another port for")])
def test_a_port_that_is_taken_is_told_of_with_who_has_taken_it(tmp_path: Path, runs: bool, advice: str) -> None:
    (arm,) = load_deployment(write_deployment(tmp_path)).arm
    with socket.create_server((arm.bridge.host, arm.bridge.port)), ExitStack() as stack:
        if runs:
            servo = stack.enter_context(create_servo_memory(arm.name, "puma560", "pd", 6, 1_000_000, 16))
            servo.front.info.ready = 1
        with pytest.raises(LinkBusy, match=f"{arm.bridge.port} is in use.*{advice}"):
            require_free_port(arm)
