"""Tasks of RCI in real time, on the processor "host", judged by counts and events and never by instants."""

from __future__ import annotations

import os
import select
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from qrobot import rci
from qrobot.errors import ConfigError, LinkLost, RogueTask
from qrobot.rci import TaskDescriptor, TaskState, TcpLink, compiled_thread, host_thread
from qrobot.wire import Mode
from tests.support import rci_compiled as functions
from tests.support.fake_robot import FakeRobot, SocketRobot
from tests.support.patience import PATIENCE_S, wait_until
from tests.support.puma import PARK

pytestmark = pytest.mark.realtime
START = tuple(float(x) for x in PARK)


@pytest.fixture(autouse=True)
def program() -> Iterator[None]:
    """A program in real time, of which nothing is left behind."""
    rci.rci_clock(1000)
    yield
    rci.rci_close()


@contextmanager
def served(robot: FakeRobot) -> Iterator[SocketRobot]:
    """A robot at the far end of a socket."""
    with (
        SocketRobot(robot) as server,
        rci.use(lambda hello: TcpLink(hello, ("test", 0), lambda _: server.socket), virtual_time=False),
    ):
        rci.rci_close()  # the program of the fixture knows no robot
        yield server


def task(name: str, control, interval: int | None = None, offset: int = 0) -> TaskDescriptor:
    td = rci.rci_create(name)
    rci.rci_control(td, control)
    if interval is not None:
        rci.rci_onclock(td, interval, offset)
    return td


def endless(_: TaskDescriptor) -> None:
    while True:
        pass


class EagerRobot(SocketRobot):
    """Its greeting and its first STATE come in one piece, and it says nothing more before it was answered."""

    def _talk(self, near: socket.socket) -> None:
        if not select.select([near], [], [], 0.0)[0]:
            return
        data = near.recv(1 << 16)
        if not data:
            self.hang_up()
        near.sendall(self.robot.hear(data) + self.robot.tell())


def test_a_robot_whose_first_state_comes_with_its_greeting_is_heard() -> None:
    robot = FakeRobot(START)
    with (
        EagerRobot(robot) as server,
        rci.use(lambda hello: TcpLink(hello, ("test", 0), lambda _: server.socket), virtual_time=False),
    ):
        rci.rci_close()
        rci.rci_robot("arm", "puma560")
        td = task("arm", lambda _: None)
        rci.rci_start(td.bit)
        assert td.state is TaskState.ACTIVE
        assert robot.mode is Mode.TRACKING
        rci.rci_close()


def test_tasks_on_one_clock_are_woken_in_step_however_late_they_run() -> None:
    tds = [task(name, lambda _: None, interval, offset) for name, interval, offset in
           (("a", 4, 0), ("b", 8, 2), ("c", 28, 5))]  # fmt: skip
    mask = sum(td.bit for td in tds)
    rci.rci_start(mask)
    a, b, c = tds

    def in_step() -> bool:
        """A task that runs late makes up for it: what it lost would stay away for ever."""
        return c.runs >= 10 and abs(a.runs - 2 * b.runs) <= 1 and abs(a.runs - 7 * c.runs) <= 7

    rci.rci_wait(in_step)
    rci.rci_release(mask)
    assert [td.run_count for td in tds] == [0, 0, 0]


def test_a_program_that_computes_without_a_pause_lets_its_tasks_run() -> None:
    td = task("a", lambda _: None, 10)
    rci.rci_start(td.bit)
    total = 0
    while td.runs < 50:
        total += sum(range(1000))
    assert total


def test_a_task_is_woken_by_a_device_and_reads_it() -> None:
    source, sink = os.pipe()
    heard: list[bytes] = []
    td = task("sensor", lambda _: heard.append(os.read(source, 1)))
    rci.rci_device_interrupt(td, source)
    rci.rci_start(td.bit)
    for letter in (b"a", b"b", b"c"):
        os.write(sink, letter)
    rci.rci_wait(lambda: len(heard) == 3)
    assert (b"".join(heard), td.runs) == (b"abc", 3)
    rci.rci_release(td.bit)
    os.close(sink)
    os.close(source)
    for nothing in (source, -1, "tty", None):
        with pytest.raises(ConfigError, match="no device"):
            rci.rci_device_interrupt(td, nothing)


def test_a_wakeup_function_with_a_device_is_asked_only_when_the_device_says_something() -> None:
    source, sink = os.pipe()
    asked: list[bytes] = []
    heard: list[bytes] = []

    def capital() -> bool:
        asked.append(os.read(source, 1))
        return asked[-1].isupper()

    td = task("sensor", lambda _: heard.append(asked[-1]))
    rci.rci_onfunction(td, capital)
    rci.rci_device_interrupt(td, source)
    rci.rci_start(td.bit)
    os.write(sink, b"aBcD")
    rci.rci_wait(lambda: len(asked) == 4 and td.run_count == 0)
    assert (asked, heard) == ([b"a", b"B", b"c", b"D"], [b"B", b"D"])
    rci.rci_release(td.bit)
    os.close(sink)
    os.close(source)


def test_a_device_that_is_closed_ends_its_task_alone() -> None:
    source, sink = os.pipe()
    good, sensor = task("good", lambda _: None, 1), task("sensor", lambda _: None)
    rci.rci_device_interrupt(sensor, source)
    rci.rci_start(good.bit | sensor.bit)
    os.close(source)
    os.close(sink)
    with pytest.raises(ConfigError, match="task sensor: its device was closed"):
        rci.rci_wait(lambda: False)
    runs = good.runs
    rci.rci_wait(lambda: good.runs > runs + 5)
    assert sensor.state is TaskState.ENDED


def test_whatever_ends_a_processors_thread_ends_all_its_tasks_and_the_program_goes_on() -> None:
    class Unheard(BaseException):
        """No Exception, as Ctrl-C is none."""

    def fail(_: TaskDescriptor) -> None:
        raise Unheard

    good, bad = task("good", lambda _: None, 5), task("bad", fail, 5)
    rci.rci_start(good.bit | bad.bit)
    with pytest.raises(Unheard):
        rci.rci_wait(lambda: False)
    wait_until(lambda: good.state is bad.state is TaskState.ENDED, "the end of all tasks")
    with pytest.raises(LinkLost, match="it has failed"):
        rci.rci_start(good.bit)
    with pytest.raises(Unheard):
        rci.rci_close()


@pytest.mark.parametrize("what", ["trigger", "wakeup", "startup"])
def test_any_function_of_a_task_that_does_not_return_is_ended(what: str) -> None:
    good, rogue = task("good", lambda _: None, 5), rci.rci_create("rogue")
    rci.rci_control(rogue, lambda _: None, None, endless if what == "startup" else None)
    rci.rci_onfunction(rogue, lambda: endless(rogue) if what == "wakeup" else False)
    if what == "trigger":
        rci.rci_trigger(rogue, 1, 0, endless)
    rci.rci_timeout(rogue, 0.05)
    with pytest.raises(RogueTask, match="task rogue ran for more than the 50 ms"):
        started_and_waited_for(good.bit, rogue.bit)
    runs = good.runs
    rci.rci_wait(lambda: good.runs > runs + 5)
    assert (good.state, rogue.state) == (TaskState.ACTIVE, TaskState.ENDED)


def started_and_waited_for(*masks: int) -> None:
    for mask in masks:
        rci.rci_start(mask)
    rci.rci_wait(lambda: False)


def test_a_look_of_the_watch_that_fails_leaves_others_under_it(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = []

    def fail(self: compiled_thread.CompiledThread, now_ns: int) -> None:
        looks.append(now_ns)
        raise ZeroDivisionError

    monkeypatch.setattr(compiled_thread.CompiledThread, "end_rogues", fail)
    rci.rci_create("filter", "compiled")
    wait_until(lambda: len(looks) > 1, "a second look")
    rogue = task("rogue", endless, 5)
    rci.rci_timeout(rogue, 0.05)
    rci.rci_start(rogue.bit)
    with pytest.raises(RogueTask):
        rci.rci_wait(lambda: False)


def test_a_rogue_task_is_found_and_ended_and_others_of_its_processor_go_on() -> None:
    good, rogue = task("good", lambda _: None, 5), task("rogue", endless, 5)
    rci.rci_timeout(rogue, 0.1)
    rci.rci_start(good.bit | rogue.bit)
    with pytest.raises(RogueTask, match="task rogue ran for more than the 100 ms"):
        rci.rci_wait(lambda: False)
    assert (rogue.state, good.state) == (TaskState.ENDED, TaskState.ACTIVE)
    runs = good.runs
    rci.rci_wait(lambda: good.runs > runs + 5)


def test_a_robot_is_stopped_when_its_task_turns_rogue() -> None:
    robot = FakeRobot(START, period_us=4_000, patience=1 << 40)  # it stops only when it is told
    with served(robot):
        td = task("puma560", lambda td: td.chg.go_to(START))
        rci.rci_start(td.bit)
        rci.rci_wait(lambda: td.runs > 3)
        rci.rci_control(td, endless)
        rci.rci_timeout(td, 0.1)
        with pytest.raises(RogueTask):
            rci.rci_wait(lambda: False)
        wait_until(lambda: robot.mode is Mode.HOLDING, "a controlled stop")
        wait_until(lambda: td.state is TaskState.ENDED, "the end of the task")
        assert any(command.stop for command in robot.commands)
        rci.rci_close()


def test_a_task_that_cannot_be_interrupted_is_given_up_and_its_robot_let_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(host_thread, "PATIENCE_S", 0.2)
    robot, forever = FakeRobot(START, period_us=4_000), threading.Event()
    with served(robot) as server:
        td = task("puma560", lambda td: td.chg.go_to(START))
        rci.rci_start(td.bit)
        rci.rci_wait(lambda: td.runs > 3)
        rci.rci_control(td, lambda _: forever.wait(PATIENCE_S))
        rci.rci_timeout(td, 0.1)
        with pytest.raises(RogueTask, match="does not return"):
            rci.rci_wait(lambda: False)
        wait_until(lambda: server.over, "its connection is closed")
        rci.rci_close()
        forever.set()


def test_a_robot_follows_in_real_time_and_is_let_go() -> None:
    robot = FakeRobot(START, period_us=4_000, patience=1 << 40)

    def turn(td: TaskDescriptor) -> None:
        q = np.array(td.how.q_setpoint)
        q[0] += 0.002
        td.chg.go_to(tuple(q.tolist()))

    with served(robot):
        td = task("puma560", turn)
        rci.rci_start(td.bit)
        rci.rci_wait(lambda: td.runs >= 30)
        rci.rci_release(td.bit)
        assert (td.state, robot.mode) == (TaskState.RELEASED, Mode.HOLDING)
        assert robot.q[0] > START[0] + 0.04
        rci.rci_close()


def test_a_bridge_that_goes_away_ends_the_task_and_no_other() -> None:
    robot = FakeRobot(START, period_us=4_000, patience=1 << 40)
    with served(robot) as server:
        rci.rci_clock(1000)
        td, other = task("puma560", lambda td: td.chg.go_to(START)), task("filter", lambda _: None, 5)
        rci.rci_start(td.bit | other.bit)
        server.hang_up()
        with pytest.raises(LinkLost):
            rci.rci_wait(lambda: False)
        runs = other.runs
        rci.rci_wait(lambda: other.runs > runs + 5)
        assert td.state is TaskState.ENDED
        rci.rci_close()


def test_a_task_changes_its_own_interval() -> None:
    seen: list[int] = []
    due: list[int] = []

    def slow_down(td: TaskDescriptor) -> None:
        due.append(td.run_count)
        seen.append(rci.rci_ticks())
        rci.rci_onclock(td, 7)

    td, begin = task("a", slow_down, 3), rci.rci_ticks()
    rci.rci_start(td.bit)
    rci.rci_wait(lambda: due and td.runs >= due[0] + 10)
    # What was due at its first run was so at the old interval; a late one comes later than its tick, and never sooner.
    assert all(tick >= begin + 7 * number for number, tick in enumerate(seen[due[0] :]))


def test_an_error_in_a_task_and_a_processor_that_is_not_there_are_told() -> None:
    td = task("bad", lambda _: 1 / 0, 1)
    rci.rci_start(td.bit)
    with pytest.raises(ZeroDivisionError):
        rci.rci_wait(lambda: False)
    rci.rci_close()
    with pytest.raises(ConfigError, match="no processor 'cpu99'"):
        rci.rci_create("a", "cpu99")


def runs_during_one_call(td: TaskDescriptor) -> int:
    """How often a task ran while this thread kept the interpreter."""
    before = td.runs
    sum(range(20_000_000))
    return td.runs - before


def test_a_compiled_task_runs_while_the_program_keeps_the_interpreter() -> None:
    """`sum` over a range is one call, which lets no other thread have the interpreter."""
    td = rci.rci_create("filter", "compiled")
    memory = rci.rci_shared_memory("filter", 8 * (functions.N_TICKS + 2)).view(np.float64)
    rci.rci_control(td, functions.note, functions.double)
    rci.rci_onclock(td, 1)
    rci.rci_start(td.bit)
    rci.rci_wait(lambda: td.runs)  # its thread is in compiled code
    assert any(runs_during_one_call(td) > 10 for _ in range(100))
    rci.rci_onclock(td, 4, 2)
    rci.rci_release(td.bit)
    assert (memory[0], memory[-1], td.run_count) == (td.runs, 2.0 * td.runs, 0)
    memory[:] = 0.0
    rci.rci_start(td.bit)
    rci.rci_wait(lambda: memory[0] > 10)
    rci.rci_release(td.bit)
    assert set(np.flatnonzero(memory[1:-1]) % 4) == {2}


def test_a_compiled_function_that_does_not_return_is_told_and_others_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled_thread, "PATIENCE_S", 0.2)
    good, td = task("good", lambda _: None, 5), rci.rci_create("stuck", "compiled")
    rci.rci_control(td, functions.hang)
    rci.rci_onclock(td, 1)
    rci.rci_timeout(td, 0.1)
    rci.rci_start(good.bit | td.bit)
    with pytest.raises(RogueTask, match="keeps processor compiled"):
        rci.rci_wait(lambda: False)
    runs = good.runs
    rci.rci_wait(lambda: good.runs > runs + 5)
    assert td.state is TaskState.ENDED
    wait_until(lambda: "rci-compiled" not in {thread.name for thread in threading.enumerate()}, "its return")


def test_what_a_compiled_function_raises_ends_its_task_alone_and_is_told_each_time() -> None:
    good, td = task("good", lambda _: None, 5), rci.rci_create("filter", "compiled")
    rci.rci_shared_memory("filter", 8)
    rci.rci_control(td, functions.fail)
    rci.rci_onclock(td, 1)
    rci.rci_start(good.bit)
    for _ in range(2):
        rci.rci_start(td.bit)
        with pytest.raises(ValueError, match="the compiled function cannot go on"):
            rci.rci_wait(lambda: False)
        assert td.state is TaskState.ENDED
    runs = good.runs
    rci.rci_wait(lambda: good.runs > runs + 5)


class SlowLink(TcpLink):
    """A link of which the far end answers when another task of the processor has run on."""

    watched: TaskDescriptor

    def open(self):
        self._let_it_run()
        return super().open()

    def close(self, reason: str = "") -> None:
        self._let_it_run()
        super().close(reason)

    def _let_it_run(self) -> None:
        runs = self.watched.runs
        wait_until(lambda: self.watched.runs > runs + 5, "runs of another task while a link is opened or closed")


def test_a_bridge_that_is_slow_to_greet_and_to_part_keeps_no_other_task_from_running() -> None:
    with (
        SocketRobot(FakeRobot(START)) as server,
        rci.use(lambda hello: SlowLink(hello, ("test", 0), lambda _: server.socket), virtual_time=False),
    ):
        rci.rci_close()
        good, arm = task("good", lambda _: None, 1), task("puma560", lambda _: None)
        SlowLink.watched = good
        rci.rci_start(good.bit)
        rci.rci_start(arm.bit)
        rci.rci_wait(lambda: arm.runs >= 3)
        rci.rci_release(arm.bit)
        assert (arm.state, good.state) == (TaskState.RELEASED, TaskState.ACTIVE)
        rci.rci_close()


def test_an_arm_whose_task_sees_that_a_compiled_one_has_failed_comes_to_a_controlled_stop() -> None:
    def follow(td: TaskDescriptor) -> None:
        td.chg.go_to(START)
        if td.runs > 3 and not rci.rci_descriptor("filter").active:
            raise RuntimeError("the filter has failed")

    robot = FakeRobot(START, period_us=4_000, patience=1 << 40)  # it stops only when it is told
    with served(robot):
        arm, td = task("puma560", follow), rci.rci_create("filter", "compiled")
        rci.rci_shared_memory("filter", 8, td, arm.bit)
        rci.rci_control(td, functions.fail)
        rci.rci_onclock(td, 1)
        rci.rci_start(arm.bit | td.bit)
        with pytest.raises(ValueError, match="cannot go on"):
            rci.rci_wait(lambda: False)
        with pytest.raises(RuntimeError, match="the filter has failed"):
            rci.rci_wait(lambda: False)
        wait_until(lambda: robot.mode is Mode.HOLDING, "a controlled stop")
        assert any(command.stop for command in robot.commands)
        rci.rci_close()
