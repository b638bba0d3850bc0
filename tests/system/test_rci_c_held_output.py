"""Tasks of RCI in C while nobody reads what the program says on stderr: a held terminal, a full pipe."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

import pytest

from tests.support.c_programs import compiled, compiled_text, needs_compiler, ran
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.full_pipe import fill
from tests.support.patience import PATIENCE_S, wait_until
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


def lines_of(said: BinaryIO, count: int) -> tuple[list[str], int]:
    """The next lines, and how many are said to be missing, until both together are so many."""
    lines: list[str] = []
    lost = 0
    while len(lines) + lost < count:
        line = said.readline().replace(b"\0", b"").decode()
        assert line, "the end of the program"
        missing = MISSING.fullmatch(line)
        lost += int(missing[1]) if missing else 0
        lines += [] if missing else [line.rstrip("\n")]
    return lines, lost


@pytest.mark.parametrize("call", ["onclock", "interval", "trigger"])
def test_no_call_that_says_why_it_fails_holds_up_a_task(call: str, program: Path) -> None:
    with begun(program, call) as (process, _, _):
        assert process.communicate(timeout=PATIENCE_S)[0] == b"ran on\n"


def test_what_the_functions_of_a_task_say_holds_up_neither_its_arm_nor_the_end(program: Path) -> None:
    with begun(program, "prints", "300") as (process, _, robot):
        assert process.communicate(b"go on\n", timeout=PATIENCE_S)[0] == b"ran on\n"
        assert process.returncode == 0
        wait_until(lambda: robot.goodbyes == 1, "the end of the connection")


def test_lines_of_tasks_come_in_order_and_those_for_which_there_was_no_room_are_counted(program: Path) -> None:
    for runs, held in ((20, False), (300, True)):
        every = [line for run in range(runs) for line in (f"[puma560] run {run}", NOBODY)]
        with (
            begun(program, "prints", str(runs), held=held) as (process, pipe, _),
            open(pipe, "rb", 0, closefd=False) as said,
        ):
            assert process.stdout is not None
            assert process.stdin is not None
            assert process.stdout.readline() == b"ran on\n"
            told, lost = lines_of(said, len(every))
            process.stdin.write(b"go on\n")
            process.stdin.close()
            assert said.read() == b""
            assert process.wait(PATIENCE_S) == 0
        assert told == every[: len(told)]
        assert len(told) + lost == len(every)
        assert (lost > 0) is held


def test_a_terminal_that_is_held_at_the_count_of_missing_lines_holds_up_no_end(program: Path) -> None:
    with begun(program, "prints", "300", "note") as (process, pipe, _), open(pipe, "rb", 0, closefd=False) as said:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ran on\n"
        assert lines_of(said, LINES)[1] == 0
        process.communicate(b"go on\n", timeout=PATIENCE_S)
        assert process.returncode == 0


def test_what_tasks_of_a_program_at_real_time_say_is_written_by_an_ordinary_thread(tmp_path: Path) -> None:
    status, said, _ = ran(compiled_text(AT_REAL_TIME, tmp_path))
    if status == REFUSED:
        pytest.skip("SCHED_FIFO is not allowed here")
    assert (status, said) == (0, "[parent] here\n1 of 4 threads is ordinary\n")


LINES = 256  # that wait, docs/how-to/write-an-rci-task-in-c.md
NOBODY = 'rci: rci_descriptor: there is no task "nobody"'
MISSING = re.compile(r"rci: (\d+) lines are missing here: stderr took none\n")
REFUSED = 77
AT_REAL_TIME = """
#include "rci.h"
#include <dirent.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>
static RCI_TASK *td;
static void rest(RCI_TASK *td) { (void) td; }
static int over(void) { return rci_runs(td) > 2; }
int main(void)
{
    const struct sched_param lowest = {1};
    char line[64];
    int ends[2], threads = 0, ordinary = 0;
    struct dirent *each;
    DIR *all;
    if (sched_setscheduler(0, SCHED_FIFO, &lowest))
        return 77;
    if (pipe(ends) || dup2(ends[1], 2) != 2)
        return 1;
    if ((td = rci_create("watch", "aux")) == 0 || rci_control(td, rest, 0, 0) || rci_onclock(td, 1, 0) ||
        rci_start(td->bit) || rci_wait(over))
        return 2;
    rci_print("here");
    if (read(ends[0], line, sizeof line) != 14 || (all = opendir("/proc/self/task")) == 0) /* the thread has begun */
        return 3;
    while ((each = readdir(all)) != 0)
        if (atoi(each->d_name) > 0) {
            threads++;
            ordinary += sched_getscheduler(atoi(each->d_name)) == SCHED_OTHER;
        }
    printf("%.14s%d of %d threads is ordinary\\n", line, ordinary, threads);
    return closedir(all) || rci_close();
}
"""
