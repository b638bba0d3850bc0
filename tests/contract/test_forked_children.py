"""Children that a program in Python forks have no part in its arms: they keep none, and let go of none."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from qrobot.rci.forked_child import NO_PART
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.puma import PARK

pytestmark = pytest.mark.realtime
ROOT = Path(__file__).parents[2]
PATIENCE = 1_000_000  # periods without a command: what is tested is not this machine's speed
AWAY = PARK + np.radians([60.0, 0.0, 0.0, 0.0, 0.0, 0.0])

IN_RCCL = """
import sys
import numpy as np
from qrobot import rccl
arm = rccl.control(processor=sys.argv[1])
goal = arm.jposition("AWAY", np.degrees(arm.how.q) + [60, 0, 0, 0, 0, 0])
arm.setime(100, {ms})
arm.move(goal)
start = arm.how.q[0]
arm.waitas(lambda: arm.how.q[0] > start + 1e-3)
move = lambda: arm.move(goal)
wait = lambda: arm.waitfor(arm.completed)
"""
IN_ARCL = """
from qrobot.arcl import *
rp = arcl_open(ARCL_PERIOD, 4.0, 0)
goal = rp.joints
goal[0] += 60.0
start = rp.joints[0]
away = joint_pos(rp, "AWAY", goal)
move(rp, away, MOV_TIME, {ms}, 0)
arcl_wait(rp, lambda: rp.joints[0] > start + 0.1)
wait = lambda: arcl_wait(rp)
move = lambda move=move: move(rp, away, 0)
"""
ENDING_CHILD = """
import os
from qrobot.errors import LinkError
if not (child := os.fork()):
    try:
        move()
    except LinkError as error:
        print(error, flush=True)
    raise SystemExit(0)
print(os.waitpid(child, 0)[1], flush=True)
wait()
"""
LASTING_CHILD = """
import ctypes, os, time
if not (child := ctypes.PyDLL(None).fork()):  # Python does not hear of it
    time.sleep(900)
    os._exit(0)
print(child, flush=True)
wait()
"""
TASKS = """
import sys
from qrobot import rci
from tests.support import rci_auxiliary as functions
td = rci.rci_create("counter", "aux")
memory = rci.rci_shared_memory("counts", 8 * 32).view("i8")
rci.rci_control(td, functions.count, None, functions.startup)
rci.rci_onclock(td, 1)
rci.rci_start(td.bit)
print(memory[0], flush=True)
before = td.runs
move = rci.rci_ticks
wait = lambda: rci.rci_wait(lambda: td.runs > before + 50)
"""


@contextmanager
def begun(program: str, *words: str, robot: FakeRobot | None = None) -> Iterator[subprocess.Popen[str]]:
    """A program, killed at the end of the block if it lives, that finds a robot at its bridge."""
    with TcpRobot(robot or FakeRobot(tuple(PARK)), 0.001) as server:
        where = os.environ | {"QROBOT_BRIDGE": "{}:{}".format(*server.address)}
        command = [sys.executable, "-c", program, *words]
        with subprocess.Popen(command, cwd=ROOT, env=where, stdout=subprocess.PIPE, text=True) as process:
            try:
                yield process
            finally:
                process.kill()


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("program", "words"), [(IN_RCCL, ["host"]), (IN_RCCL, ["aux"]), (IN_ARCL, [])], ids=["rccl", "rccl aux", "arcl"]
)
def test_a_child_that_ends_takes_no_arm_from_its_program(program: str, words: list[str]) -> None:
    robot = FakeRobot(tuple(PARK), period_us=4_000, patience=PATIENCE)
    with begun(program.format(ms=2000) + ENDING_CHILD, *words, robot=robot) as process:
        said, _ = process.communicate(timeout=PATIENCE_S)
    assert said.splitlines() == [NO_PART, "0"]
    assert process.returncode == 0
    assert np.allclose(robot.q, AWAY, rtol=0, atol=1e-6)
    assert robot.goodbyes == 1


def test_a_child_that_ends_takes_no_task_from_its_program() -> None:
    """`multiprocessing` would end the processors of the program with it."""
    child = ENDING_CHILD.replace("LinkError as error", "Exception as error")
    with begun(TASKS + child) as process:
        said, _ = process.communicate(timeout=PATIENCE_S)
    assert said.splitlines()[1:] == ["there are no tasks: call rci_create() first", "0"]
    assert process.returncode == 0


def alive(pid: int) -> bool:
    with suppress(ProcessLookupError):
        os.kill(pid, 0)
        return True
    return False


def test_an_arm_whose_program_is_killed_comes_to_rest_though_a_child_of_it_lives() -> None:
    robot = FakeRobot(tuple(PARK), period_us=4_000, patience=PATIENCE)
    with begun(IN_RCCL.format(ms=20_000) + LASTING_CHILD, "aux", robot=robot) as process:
        child = int(process.stdout.readline())
        try:
            process.kill()
            wait_until(lambda: robot.goodbyes == 1, "the goodbye of the generator")
            assert alive(child)
        finally:
            os.kill(child, signal.SIGKILL)
    assert robot.q[0] < AWAY[0] - 0.01


def test_a_processor_ends_with_its_program_though_a_child_of_that_lives() -> None:
    with begun(TASKS + LASTING_CHILD) as process:
        processor, child = int(process.stdout.readline()), int(process.stdout.readline())
        try:
            process.kill()
            wait_until(lambda: not alive(processor), "the end of the processor")
            assert alive(child)
        finally:
            os.kill(child, signal.SIGKILL)
