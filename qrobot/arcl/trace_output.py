"""stdout as the place of a program's traces, where it may be full, closed, or held by a person (Ctrl-S, a pager).

A program does not lose its arm for a trace. A line that cannot be written is lost. Lines that are told while an arm in
real time waits for the caller are written by a thread of their own.
"""

from __future__ import annotations

import sys
from contextlib import suppress
from functools import cache
from typing import Final

from qrobot.rci.thread_driver import keeps_samples_waiting
from qrobot.report import QueuedReport

PROGRAM_PATIENCE_S: Final = 0.5  # [A] that a program waits for lines told before, once for a stdout that is held
SAMPLE_PATIENCE_S: Final = 0.005  # [A] the same of a function for which samples wait


def say(line: str, waited_for: bool = False) -> None:
    """Print a line of a trace; `waited_for`: an arm waits for the caller, as it does at its samples."""
    if waited_for or keeps_samples_waiting():
        _lines()(line)
    else:
        settle()
        _write(line)


def settle() -> None:
    """Wait a moment for lines that are still to be written: what is printed next stands behind them."""
    if _lines.cache_info().currsize:
        _lines().flush(SAMPLE_PATIENCE_S if keeps_samples_waiting() else PROGRAM_PATIENCE_S)


@cache
def _lines() -> QueuedReport:
    return QueuedReport(_write)


def _write(line: str) -> None:
    with suppress(OSError, ValueError, AttributeError):  # AttributeError: the program was started without a stdout
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
