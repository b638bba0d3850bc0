"""Interrupts: those that end what they find, wait until it must not be torn apart any more, or do not count."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from qrobot.realtime.signals import ENDING, handled, is_heeded


@contextmanager
def interrupts_deferred() -> Iterator[None]:
    """Ctrl-C, SIGTERM and SIGHUP come into force when the block ends. From the main thread.

    A process started inside does not inherit that: `exec` gives caught signals their default action again.
    """
    came: list[tuple[int, FrameType | None]] = []
    before = {int(number): signal.getsignal(number) for number in ENDING}
    with handled({n: lambda *arrived: came.append(arrived) for n, handler in before.items() if callable(handler)}):
        yield
    for number, frame in came[:1]:
        if callable(handler := before[number]):
            handler(number, frame)


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """SIGTERM, and SIGHUP of a closed terminal, raise KeyboardInterrupt, as SIGINT does. From the main thread.

    Both may come together: one that does not count (`is_heeded`) would tear what the first has begun to take down.
    """
    came: set[int] = set()

    def interrupt(number: int, frame: FrameType | None) -> None:
        heeded = is_heeded(number, came)
        came.add(number)
        if heeded:
            signal.default_int_handler(number, frame)

    heard = [number for number in ENDING[1:] if signal.getsignal(number) is not signal.SIG_IGN]  # as nohup does
    with handled(dict.fromkeys(heard, interrupt)):
        yield


@contextmanager
def interrupts_ignored() -> Iterator[None]:
    """Ctrl-C, SIGTERM and SIGHUP are lost. From the main thread."""
    with handled(dict.fromkeys(ENDING, signal.SIG_IGN)):
        yield
