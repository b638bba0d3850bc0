"""Processors of RCI that are processes of their own: what they share, and what happens when one dies."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from qrobot import rci
from qrobot.errors import ConfigError, LinkBusy, LinkLost, RogueTask
from qrobot.modecodes import Mode
from qrobot.rci import TaskDescriptor, TaskState
from qrobot.rci.processor_names import claim_processor
from qrobot.rci.thread_driver import PRIORITY
from qrobot.realtime.process_stat import STATE, stat_fields
from qrobot.realtime.setup import set_fifo
from tests.support import rci_auxiliary as functions
from tests.support.patience import wait_until
from tests.support.processes import RunningArm

pytestmark = pytest.mark.realtime
ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def program() -> Iterator[None]:
    """A program in real time, of which nothing is left behind."""
    rci.rci_clock(1000)
    yield
    rci.rci_close()


def task(name: str, proc: str | None, control, interval: int = 5, startup=None) -> TaskDescriptor:
    td = rci.rci_create(name, proc)
    rci.rci_control(td, control, None, startup)
    rci.rci_onclock(td, interval)
    return td


def counts() -> np.ndarray:
    """Word 0 is the process of the counting task."""
    return rci.rci_shared_memory("counts", 8 * 32).view(np.int64)


def alive(pid: int) -> bool:
    try:
        return stat_fields(Path(f"/proc/{pid}"))[STATE] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # it was taken note of before the file was opened, or read
        return False


def test_tasks_on_two_processors_share_clock_memory_data_messages_and_signals(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(functions, "TABLE", functions.TABLE)
    here, there = (
        task("here", None, functions.count, 10),
        task("counter", "aux", functions.count, 10, functions.startup),
    )
    replies = task("replies", "aux", functions.answer)
    late = task("late", "aux", functions.count, 10, functions.fail_to_start)
    memory, table = counts(), rci.rci_shared_data(replies.bit, functions, "TABLE")
    mask = here.bit | there.bit | replies.bit
    interrupts: list[int] = []
    before = signal.signal(signal.SIGUSR1, lambda number, _: interrupts.append(number))
    try:
        begun = rci.rci_ticks()
        rci.rci_start(mask)
        assert memory[0] not in (0, os.getpid())
        rci.rci_wait(lambda: there.runs)
        asked = rci.rci_ticks()
        assert rci.rci_send(replies.bit, b"how far") == 7
        heard: list[tuple[bytes, TaskDescriptor | None]] = []
        rci.rci_wait(
            lambda: (
                (heard.append(rci.rci_receive()) if not heard or heard[-1][1] is None else 0)
                or (heard[-1][1] and interrupts and min(here.runs, there.runs) > 20)
            )
        )
    finally:
        signal.signal(signal.SIGUSR1, before)
    (answer, sender), now = heard[-1], rci.rci_ticks()
    said, _, tick = answer.rpartition(b" ")
    assert (said, sender) == (b"HOW FAR True", replies)
    assert asked <= int(tick) <= now  # read by the other process
    assert table.tolist() == [0.0, 2.0, 2.0, 3.0]
    rci.rci_release(mask)
    due = (rci.rci_ticks() - begun) // 10 + 1
    assert memory[here.bit.bit_length()] == here.runs
    assert memory[there.bit.bit_length()] == there.runs
    assert max(here.runs, there.runs) <= due
    rci.rci_onclock(there, 1)
    rci.rci_control(there, functions.fail)
    rci.rci_start(there.bit)
    with pytest.raises(ConfigError, match="no task 'nobody'"):
        rci.rci_wait(lambda: False)
    assert (there.state, replies.state) == (TaskState.ENDED, TaskState.RELEASED)
    with pytest.raises(LookupError, match="no sensor"):
        rci.rci_start(late.bit)
    assert not late.active


def test_each_end_of_a_task_that_is_started_again_is_told() -> None:
    late, bad = task("late", "aux", functions.count, 5, functions.fail_to_start), task("bad", "aux", functions.fail)
    for _ in range(3):
        with pytest.raises(LookupError, match="no sensor"):
            rci.rci_start(late.bit)
        rci.rci_start(bad.bit)
        with pytest.raises(ConfigError, match="no task 'nobody'"):
            rci.rci_wait(lambda: False)
        wait_until(lambda: bad.state is TaskState.ENDED, "the end of the task")


def test_a_processor_that_is_killed_is_told_and_other_processors_go_on() -> None:
    here, there = task("here", None, functions.count), task("there", "aux", functions.count, 5, functions.startup)
    memory = counts()
    rci.rci_start(here.bit | there.bit)
    rci.rci_wait(lambda: there.runs > 3)
    os.kill(int(memory[0]), signal.SIGKILL)
    with pytest.raises(LinkLost, match="processor aux has died: exit status -9"):
        rci.rci_wait(lambda: False)
    assert (there.state, here.state) == (TaskState.ENDED, TaskState.ACTIVE)
    runs = here.runs
    rci.rci_wait(lambda: here.runs > runs + 5)
    with pytest.raises(LinkLost, match="create the tasks anew"):
        rci.rci_start(there.bit)
    rci.rci_close()
    assert not alive(int(memory[0]))


def test_a_rogue_task_delays_no_other_processor_and_is_ended_with_its_own() -> None:
    here, there = task("here", None, functions.count), task("there", "aux", functions.hang, 5, functions.startup)
    memory = counts()
    rci.rci_timeout(there, 0.1)
    rci.rci_start(here.bit | there.bit)
    runs = here.runs
    rci.rci_wait(lambda: here.runs > runs + 10)
    with pytest.raises((RogueTask, LinkLost)):
        rci.rci_wait(lambda: False)
    wait_until(lambda: not alive(int(memory[0])), "the end of the processor")
    assert here.active


def test_a_processor_ends_with_its_program() -> None:
    program = subprocess.Popen(
        [sys.executable, "-m", "tests.support.rci_auxiliary"], cwd=ROOT, stdout=subprocess.PIPE, text=True
    )
    with program:
        assert program.stdout is not None
        processor = int(program.stdout.readline())
        assert alive(processor)
        program.kill()
    wait_until(lambda: not alive(processor), "the end of the processor")


def test_an_arm_stops_when_the_processor_of_its_task_is_killed(arm: RunningArm) -> None:
    rci.rci_close()
    rci.rci_clock(1000)
    rci.rci_robot("arm", "puma560", f"{arm.arm.bridge.host}:{arm.arm.bridge.port}")
    td = rci.rci_create("arm", "aux")
    memory = counts()
    rci.rci_control(td, functions.swing, None, functions.startup)
    rci.rci_start(td.bit)
    rci.rci_wait(lambda: td.runs > 10)
    assert arm.mode is Mode.TRACKING
    os.kill(int(memory[0]), signal.SIGKILL)
    with pytest.raises(LinkLost, match="has died"):
        rci.rci_wait(lambda: False)
    arm.wait_for(Mode.HOLDING)


def test_a_processor_of_this_machine_belongs_to_one_program() -> None:
    cpu = f"cpu{min(os.sched_getaffinity(0))}"
    found = {info.name: info for info in rci.rci_processors()}
    assert {"host", "aux", cpu} <= set(found)
    assert found[cpu].available
    with claim_processor(cpu):
        info = next(info for info in rci.rci_processors() if info.name == cpu)
        assert (info.available, "another program" in info.remark) == (False, True)
        with pytest.raises(LinkBusy, match=f"processor {cpu} belongs to another program"):
            rci.rci_create("a", cpu)


def test_tasks_of_a_processor_of_this_machine_run_there_with_the_priority_that_is_allowed() -> None:
    """What `set_fifo` gets for a thread of ours is what the processor gets; refused, the task runs all the same."""
    cpu = max(os.sched_getaffinity(0))
    with ThreadPoolExecutor(1) as pool:  # a thread whose schedule is of no further use
        allowed = pool.submit(set_fifo, PRIORITY).result()
        expected = pool.submit(lambda: (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority)).result()
    td = task("told", f"cpu{cpu}", functions.tell_schedule)
    words = counts()
    rci.rci_start(td.bit)
    rci.rci_wait(lambda: words[0] == 1)
    policy, priority, processors = words[1:4].tolist()
    assert (policy, priority) == (expected[0] & ~os.SCHED_RESET_ON_FORK, expected[1])
    assert (policy == os.SCHED_FIFO and priority == PRIORITY) is allowed.ok
    assert processors == 1 << cpu


@pytest.mark.parametrize("name", ["cpu999", "gpu", "auxiliary", "cpu-1", "zenoh://10.0.0.7"])
def test_a_processor_that_is_not_there_is_refused_with_those_that_are(name: str) -> None:
    with pytest.raises(ConfigError, match=r"no processor .*there are host, cpu"):
        rci.rci_create("a", name)


def test_functions_that_no_other_process_can_find_are_refused() -> None:
    td = rci.rci_create("a", "aux")
    with pytest.raises(ConfigError, match="define them in a module"):
        rci.rci_control(td, lambda _: None)
    with pytest.raises(ConfigError, match="define them in a module"):
        rci.rci_onfunction(td, lambda: True)
