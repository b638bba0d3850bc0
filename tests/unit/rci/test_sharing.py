"""Shared memory, shared data, messages, signals and the support functions of RCI, by section 4.3.5 and 4.3.6."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections import deque
from itertools import count

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot import rci
from qrobot.errors import ConfigError
from qrobot.rci import calls, mail_lane, task_table
from qrobot.rci.descriptor import TaskDescriptor, local_area
from qrobot.rci.mail_lane import LANE_WORDS, LARGEST_MESSAGE
from qrobot.rci.task_table import ALL, TaskTable, catches
from tests.support.rci_tasks import pass_ticks, recorded, virtual_program
from tests.support.thorough import examples

GAINS = np.array([[1.0, 2.0], [3.0, 4.0]])


def run_in(td: rci.TaskDescriptor, function) -> None:
    """Let a task that is woken at every tick run a function once."""
    rci.rci_control(td, function)
    pass_ticks(1)
    rci.rci_control(td, lambda _: None)


@pytest.fixture
def pair():
    with virtual_program() as runs:
        a, b = recorded(runs, "a", 1), recorded(runs, "b", 1)
        yield a, b


def test_a_task_reaches_the_memory_its_mask_allows_by_label(pair) -> None:
    a, b = pair
    memory = rci.rci_shared_memory("gains", 24, a, access_mask=0)
    assert (memory.nbytes, memory.any()) == (24, False)
    rci.rci_start(a.bit | b.bit)
    run_in(a, lambda _: rci.rci_get_memory("gains").view(np.float64).__setitem__(slice(None), [1.5, 2.5, 3.5]))
    assert memory.view(np.float64).tolist() == [1.5, 2.5, 3.5]
    assert rci.rci_get_memory("gains") is memory  # the planning program may
    with pytest.raises(ConfigError, match="task b may not reach 'gains'"):
        run_in(b, lambda _: rci.rci_get_memory("gains"))
    with pytest.raises(ConfigError, match="no shared memory 'gain'; there is gains"):
        rci.rci_get_memory("gain")


@pytest.mark.parametrize("size", [0, -8, 1.5, True, 1 << 40])
def test_memory_of_no_size_is_refused(pair, size) -> None:
    with pytest.raises(ConfigError, match="bytes"):
        rci.rci_shared_memory("m", size)


def test_a_label_stands_for_one_region(pair) -> None:
    rci.rci_shared_memory("m", 8)
    with pytest.raises(ConfigError, match="is there already"):
        rci.rci_shared_memory("m", 16)


def test_a_global_array_is_shared_with_its_values(pair, monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = pair
    here = sys.modules[__name__]
    monkeypatch.setattr(here, "GAINS", GAINS)
    shared = rci.rci_shared_data(b.bit, here, "GAINS")
    assert shared.tolist() == [[1.0, 2.0], [3.0, 4.0]]
    rci.rci_start(a.bit | b.bit)
    run_in(b, lambda _: GAINS.__setitem__((0, 1), 7.0))
    assert shared[0, 1] == 7.0
    with pytest.raises(ConfigError, match="a global NumPy array"):
        rci.rci_shared_data(b.bit, here, "pair")


def test_messages_arrive_whole_in_order_and_tell_their_sender(pair) -> None:
    a, b = pair
    rci.rci_start(a.bit | b.bit)
    assert rci.rci_receive() == (b"", None)
    assert rci.rci_send(a.bit, b"from the parent") == 15
    run_in(b, lambda _: (rci.rci_send(a.bit, b"from b"), rci.rci_send(1 | a.bit, b"to both")))
    heard = []
    run_in(a, lambda _: heard.extend(rci.rci_receive() for _ in range(4)))
    assert [(data, None if td is None else td.name) for data, td in heard] == [
        (b"from the parent", "parent"),
        (b"from b", "b"),
        (b"to both", "b"),
        (b"", None),
    ]
    assert rci.rci_receive(b.bit) == (b"to both", b)


def test_a_mask_chooses_whose_messages_are_taken(pair) -> None:
    a, b = pair
    rci.rci_start(a.bit | b.bit)
    run_in(a, lambda _: rci.rci_send(1, b"a"))
    run_in(b, lambda _: rci.rci_send(1, b"b"))
    assert rci.rci_receive(b.bit) == (b"b", b)
    assert rci.rci_receive(b.bit) == (b"", None)
    assert rci.rci_receive() == (b"a", a)


@settings(max_examples=examples(40))
@given(st.lists(st.one_of(st.binary(min_size=1, max_size=1500), st.none()), max_size=40))
def test_a_queue_takes_what_fits_and_gives_it_back_in_order(steps: list[bytes | None]) -> None:
    """The oracle: a queue of words. None takes a message, bytes send one."""
    with virtual_program():
        a = rci.rci_create("a")
        waiting: deque[bytes] = deque()
        free = LANE_WORDS - 2
        for step in steps:
            if step is not None:
                words = 2 + -(-len(step) // 8)
                assert rci.rci_send(a.bit, step) == (len(step) if words <= free else 0)
                if words <= free:
                    waiting.append(step)
                    free -= words
            else:
                data, sender = calls._table().receive(a, rci.ALL)
                assert data == (waiting.popleft() if waiting else b"")
                free += 2 + -(-len(data) // 8) if data else 0
                assert (sender is None) == (not data)


@pytest.mark.parametrize("full", [0, 1])
def test_a_message_to_several_tasks_of_which_one_has_no_room_reaches_none(pair, full: int) -> None:
    """Section 4.3.5: whoever finds that the queue area is out of space tries again, and is heard once."""
    rci.rci_start(pair[0].bit | pair[1].bit)
    table, (crowded, other) = calls._table(), (pair[full], pair[1 - full])
    sent = 0
    while rci.rci_send(crowded.bit, bytes(500)):
        sent += 1
    mask = crowded.bit | other.bit
    assert rci.rci_send(mask, bytes(500)) == 0
    assert table.receive(other, ALL) == (b"", None)
    table.receive(crowded, ALL)
    assert rci.rci_send(mask, b"again" * 100) == 500
    assert table.receive(other, ALL)[0] == b"again" * 100
    assert [len(table.receive(crowded, ALL)[0]) for _ in range(sent + 1)] == [500] * sent + [0]


@pytest.mark.parametrize("data", [b"", bytes(LARGEST_MESSAGE + 1)])
def test_a_message_of_no_bytes_or_too_many_is_refused(pair, data: bytes) -> None:
    with pytest.raises(ConfigError, match=f"1 to {LARGEST_MESSAGE} bytes"):
        rci.rci_send(pair[0].bit, data)


def test_a_task_interrupts_the_planning_program_by_a_signal_it_has_a_handler_for(pair) -> None:
    a, _ = pair
    rci.rci_start(a.bit)
    heard = []
    before = signal.signal(signal.SIGUSR1, lambda number, _: heard.append((number, rci.rci_ticks())))
    try:
        run_in(a, lambda _: rci.rci_signal())
        assert heard == [(signal.SIGUSR1, rci.rci_ticks())]
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert not catches(os.getpid(), signal.SIGUSR1)
    with pytest.raises(ConfigError, match="no handler for signal 10"):
        run_in(a, lambda _: rci.rci_signal())


def test_a_word_is_set_by_one_task_only_until_it_is_cleared(pair) -> None:
    memory = rci.rci_shared_memory("locks", 20)  # two whole words
    assert [rci.rci_test_and_set(memory, 1) for _ in range(3)] == [False, True, True]
    assert not rci.rci_test_and_set(memory)
    rci.rci_clear(memory, 1)
    assert not rci.rci_test_and_set(memory, 1)
    for word in (2, -1, 0.5):
        with pytest.raises(ConfigError, match="words 0 to 1"):
            rci.rci_test_and_set(memory, word)


def test_memory_of_a_task_is_zero_and_of_no_use_once_freed() -> None:
    memory = rci.rci_malloc(3)
    assert bytes(memory) == bytes(3)
    rci.rci_free(memory)
    with pytest.raises(ValueError, match="released"):
        memory[0] = 1
    for size in (0, -1, "8"):
        with pytest.raises(ConfigError, match="number of bytes"):
            rci.rci_malloc(size)


def test_a_line_on_the_console_begins_with_the_task(pair, capsys: pytest.CaptureFixture[str]) -> None:
    a, _ = pair
    rci.rci_start(a.bit)
    run_in(a, lambda _: rci.rci_print("gain", 2.5))
    rci.rci_print("done")
    assert capsys.readouterr().err == "[a] gain 2.5\n[parent] done\n"


def test_the_kernels_of_messages_are_ready_before_a_task_is_active(monkeypatch: pytest.MonkeyPatch) -> None:
    """Types of all arguments that they see in a task were seen when the program began: nothing is compiled late."""
    seen: set[tuple] = set()
    for name in ("put_message", "oldest_stamp", "take_message", "set_word", "clear_word"):
        for module in (mail_lane, task_table, calls):
            if (kernel := getattr(module, name, None)) is not None:
                monkeypatch.setattr(module, name, noting(seen, name, kernel))
    with virtual_program():
        td = rci.rci_create("a")
        flag = rci.rci_shared_memory("flag", 24)
        rci.rci_control(td, lambda _: (rci.rci_send(1, b"hello"), rci.rci_receive(), rci.rci_test_and_set(flag, 2)))
        rci.rci_onclock(td, 1)
        rci.rci_start(td.bit)
        ready = set(seen)
        assert {name for name, *_ in ready} == {"put_message", "oldest_stamp", "take_message", "set_word", "clear_word"}
        rci.rci_send(td.bit, b"a message of three words")
        pass_ticks(2)
        assert rci.rci_receive() == (b"hello", td)
        rci.rci_clear(flag, 2)
        assert seen == ready


def noting(seen: set[tuple], name: str, kernel):
    def call(*arguments):
        seen.add((name, *(numba.typeof(argument) for argument in arguments)))
        return kernel(*arguments)

    return call


@pytest.mark.parametrize(
    ("data", "error"), [("text", "a message is bytes, not 'text'"), (7, "is bytes, not 7"), (None, "is bytes")]
)
def test_a_message_that_is_no_bytes_is_refused(pair, data, error: str) -> None:
    with pytest.raises(ConfigError, match=error):
        rci.rci_send(pair[0].bit, data)


def test_a_message_to_nobody_else_tells_that_its_mask_is_wrong(pair) -> None:
    with pytest.raises(ConfigError, match="names no task but parent"):
        rci.rci_send(1, b"hello")


def test_messages_that_two_threads_receive_at_once_are_whole() -> None:
    """Both ends receive all the time, from one table as in a program, while both send."""
    table, stamps = TaskTable(count().__next__), range(2000)
    ends = [TaskDescriptor(name, 1 << i, "host", local_area()) for i, name in enumerate("ab")]
    heard: dict[str, set[bytes]] = {"a": set(), "b": set()}
    for td in ends:
        table.add(td)

    def talk(here: TaskDescriptor, there: TaskDescriptor) -> None:
        for _ in stamps:
            table.send(here, there.bit, here.name.encode() * 3200)
            heard[here.name].add(table.receive(here, ALL)[0])

    threads = [threading.Thread(target=talk, args=pair) for pair in (ends, ends[::-1])]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert heard["a"] <= {b"", b"b" * 3200}
    assert heard["b"] <= {b"", b"a" * 3200}
