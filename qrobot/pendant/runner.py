"""Common part of the programs and procedures of one arm at the pendant: one command at a time, which can be ended."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Final

from qrobot.pendant.command_run import CommandRun

NICE: Final = 10  # of what moves no arm: it must not take the processor from a servo that runs
CLOSE_S: Final = 11.0  # what is ended is killed by then


class Runner(ABC):
    """Belongs to one arm.

    Args:
        changed: called, from any thread, when what is told of the newest run is another.
    """

    def __init__(self, changed: Callable[[], None]) -> None:
        self._changed = changed
        self._run: CommandRun | None = None
        self._runs = 0

    @property
    @abstractmethod
    def live(self) -> bool:
        """Something runs that commands the arm."""

    @property
    def running(self) -> CommandRun | None:
        """The newest run, None once it has ended."""
        return self._run if self._run is not None and self._run.state == "running" else None

    def end(self) -> None:
        """End what runs; returns at once."""
        if (run := self.running) is not None:
            run.end()

    def stop(self) -> None:
        """End what commands the arm; returns at once."""
        if self.live:
            self.end()

    def output(self, after: int) -> dict[str, Any]:
        """Lines that the newest run has printed, from number `after` on."""
        part = self._run.output.since(after) if self._run else None
        return {"run": self._runs, "first": part.first if part else 0, "lines": part.lines if part else []}

    def close(self) -> None:
        """End what runs, and wait for it."""
        if (run := self.running) is not None:
            run.end()
            run.wait(CLOSE_S)
