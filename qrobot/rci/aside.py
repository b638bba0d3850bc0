"""Work that may take seconds, as a greeting over the network, and what follows from it between two runs of tasks."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

T = TypeVar("T")


class Outcome(Generic[T]):
    """Value of a piece of work, or the error that it raised."""

    def __init__(self, work: Callable[[], T]) -> None:
        self._error: Exception | None = None
        try:
            self._value = work()
        except Exception as error:  # it belongs to whoever asks
            self._error = error

    def get(self) -> T:
        """The value. Raises what the work raised."""
        if self._error is not None:
            raise self._error
        return self._value


class Aside(Protocol):
    """A way to have work done, and its outcome handed over where tasks run."""

    def __call__(self, work: Callable[[], T], then: Callable[[Outcome[T]], object]) -> None:
        """Do `work`, and call `then` with its outcome."""


def at_once(work: Callable[[], T], then: Callable[[Outcome[T]], object]) -> None:
    """Do it here and now, as on virtual time, where waiting costs no time."""
    then(Outcome(work))


class HelperThreads:
    """Does each piece of work in a thread of its own, and hands the outcome over by `ring`, between two runs.

    Args:
        ring: lets the loop of the processor call a function.
    """

    def __init__(self, ring: Callable[[Callable[[], object]], None]) -> None:
        self._ring = ring

    def __call__(self, work: Callable[[], T], then: Callable[[Outcome[T]], object]) -> None:
        """Do it aside; returns at once."""

        def help_out() -> None:
            outcome = Outcome(work)
            self._ring(lambda: then(outcome))

        threading.Thread(target=help_out, name="rci-link", daemon=True).start()
