"""Orders to a processor in a process of its own, and whose answer each of them gets."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import Pipe
from typing import Any

import pytest

from qrobot.errors import ConfigError, MotionError
from qrobot.rci.process_main import AuxiliaryProcessor
from qrobot.rci.process_processor import ProcessProcessor


class Host:
    """What carries orders out, in the other process."""

    def __init__(self) -> None:
        self.heard: list[tuple[Any, ...]] = []
        self.refuses: dict[str, Exception] = {}

    def order(self, order: str, *arguments: Any) -> None:
        self.heard.append((order, *arguments))
        if order in self.refuses:
            raise self.refuses[order]


class Interrupted:
    """Our end of a pipe: Ctrl-C comes in the wait for the first answer."""

    def __init__(self, connection: Any) -> None:
        self._connection, self._comes = connection, True
        self.send, self.recv = connection.send, connection.recv

    def poll(self, seconds: float) -> bool:
        if self._comes:
            self._comes = False
            raise KeyboardInterrupt
        return bool(self._connection.poll(seconds))


class Living:
    """A process that lives."""

    def is_alive(self) -> bool:
        return True


@contextmanager
def serving(host: Host, connection: Any) -> Iterator[None]:
    """The far end of a pipe, until the end is ordered."""
    far: Any = AuxiliaryProcessor.__new__(AuxiliaryProcessor)
    far._host, far._program = host, ()

    def serve() -> None:
        while far._take_order(connection):
            pass

    thread = threading.Thread(target=serve)
    thread.start()
    yield
    thread.join()


def running(connection: Any) -> Any:
    """A processor whose process is at the other end of a connection, and has tasks."""
    processor: Any = ProcessProcessor("aux1", lambda: None)
    processor._process, processor._orders = Living(), connection
    return processor


def test_a_processor_that_hangs_keeps_no_order_from_another_one() -> None:
    (far, silent), (ours, theirs), host = Pipe(), Pipe(), Host()
    hanging, other = running(far), running(ours)
    with serving(host, theirs):
        answers = [processor.begin("release", 1, False) for processor in (hanging, other)]
        answers[1]()
        ours.send((0, "end", ()))
    assert host.heard == [("release", 1, False)]
    assert silent.recv() == (1, "release", (1, False))


def test_the_wait_for_a_processor_ends_when_the_watch_has_found_that_it_hangs() -> None:
    far, _silent = Pipe()
    hanging = running(far)
    answer = hanging.begin("release", 1, False)
    hanging._bury("its task does not return")
    answer()


def test_ctrl_c_in_an_order_leaves_its_answer_to_nobody_and_each_later_one_has_its_own() -> None:
    ours, theirs = Pipe()
    host = Host()
    host.refuses = {"attach": MotionError("of attach"), "activate": ConfigError("of activate")}
    processor: Any = ProcessProcessor("aux1", lambda: None)
    processor.order("set_clock", 1, 2, 0)
    processor.order("set_functions", 1)
    processor._process, processor._orders = Living(), Interrupted(ours)
    with serving(host, theirs):
        with pytest.raises(KeyboardInterrupt):  # in set_clock, which has waited for the process
            processor.order("attach", 1)
        with pytest.raises(MotionError, match="of attach"):
            processor.order("attach", 1)
        processor.order("release", 1, False)
        with pytest.raises(ConfigError, match="of activate"):
            processor.order("activate", 1, 0)
        ours.send((0, "end", ()))
    names = [order for order, *_ in host.heard]
    assert names == ["set_clock", "set_functions", "attach", "release", "activate"]  # nothing is left out
