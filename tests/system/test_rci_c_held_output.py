"""Tasks of RCI in C while nobody reads what the program says on stderr: a held terminal, a full pipe."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.c_programs import compiled, needs_compiler
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.full_pipe import fill
from tests.support.patience import PATIENCE_S
from tests.support.puma import PARK

SOURCE = Path(__file__).parents[1] / "support/rci_held_output.c"
pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache"), pytest.mark.realtime]


@pytest.fixture(scope="module")
def program(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(SOURCE, tmp_path_factory.mktemp("held"), "-Wall", "-Wextra", "-Werror")


@contextmanager
def begun(program: Path, *words: str, held: bool = True) -> Iterator[tuple[subprocess.Popen[bytes], int, FakeRobot]]:
    """A program with an arm, the pipe that is its stderr, and the arm."""
    reading, writing = os.pipe()
    robot = FakeRobot(tuple(PARK), patience=1 << 30)
    if held:
        fill(writing)
    with TcpRobot(robot, 0.001) as server:
        where = os.environ | {"QROBOT_BRIDGE": "{}:{}".format(*server.address)}
        with subprocess.Popen([program, *words], stdin=-1, stdout=-1, stderr=writing, env=where) as process:
            os.close(writing)
            try:
                yield process, reading, robot
            finally:
                process.kill()
                os.close(reading)


def rest_of(pipe: int) -> list[str]:
    """All lines until nobody writes any more."""
    with open(pipe, "rb", closefd=False) as said:
        return said.read().replace(b"\0", b"").decode().splitlines()


@pytest.mark.parametrize("call", ["onclock", "interval", "trigger"])
def test_no_call_that_says_why_it_fails_holds_up_a_task(call: str, program: Path) -> None:
    with begun(program, call) as (process, _, _):
        assert process.communicate(timeout=PATIENCE_S)[0] == b"ran on\n"


def test_what_the_functions_of_a_task_say_holds_up_neither_its_arm_nor_the_end(program: Path) -> None:
    with begun(program, "prints", "300") as (process, _, robot):
        assert process.communicate(b"go on\n", timeout=PATIENCE_S)[0] == b"ran on\n"
        assert process.returncode == 0
        assert robot.goodbyes == 1


def test_lines_of_tasks_come_in_order_and_those_for_which_there_was_no_room_are_counted(program: Path) -> None:
    for runs, held in ((20, False), (300, True)):
        with begun(program, "prints", str(runs), held=held) as (process, pipe, _):
            assert process.stdout is not None
            assert process.stdin is not None
            assert process.stdout.readline() == b"ran on\n"
            process.stdin.write(b"go on\n")
            process.stdin.close()
            lines = rest_of(pipe)
            assert process.wait(PATIENCE_S) == 0
        every = [line for run in range(runs) for line in (f"[puma560] run {run}", NOBODY)]
        lost = [int(line.split()[1]) for line in lines if "lines are missing" in line]
        told = [line for line in lines if "lines are missing" not in line]
        assert told == every[: len(told)]
        assert len(told) + sum(lost) == len(every)
        assert bool(lost) is held


NOBODY = 'rci: rci_descriptor: there is no task "nobody"'
