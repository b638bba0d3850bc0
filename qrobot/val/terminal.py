"""The terminal of the monitor: line editing, history and completion by prompt_toolkit; plain lines from a pipe."""

from __future__ import annotations

import sys
import termios
from collections.abc import Callable, Iterator
from contextlib import suppress

from qrobot.errors import ConfigError
from qrobot.extras import missing_library
from qrobot.val.monitor import ValMonitor

PROMPT = "."  # VAL's own


def serve(monitor: ValMonitor, say: Callable[[str], None], ended: Callable[[], bool] = lambda: False) -> None:
    """Obey lines until QUIT, which the end of input stands for, or until a Ctrl-C after which it has `ended`.

    Raises what `ValMonitor.obey` raises, ConfigError without prompt_toolkit.
    """
    for line in _typed(monitor, ended) if sys.stdin.isatty() else sys.stdin:
        if answer := monitor.obey(line):
            say(answer)
        if monitor.over:
            return
        if ended():
            break
    monitor.obey("QUIT")


def forget_typed() -> None:
    """Let what was typed already, and nobody has read, not count: it is no answer to what is asked now."""
    with suppress(OSError, ValueError, termios.error):  # a pipe, or nothing at all: its lines wait for their turn
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)


def _typed(monitor: ValMonitor, ended: Callable[[], bool]) -> Iterator[str]:
    try:
        from prompt_toolkit import PromptSession, prompt
        from prompt_toolkit.completion import WordCompleter
        from prompt_toolkit.input.typeahead import clear_typeahead
    except ModuleNotFoundError as error:
        raise ConfigError(missing_library("prompt_toolkit")) from error
    session: PromptSession[str] = PromptSession()

    def sure(question: str) -> bool:
        try:
            return prompt(question).strip().upper() in ("Y", "YES")
        except EOFError:
            return False

    monitor.sure = sure
    while True:
        if monitor.stopped:
            forget_typed()
            clear_typeahead(session.input)
        try:
            yield session.prompt(PROMPT, completer=WordCompleter(monitor.names, ignore_case=True, WORD=True))
        except KeyboardInterrupt:
            if ended():
                return
        except EOFError:
            return
