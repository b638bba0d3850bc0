"""Signals as a process of a terminal knows them, wherever the tests were started from."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from qrobot.realtime.signals import handled


@contextmanager
def default_signals(*numbers: signal.Signals) -> Iterator[None]:
    """Processes started in the block hear these, though `nohup` or the background of a script has them ignored."""
    with handled(dict.fromkeys(numbers, signal.SIG_DFL)):
        yield


def at_once(*numbers: signal.Signals) -> None:
    """Have the main thread, which calls, meet them all at one moment."""
    signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    for number in numbers:
        signal.pthread_kill(threading.get_ident(), number)  # those of the process another thread would take
    signal.pthread_sigmask(signal.SIG_UNBLOCK, numbers)
