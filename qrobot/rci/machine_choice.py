"""The machine of an ARCL program, chosen outside it: by whoever starts it, or by a switch or an attribute."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.config.signals import NamedSignal
from qrobot.rci.link import LinkFactory


class TeachPendant(Protocol):
    """A teach pendant: lets a person move an arm until he has done."""

    def __call__(self, links: LinkFactory, robot: Robot, learn: Callable[[Floats], bool]) -> None:
        """Take the arm, and let go of it again.

        Args:
            links: ways to the arm, which nobody else commands meanwhile.
            robot: the arm.
            learn: called with the joint positions, shape (n,), at each press of the key ENTER; true ends it.

        Raises:
            ConfigError: nobody can use it, for example without a terminal.
            LinkError, ServoFault: the arm cannot be taken, or is lost.
        """


@dataclass(frozen=True)
class MachineChoice:
    """The choice of whoever starts a program; empty and None choose nothing.

    Attributes:
        ami: name of the machine layer.
        stream: folder for diagnostic streams, one for each robot that is opened.
        robot: taken in place of the packaged one of its name.
        signals: of that robot, by their names.
        analog_ranges: least and most volts of its analogue outputs, by their numbers from 1.
        pendant: with which a person may move an arm that a program lends; None for none.
        start: where that robot stands when it is not there, rad or m, shape (n,); None for its park pose.
        outputs: numbers of its binary outputs that lead somewhere, from 1; None where nobody knows.
        bridge: its address, "host:port"; empty where nobody knows.
    """

    ami: str = ""
    stream: Path | None = None
    robot: Robot | None = None
    signals: tuple[NamedSignal, ...] = ()
    pendant: TeachPendant | None = None
    analog_ranges: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    start: Floats | None = None
    outputs: frozenset[int] | None = None
    bridge: str = ""


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


def choice_for(robot: str, bridge: str) -> MachineChoice:
    """The same for one arm of the program, without what it says of another one.

    Args:
        robot: the name in its robot file.
        bridge: the address at which the program has named it, "host:port"; empty for the arm of the program.
    """
    choice = machine_choice()
    if choice.robot is not None and choice.robot.name == robot and bridge in ("", choice.bridge):
        return choice
    return MachineChoice(choice.ami, choice.stream, pendant=choice.pendant)
