"""The machine of an ARCL program, chosen outside it: by whoever starts it, or by a switch or an attribute."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from qrobot.config import Robot
from qrobot.config.signals import NamedSignal


@dataclass(frozen=True)
class MachineChoice:
    """The choice of whoever starts a program; empty and None choose nothing.

    Attributes:
        ami: name of the machine layer.
        stream: folder for diagnostic streams, one for each robot that is opened.
        robot: taken in place of the packaged one of its name.
        signals: of that robot, by their names.
    """

    ami: str = ""
    stream: Path | None = None
    robot: Robot | None = None
    signals: tuple[NamedSignal, ...] = ()


_choice: ContextVar[MachineChoice] = ContextVar("machine_choice", default=MachineChoice())  # noqa: B039 (immutable)


@contextmanager
def use_machine(choice: MachineChoice) -> Iterator[None]:
    """Programs run in this context use that machine."""
    token = _choice.set(choice)
    try:
        yield
    finally:
        _choice.reset(token)


def machine_choice() -> MachineChoice:
    """The choice for the program that asks."""
    return _choice.get()
