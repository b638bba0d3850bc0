"""Virtual time that all machines of a program share: it passes while the program waits, and nobody is left behind."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final, Protocol

from qrobot.errors import LinkError, MotionError

NO_WAIT: Final = "a function that is called at each sample must not wait: let it give a semaphore"


class SteppedMachine(Protocol):
    """A machine whose samples somebody lets pass.

    Attributes:
        error: what ended it.
        sampling: one of its samples is being made.
    """

    error: BaseException | None
    sampling: bool

    @property
    def elapsed_ms(self) -> float:
        """Time of the next sample, ms from its first."""

    def step(self) -> None:
        """Let a sample pass; keep what goes wrong in `error`."""


class _Member:
    """A machine, the thread of its program, and the shared time at which its own began."""

    def __init__(self, machine: SteppedMachine, origin_ms: float) -> None:
        self.machine = machine
        self.origin_ms = origin_ms
        self.thread = threading.get_ident()

    @property
    def now_ms(self) -> float:
        return self.origin_ms + self.machine.elapsed_ms


_members: list[_Member] = []


def join(machine: SteppedMachine) -> None:
    """Let time pass for a machine from now on, beside the others of its program."""
    _members.append(_Member(machine, max((member.now_ms for member in _here()), default=0.0)))


def leave(machine: SteppedMachine) -> None:
    """Let no more time pass for a machine."""
    _members[:] = [member for member in _members if member.machine is not machine]


def wait(machine: SteppedMachine, predicate: Callable[[], bool]) -> None:
    """Let time pass until `predicate` is true.

    Raises:
        BaseException: what ended the machine.
        MotionError: called by a function that is itself called at each sample.
        LinkError: the machine was closed.
    """
    if any(member.machine.sampling for member in _here()):
        raise MotionError(NO_WAIT)
    while not predicate():
        if machine.error is not None:
            raise machine.error
        if all(member.machine is not machine for member in _members):
            raise LinkError("the robot was closed: nothing can happen any more")
        behind = min(_here(), key=lambda member: member.now_ms)
        behind.machine.step()
        if behind.machine.error is not None:  # told when the program turns to it
            leave(behind.machine)


def _here() -> list[_Member]:
    """Machines of this thread's program, in the order in which they were opened."""
    return [member for member in _members if member.thread == threading.get_ident()]
