"""Control tasks on virtual time, by section 4.3 of the paper."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot import rci
from qrobot.config import load_robot
from qrobot.errors import ConfigError, LinkLost
from qrobot.rci import TaskState, VirtualLink
from qrobot.rci.bad_end import stop_all
from qrobot.rci.common_clock import checked_rate
from qrobot.rci.descriptor import MOST_TASKS
from qrobot.rci.program import RciProgram
from qrobot.rci.virtual_time import VirtualProcessors
from qrobot.wire import Mode
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK, ROBOT
from tests.support.rci_tasks import Runs, no_robot, pass_ticks, recorded, virtual_program
from tests.support.thorough import examples

TASKS = st.lists(st.tuples(st.integers(1, 9), st.integers(-9, 9), st.integers(-2, 2)), min_size=1, max_size=5)
PLACES = ("aux", "aux1")


def test_two_tasks_of_interval_4_and_offsets_0_and_2_take_turns_s10() -> None:
    with virtual_program() as runs:
        first, second = recorded(runs, "first", 4, 0), recorded(runs, "second", 4, 2)
        rci.rci_start(first.bit | second.bit)
        pass_ticks(13)
    assert runs == [(t, "first" if t % 4 == 0 else "second") for t in range(0, 13, 2)]


@settings(max_examples=examples(30))
@given(TASKS)
def test_tasks_run_by_priority_then_creation_at_exactly_their_ticks(tasks) -> None:
    """The oracle goes over all ticks and all tasks, by the paper's rule, one after the other."""
    expected: Runs = []
    for tick in range(40):
        due = [
            (-priority, i) for i, (interval, offset, priority) in enumerate(tasks) if (tick - offset) % interval == 0
        ]
        expected += [(tick, str(i)) for _, i in sorted(due)]
    with virtual_program() as runs:
        tds = [recorded(runs, str(i), *task) for i, task in enumerate(tasks)]
        rci.rci_start(sum(td.bit for td in tds))
        pass_ticks(40)
        assert [td.run_count for td in tds] == [td.missed for td in tds] == [0] * len(tds)
        assert sum(td.runs for td in tds) == len(runs)
    assert runs == expected


def test_all_processors_are_told_to_release_before_one_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    heard: list[tuple[str, str]] = []
    begin = VirtualProcessors.begin

    def noted(self, processor: str, order: str, *arguments: object):
        heard.append(("told", processor))
        answer = begin(self, processor, order, *arguments)
        return lambda: (heard.append(("waited for", processor)), answer())

    monkeypatch.setattr(VirtualProcessors, "begin", noted)
    processors = ("host", "aux", "aux1")
    with virtual_program() as runs:
        rci.rci_start(sum(recorded(runs, name, 1, proc=name).bit for name in processors))
    assert heard == [(what, name) for what in ("told", "waited for") for name in processors]


@pytest.mark.parametrize("failing", ["host", "aux"])
def test_an_error_of_one_processor_keeps_no_other_one_from_its_release(failing: str, monkeypatch) -> None:
    begin = VirtualProcessors.begin

    def failed(self, processor: str, order: str, *arguments: object):
        answer = begin(self, processor, order, *arguments)
        return (lambda: checked_rate(0)) if processor == failing else answer

    with virtual_program() as runs:
        tds = [recorded(runs, name, 1, proc=name) for name in ("host", "aux")]
        rci.rci_start(rci.ALL)
        monkeypatch.setattr(VirtualProcessors, "begin", failed)
        with pytest.raises(ConfigError, match="clock of 0 Hz"):
            rci.rci_release(rci.ALL)
        monkeypatch.undo()
        assert [td.state for td in tds] == [TaskState.RELEASED] * 2


@pytest.mark.parametrize("failing", ["host", "aux"])
def test_a_bad_end_of_the_program_lets_tasks_begin_to_rest_on_all_processors_but_one_that_is_lost(
    failing: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = VirtualProcessors.begin

    def lost(self, processor: str, order: str, *arguments: object):
        if processor == failing:
            raise LinkLost(f"processor {processor} is lost")
        return begin(self, processor, order, *arguments)

    with virtual_program() as runs:
        tds = {name: recorded(runs, name, 1, proc=name) for name in ("host", "aux")}
        rci.rci_start(rci.ALL)
        monkeypatch.setattr(VirtualProcessors, "begin", lost)
        stop_all()
        monkeypatch.undo()
        assert [td.state for name, td in tds.items() if name != failing] == [TaskState.RELEASED]
    stop_all()  # of a program that is closed there is nothing left to stop


def test_a_control_function_cannot_end_the_program() -> None:
    """It would wait for its own end."""
    with virtual_program():
        td = rci.rci_create("ender", None)
        rci.rci_control(td, lambda _: rci.rci_close())
        rci.rci_onclock(td, 1)
        rci.rci_start(td.bit)
        with pytest.raises(ConfigError, match="rci_close: a control function must not wait for its own end"):
            pass_ticks(3)
        assert td.state is TaskState.ENDED


@contextmanager
def two_arms() -> Iterator[list[FakeRobot]]:
    """Arms with power, each of which follows a task on a processor of its own, `PLACES`."""
    arms = {name: FakeRobot(tuple(PARK)) for name in ("left", "right")}
    with rci.use({name: partial(VirtualLink, transfer=arm.transfer) for name, arm in arms.items()}):
        try:
            for name, place in zip(arms, PLACES, strict=True):
                rci.rci_robot(name, ROBOT.name)
                rci.rci_control(rci.rci_create(name, place), lambda _: None)
            rci.rci_start(rci.ALL)
            yield list(arms.values())
        finally:
            rci.rci_close()


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("failing", [0, 1])
@pytest.mark.parametrize("fails", ["release", "power_off"])
def test_an_error_of_one_processor_leaves_no_arm_of_another_one_with_power(
    fails: str, failing: int, told: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arms follow, or were released and hold; the error comes from a processor that has done as `told`, or not."""
    begin = VirtualProcessors.begin

    def failed(self, processor: str, order: str, *arguments: object):
        fault = processor == PLACES[failing] and order == fails
        if fault and not told:
            checked_rate(0)
        answer = begin(self, processor, order, *arguments)
        return (lambda: checked_rate(0)) if fault else answer

    with two_arms() as arms:
        if fails == "power_off":
            rci.rci_release(rci.ALL)
        assert Mode.OFF not in [arm.mode for arm in arms]
        monkeypatch.setattr(VirtualProcessors, "begin", failed)
        with pytest.raises(ConfigError, match="clock of 0 Hz"):
            rci.rci_release(rci.ALL, power_off=True)
        assert arms[1 - failing].mode == Mode.OFF
        monkeypatch.undo()


def test_creating_a_task_does_not_activate_it_and_it_is_active_until_released() -> None:
    with virtual_program() as runs:
        td = recorded(runs, "filter", 1)
        pass_ticks(3)
        assert (runs, td.state) == ([], TaskState.CREATED)
        rci.rci_start(td.bit)
        assert td.active
        pass_ticks(2)
        rci.rci_release(td.bit)
        pass_ticks(5)
        assert (td.state, td.runs) == (TaskState.RELEASED, 2)
        rci.rci_start(td.bit)
        pass_ticks(1)
    assert [tick for tick, _ in runs] == [3, 4, 10]


def test_the_startup_function_is_called_once_at_the_first_start_before_the_control_functions() -> None:
    said = []
    with virtual_program():
        td = rci.rci_create("filter")
        rci.rci_control(td, lambda _: said.append("1"), lambda _: said.append("2"), lambda td: said.append(td.name))
        rci.rci_onclock(td, 1)
        for _ in range(2):
            rci.rci_start(td.bit)
            pass_ticks(2)
            rci.rci_release(td.bit)
    assert said == ["filter", *"1212", *"1212"]


def test_several_tasks_are_started_and_released_between_the_same_two_ticks() -> None:
    with virtual_program() as runs:
        tds = [recorded(runs, name, 1, proc=proc) for name, proc in (("a", None), ("b", "aux1"), ("c", "aux2"))]
        mask = sum(td.bit for td in tds)
        rci.rci_start(mask)
        pass_ticks(3)
        rci.rci_release(mask)
        pass_ticks(3)
    assert runs == [(tick, name) for tick in range(3) for name in "abc"]


def test_attributes_change_while_a_task_is_active() -> None:
    said = []
    with virtual_program() as runs:
        td = recorded(runs, "filter", 2)
        rci.rci_start(td.bit)
        pass_ticks(4)
        rci.rci_onclock(td, 5, 1)
        pass_ticks(8)
        rci.rci_control(td, lambda _: said.append(rci.rci_ticks()))
        pass_ticks(8)
    assert [tick for tick, _ in runs] == [0, 2, 6, 11]
    assert said == [16]


def test_a_task_is_woken_by_a_function_whatever_the_clock_says() -> None:
    level, seen = [0], []
    with virtual_program():
        td = rci.rci_create("event")
        rci.rci_control(td, lambda _: (seen.append(rci.rci_ticks()), level.__setitem__(0, 0)))
        rci.rci_onfunction(td, lambda: level[0])
        rci.rci_start(td.bit)
        for tick in (3, 4, 9):
            rci.rci_wait(lambda tick=tick: rci.rci_ticks() >= tick - 1)
            level[0] = 1
        pass_ticks(3)
    assert seen == [3, 4, 9]


def test_a_trigger_is_called_on_its_interval_and_starts_the_device_that_wakes_the_task() -> None:
    """The device needs no time here: it is ready at the tick at which it was triggered."""
    said: list[tuple[str, int]] = []
    ready = []
    with virtual_program():
        td = rci.rci_create("force")
        rci.rci_control(td, lambda _: (ready.clear(), said.append(("ran", rci.rci_ticks()))))
        rci.rci_onfunction(td, lambda: ready)
        rci.rci_trigger(td, 5, 2, lambda td: (ready.append(td), said.append(("triggered", rci.rci_ticks()))))
        pass_ticks(4)
        rci.rci_start(td.bit)
        pass_ticks(10)
        rci.rci_release(td.bit)
        pass_ticks(10)
    assert said == [("triggered", 7), ("ran", 7), ("triggered", 12), ("ran", 12)]


def test_what_a_control_function_raises_ends_its_task_alone_and_is_told_once() -> None:
    with virtual_program() as runs:
        good, bad = recorded(runs, "good", 1), recorded(runs, "bad", 1)
        rci.rci_control(bad, lambda _: 1 / 0)
        rci.rci_start(good.bit | bad.bit)
        with pytest.raises(ZeroDivisionError):
            pass_ticks(5)
        pass_ticks(3)
        assert (bad.state, good.state) == (TaskState.ENDED, TaskState.ACTIVE)
        assert good.runs == 4
        rci.rci_control(bad, lambda td: runs.append((rci.rci_ticks(), td.name)))
        rci.rci_start(bad.bit)
        pass_ticks(1)
    assert runs[-1][1] == "bad"


def test_an_end_nobody_has_heard_of_is_told_at_the_close() -> None:
    with rci.use(no_robot):
        td = rci.rci_create("bad")
        rci.rci_control(td, lambda _: {}[0])
        rci.rci_onclock(td, 1)
        rci.rci_start(td.bit)
        with pytest.raises(KeyError):
            pass_ticks(1)
        rci.rci_close()
        rci.rci_close()
        with pytest.raises(ConfigError, match="call rci_create"):
            rci.rci_start(td.bit)


def test_a_function_that_is_under_way_at_the_close_finds_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """A task on another thread may be in its function then."""
    seen, close = [], RciProgram.close

    def closing(program: RciProgram) -> None:
        seen.append(rci.rci_get_memory("counts").nbytes)
        close(program)

    monkeypatch.setattr(RciProgram, "close", closing)
    with virtual_program():
        rci.rci_create("a")
        rci.rci_shared_memory("counts", 8)
        rci.rci_close()
    assert seen == [8]
    with pytest.raises(ConfigError, match="there are no tasks"):
        rci.rci_get_memory("counts")


def test_a_start_up_function_that_fails_starts_none_of_the_tasks() -> None:
    with virtual_program() as runs:
        good, bad = recorded(runs, "good", 1), recorded(runs, "bad", 1)
        rci.rci_control(bad, print, None, lambda _: {}["gain"])
        with pytest.raises(KeyError):
            rci.rci_start(good.bit | bad.bit)
        pass_ticks(5)
        assert (good.active, runs) == (False, [])


def test_all_tasks_and_memory_are_created_before_any_is_active() -> None:
    with virtual_program() as runs:
        rci.rci_start(recorded(runs, "a", 1).bit)
        for late in (
            lambda: rci.rci_create("b"),
            lambda: rci.rci_shared_memory("m", 8),
            lambda: rci.rci_clock(500),
        ):
            with pytest.raises(ConfigError, match=r"before the first rci_start|there is one of that"):
                late()


def test_a_control_function_that_waits_is_told_not_to() -> None:
    with virtual_program() as runs:
        td = recorded(runs, "a", 1)
        rci.rci_control(td, lambda _: rci.rci_wait(lambda: True))
        rci.rci_start(td.bit)
        with pytest.raises(ConfigError, match="must not wait"):
            pass_ticks(1)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda _: rci.rci_create("a"), "there is one of that name"),
        (lambda _: rci.rci_create(""), "cannot name a task"),
        (lambda _: rci.rci_create("parent"), "cannot name a task"),
        (lambda td: rci.rci_control(td, 3), "is no function"),
        (lambda td: rci.rci_onfunction(td, None), "is no function"),
        (lambda td: rci.rci_onclock(td, 0), "interval 0"),
        (lambda td: rci.rci_trigger(td, 4, 0.5, print), "offset 0.5"),
        (lambda td: rci.rci_start(td.bit), "has no functions"),
        (lambda _: rci.rci_start(64), "no mask of tasks"),
        (lambda _: rci.rci_start("a"), "no mask of tasks"),
        (lambda _: rci.rci_release(1), "names no control task"),
        (lambda _: rci.rci_clock(1001), "1 to 1000"),
        (lambda _: rci.rci_descriptor("b"), "no task 'b'"),
        (lambda _: rci.rci_robot("left", "puma650"), "puma560"),
    ],
)
def test_a_call_that_cannot_be_names_what_is_allowed(call, text: str) -> None:
    with virtual_program():
        td = rci.rci_create("a")
        with pytest.raises(ConfigError, match=text):
            call(td)


def test_a_descriptor_of_a_program_that_was_closed_is_refused() -> None:
    with virtual_program():
        old = rci.rci_create("a")
    with virtual_program():
        new = rci.rci_create("a")
        with pytest.raises(ConfigError, match="none of this program's"):
            rci.rci_onclock(old, 1)
        assert rci.rci_descriptor("a") is new
        with pytest.raises(Exception, match="has no robot"):
            new.chg  # noqa: B018
        with pytest.raises(Exception, match="has no robot"):
            new.how  # noqa: B018


@pytest.mark.parametrize(("rate_hz", "ticks"), [(None, 100), (100, 100), (36, 36), (250, 250), (1000, 1000)])
def test_the_clock_has_100_ticks_a_second_unless_a_faster_one_is_chosen(rate_hz: int | None, ticks: int) -> None:
    """Counted against a robot that is sampled by its own clock, every 10 ms."""
    fake = FakeRobot(tuple(load_robot("puma560").poses["park"]), period_us=10_000)
    with rci.use(lambda hello: VirtualLink(hello, fake.transfer)):
        if rate_hz is not None:
            rci.rci_clock(rate_hz)
        td = rci.rci_create("puma560")
        at: list[int] = []
        rci.rci_control(td, lambda _: at.append(rci.rci_ticks()))
        rci.rci_start(td.bit)
        rci.rci_wait(lambda: len(at) == 101)
        rci.rci_close()
    assert at[100] - at[0] == pytest.approx(ticks, abs=1)


@pytest.mark.parametrize("wrong", [("b", "host", "x"), ("b", "host", True), ("b", 3), (3,), (None,)])
def test_a_task_that_cannot_be_leaves_nothing_behind(wrong: tuple) -> None:
    with virtual_program():
        with pytest.raises(ConfigError):
            rci.rci_create(*wrong)
        assert rci.rci_create("b").bit == 2
        with pytest.raises(ConfigError, match="one of that name already"):
            rci.rci_create("b")


def test_a_program_has_so_many_tasks_and_says_so() -> None:
    with virtual_program():
        for k in range(MOST_TASKS):
            rci.rci_create(f"t{k}")
        with pytest.raises(ConfigError, match=f"there are {MOST_TASKS} already"):
            rci.rci_create("one more")
