"""Handlers of signals that end a process: an event where it has no loop of its own, an exception while it starts."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from time import monotonic
from types import FrameType
from typing import Final, TypeAlias

Handler: TypeAlias = Callable[[int, FrameType | None], object] | int | None
SIGNALLED: Final = 128  # exit status, less its number, of a command that a signal has ended, as shells have it
ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)  # of a terminal, of whoever ends us, of one that closes
NEEDED_S: Final = 0.05  # from one question whether a process is still needed to the next
_FULL = BlockingIOError  # the pipe holds more than anybody needs to be woken


def signal_name(number: int) -> str:
    """Name of a signal; those of real time, but the first and the last, have none."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


class SignalledEnd(KeyboardInterrupt):
    """A signal other than SIGINT has ended a command.

    Attributes:
        status: exit status of the command.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.status = SIGNALLED + number


class SignalEvent(threading.Event):
    """An event that signal handlers may set, and that is not cleared. `close` gives its files back.

    A handler runs in the main thread, wherever that is. Inside the `wait` of a plain `threading.Event` the main thread
    holds the lock for which `set` then waits, for ever: now and then a process that was asked to end would not.
    """

    def __init__(self) -> None:
        super().__init__()
        self._happened = False
        self._needed: Callable[[], bool] | None = None
        self._ask_s = 0.0
        self._reads, self._writes = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)

    def set(self) -> None:
        """Wake who waits: it has happened."""
        self._happened = True
        with contextlib.suppress(_FULL):
            os.write(self._writes, b"!")

    def set_unless(self, needed: Callable[[], bool]) -> None:
        """Let it happen at a look, the end of a `wait` included, that finds `needed` not true any more.

        Looks ask at most every NEEDED_S: what they ask may take files and locks.
        """
        self._needed = needed

    def is_set(self) -> bool:
        """Whether it has happened."""
        if not self._happened and self._needed is not None and (now_s := monotonic()) >= self._ask_s:
            self._ask_s = now_s + NEEDED_S
            if not self._needed():
                self.set()
        return self._happened

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it happens, for `timeout` seconds at most; whether it has happened."""
        if not self._happened:
            select.select([self._reads], [], [], timeout)
        return self.is_set()

    def close(self) -> None:
        """Release both ends; call it when nothing waits any more and no handler sets it."""
        os.close(self._reads)
        os.close(self._writes)


def ending_signals() -> tuple[signal.Signals, ...]:
    """SIGTERM, SIGINT, and SIGHUP of a closed terminal unless somebody, as nohup, has it ignored."""
    ignored = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    return (signal.SIGTERM, signal.SIGINT, *(() if ignored else (signal.SIGHUP,)))


def is_heeded(number: int, came: Collection[int]) -> bool:
    """Whether SIGTERM or SIGHUP counts beside those that came before it.

    SIGHUP, of a closed terminal, comes from the kernel and from the shell: it counts once, and not at all beside
    SIGTERM, as at the end of a session of systemd. SIGTERM that comes again does.
    """
    return not came or (number == signal.SIGTERM and number in came)


@contextlib.contextmanager
def handled(handlers: Mapping[int, Handler]) -> Iterator[None]:
    """Signals have these handlers in the block, and afterwards those of before. From the main thread."""
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def set_on_signals(needed: Callable[[], bool] | None = None) -> Iterator[threading.Event]:
    """An event that SIGTERM, SIGINT, and SIGHUP of a closed terminal set; outside the block they do what they did.

    While this process is `needed`, SIGHUP waits, and counts soon after; then waits need a limit. For the main thread.
    """
    done = SignalEvent()

    def end(_number: int, _frame: FrameType | None) -> None:
        done.set()

    def hang_up(_number: int, _frame: FrameType | None) -> None:
        if needed is None:
            done.set()
        else:
            done.set_unless(needed)

    with contextlib.closing(done), handled({n: hang_up if n == signal.SIGHUP else end for n in ending_signals()}):
        yield done


@contextlib.contextmanager
def interrupted_by_sigterm() -> Iterator[None]:
    """SIGTERM raises KeyboardInterrupt, as SIGINT does: what has been made is taken down again. For the main thread."""
    with handled({signal.SIGTERM: signal.default_int_handler}):
        yield


@contextlib.contextmanager
def ends_as_ctrl_c() -> Iterator[Callable[[], bool]]:
    """SIGTERM and SIGHUP do what SIGINT does at that moment; gives a function that tells whether one has come.

    Which count says `is_heeded`; where somebody, as nohup, has SIGHUP ignored it does not. Only the main thread may ask
    for it; in another one nothing changes.

    Raises:
        SignalledEnd: in place of the KeyboardInterrupt that came of it, and of what a closed terminal refuses to take.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    came: list[int] = []

    def hear(number: int, frame: FrameType | None) -> None:
        heeded = is_heeded(number, came)
        came.append(number)
        if heeded and callable(signal.getsignal(signal.SIGINT)):
            signal.raise_signal(signal.SIGINT)
        elif heeded:  # a shell ignores Ctrl-C, and nothing else, for what a script runs in the background
            signal.default_int_handler(number, frame)

    try:
        with handled({number: hear for number in ending_signals() if number != signal.SIGINT}):
            yield lambda: bool(came)
    except (KeyboardInterrupt, OSError):
        if came:
            raise SignalledEnd(came[0]) from None
        raise
