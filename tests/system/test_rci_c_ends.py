"""Tasks of RCI in C that lose something: the far end of a device, the last thread of a processor, their program."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from tests.support.c_programs import compiled, compiled_text, needs_compiler
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.puma import PARK

SUPPORT = Path(__file__).parents[1] / "support"
FLAGS = ("-Wall", "-Wextra", "-Werror", "-O1", "-fno-builtin")
Make = Callable[[str], Path]
pytestmark = [needs_compiler, pytest.mark.usefixtures("own_cache"), pytest.mark.realtime]


@pytest.fixture(scope="module")
def make(own_cache: None, tmp_path_factory: pytest.TempPathFactory) -> Make:
    folder = tmp_path_factory.mktemp("ends")
    return lambda name: compiled(SUPPORT / f"{name}.c", folder, *FLAGS)


class LeavableRobot(FakeRobot):
    """A robot that tells when its client has gone, in whatever way, and stops then, as one behind a bridge does."""

    def __init__(self) -> None:
        super().__init__(tuple(PARK), patience=1 << 30)
        self.left = 0

    def forget_client(self) -> None:
        super().forget_client()
        if self.mode is Mode.TRACKING:
            self.halt(FaultCode.STREAM_LOST)
        self.left += 1


@contextmanager
def begun(program: Path, *words: str, robot: FakeRobot) -> Iterator[subprocess.Popen[str]]:
    """A program that finds a robot at its bridge, killed at the end of the block if it lives."""
    with TcpRobot(robot, 0.001) as server:
        where = os.environ | {"QROBOT_BRIDGE": "{}:{}".format(*server.address)}
        with subprocess.Popen([program, *words], stdout=-1, stderr=-1, env=where, text=True) as process:
            try:
                yield process
            finally:
                process.kill()


@pytest.mark.parametrize(
    "words", [["pipe"], ["socket"], ["half"], ["pipe", "asked"], ["socket", "asked"]], ids=" ".join
)
def test_a_device_whose_far_end_is_closed_ends_its_task_when_all_was_read(words: list[str], make: Make) -> None:
    program = make("rci_device_ends")
    done = subprocess.run([program, *words], capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert (done.stdout, done.returncode) == (
        "task device: its device was closed; 2 letters, 0 reads of none\n",
        0,
    )


def test_a_file_is_no_device(make: Make) -> None:
    program = make("rci_device_ends")
    for place in (SUPPORT, Path(__file__)):
        done = subprocess.run([program, "file", place], capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert (done.returncode, "which is always readable" in done.stderr) == (2, True)


@pytest.mark.parametrize("lack", ["thread", "memory"])
@pytest.mark.parametrize("then", [[], ["powerOff"]], ids=["start", "powerOff"])
def test_an_arm_is_stopped_and_let_go_when_nothing_is_left_for_another_thread(
    lack: str, then: list[str], make: Make
) -> None:
    robot = LeavableRobot()
    with begun(make("rci_no_more_threads"), lack, *then, robot=robot) as process:
        said, told = process.communicate(timeout=PATIENCE_S)
        wait_until(lambda: robot.left == 2, "the end of both connections")
    rogue, arm = said.splitlines()
    assert rogue == "task rogue: one of its functions takes longer than 0.05 s and was given up"
    assert arm.startswith("task puma560: its processor has no thread any more: ")
    assert process.returncode == 0, told  # it went on when there was a thread again
    assert robot.goodbyes >= 1  # a reset may overtake the first
    assert robot.mode == (Mode.OFF if then else Mode.HOLDING)


def test_nobody_waits_for_a_bridge_that_takes_no_stop_when_nothing_is_left_for_another_thread(make: Make) -> None:
    """The lock of all tasks is held meanwhile."""
    robot = LeavableRobot()
    with begun(make("rci_no_more_threads"), "thread", "full", robot=robot) as process:
        said, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, told
    assert said.splitlines()[2:] == ["tried to send, waited 0 times"]


@pytest.mark.parametrize("words", [[], ["task"]], ids=["by the program", "by a task"])
def test_a_bridge_misses_a_program_in_c_that_is_killed_though_a_child_of_it_lives(words: list[str], make: Make) -> None:
    robot = LeavableRobot()
    with begun(make("rci_forks"), *words, robot=robot) as process:
        assert process.stdout is not None
        child = os.pidfd_open(int(process.stdout.readline()))
        try:
            process.kill()
            wait_until(lambda: robot.left == 1, "the end of the connection")
            signal.pidfd_send_signal(child, 0)  # it lives
        finally:
            signal.pidfd_send_signal(child, signal.SIGKILL)
            os.close(child)
    assert robot.goodbyes == 0


def test_a_child_that_is_forked_while_a_task_connects_has_no_socket_and_keeps_its_own_stdin(make: Make) -> None:
    robot = LeavableRobot()
    with begun(make("rci_forks_connecting"), robot=robot) as process:
        said, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, told
    children = [line.split(": ") for line in said.splitlines()]
    assert {where for where, _ in children} == {"zeroed", "connects"}
    assert {has for _, has in children} == {"3 streams, 0 sockets"}


def test_processors_take_no_standard_stream_that_was_closed(tmp_path: Path) -> None:
    """What the program prints would wake them, and what it reads would be taken from them."""
    text = """
    #include "rci.h"
    #include <fcntl.h>
    static void rest(RCI_TASK *td) { (void) td; }
    static int over(void) { return rci_runs(rci_descriptor("b")) > 2; }
    int main(void)
    {
        RCI_TASK *a = rci_create("a", "aux"), *b = rci_create("b", "host");
        int fd;
        if (a == 0 || b == 0 || rci_control(b, rest, 0, 0) || rci_onclock(b, 1, 0) || rci_start(b->bit) ||
            rci_wait(over))
            return 1;
        for (fd = 0; fd < 3; fd++)
            if (fcntl(fd, F_GETFD) != -1)
                return 2 + fd;
        return rci_close();
    }
    """
    command = ["sh", "-c", 'exec "$0" <&- >&- 2>&-', compiled_text(text, tmp_path)]
    assert subprocess.run(command, check=False, timeout=PATIENCE_S).returncode == 0
