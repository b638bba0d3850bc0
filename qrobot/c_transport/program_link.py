"""Interfaces between the engine that serves a program and a dispatcher of calls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias

from qrobot.c_transport.memory import ProgramMemory
from qrobot.c_transport.message import CallMessage, Op


@dataclass(frozen=True)
class ProgramLink:
    """Interface through which the engine reaches the program.

    Attributes:
        call: have a function of the program called: the `Op`, and which.
        signal: have the program count an event.
        ask: put a question to the person at its terminal; EOFError when nobody answers.
        say: print lines there.
        others_wait: true while other threads of the program wait until the call under way is answered.
    """

    call: Callable[[Op, int], None]
    signal: Callable[[int], None]
    ask: Callable[[str], str]
    say: Callable[[str], None]
    others_wait: Callable[[], bool]


class CallDispatcher(Protocol):
    """Serves the calls of one program."""

    def answer(self, message: CallMessage, background: bool = False) -> CallMessage:
        """Do what is asked; in a function that is called at a sample if `background`. Raises QRobotError."""

    def let_go(self) -> None:
        """The program has gone: bring its arms to rest and release them."""


MakeDispatcher: TypeAlias = Callable[[ProgramMemory, Sequence[int], ProgramLink], CallDispatcher]
"""Maker of a dispatcher: of a program's memory, the places that its greeting names, and the way to it."""
