"""A C program with its engine in this process, which says which arm it gets."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Final

from qrobot.c_transport.engine import serve
from qrobot.c_transport.program_link import MakeDispatcher
from qrobot.errors import ConfigError
from qrobot.rci.c.relay import relay
from qrobot.realtime.signals import SIGNALLED, ending_signals, handled, signal_name

ENGINE: Final = "QROBOT_ENGINE"  # environment: the two channels a program finds
_ELF: Final = b"\x7fELF"


def is_executable(path: Path) -> bool:
    """A compiled program, not a script."""
    with path.open("rb") as file:
        return file.read(len(_ELF)) == _ELF


def run_served(path: Path, arguments: Sequence[str], languages: Sequence[MakeDispatcher]) -> int:
    """Run a program made by `qrobot cc` and serve it; its exit status, 128 and the signal's number if that ended it.

    `languages` are those of `serve`.

    Raises:
        ConfigError: it cannot be started, or was compiled by another version.
        QRobotError: the arm was lost, and the program could not be told.
    """
    ours, theirs = zip(*(socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2)), strict=True)
    channels = [end.fileno() for end in theirs]
    with _signals_are_the_programs() as started, relay() as variables:
        environment = os.environ | {ENGINE: ",".join(map(str, channels))} | variables
        try:
            child = subprocess.Popen([path.resolve(), *arguments], pass_fds=channels, env=environment)
        except OSError as error:
            raise ConfigError(f"cannot start {path}: {error.strerror}") from error
        finally:
            for end in theirs:
                end.close()
        started(child)
        try:
            foreground, background = ours
            serve(foreground, background, languages)
        finally:
            status = child.wait()
    if status >= 0:
        return status
    print(f"{path.name}: ended by {signal_name(-status)} ({signal.strsignal(-status)})", file=sys.stderr)
    return SIGNALLED - status


@contextmanager
def _signals_are_the_programs() -> Iterator[Callable[[subprocess.Popen[bytes]], None]]:
    """The program ends in its own way; gives a function that takes its process.

    Ctrl-C and SIGHUP of a closed terminal reach it too, SIGTERM is passed on, also one that came before. Handlers here,
    as deafness would be inherited.
    """
    children: list[subprocess.Popen[bytes]] = []
    early: list[int] = []

    def hear(number: int, _frame: FrameType | None) -> None:
        if number != signal.SIGTERM:
            return
        if not children:
            early.append(number)
        for child in children:
            child.send_signal(number)

    def started(child: subprocess.Popen[bytes]) -> None:
        children.append(child)
        if early:
            child.send_signal(signal.SIGTERM)

    with handled(dict.fromkeys(ending_signals(), hear)):
        yield started
