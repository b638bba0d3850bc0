"""Programs of RCI on virtual time, and tasks that write down when they ran."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from qrobot import rci
from qrobot.rci import Link, TaskDescriptor
from qrobot.wire import Hello

Runs = list[tuple[int, str]]


def no_robot(hello: Hello) -> Link:
    """The way to a robot where there is none."""
    raise AssertionError(f"nobody should have greeted {hello.robot}")


@contextmanager
def virtual_program() -> Iterator[Runs]:
    """A program on virtual time that ends with its block; the list is filled by `recorded` tasks."""
    with rci.use(no_robot):
        try:
            yield []
        finally:
            rci.rci_close()


def recorded(runs: Runs, name: str, interval: int, offset: int = 0, priority: int = 0, proc=None) -> TaskDescriptor:
    """A task that notes tick and name whenever it runs."""
    td = rci.rci_create(name, proc, priority)
    rci.rci_control(td, lambda td: runs.append((rci.rci_ticks(), td.name)))
    rci.rci_onclock(td, interval, offset)
    return td


def pass_ticks(n: int) -> None:
    """Let so many ticks pass."""
    end = rci.rci_ticks() + n
    rci.rci_wait(lambda: rci.rci_ticks() >= end)
