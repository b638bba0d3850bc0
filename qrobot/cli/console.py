"""How the command talks: results on stdout, one line per error on stderr, an exit status that means something."""

from __future__ import annotations

import difflib
import json
import os
import sys
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, Final

from cyclopts import App, CycloptsError, UnknownCommandError
from rich.console import Console
from rich.table import Table
from rich.text import Text

from qrobot.errors import QRobotError
from qrobot.printable import printable

SUCCESS: Final = 0
FAILURE: Final = 1  # what was asked could not be done
USAGE: Final = 2  # it was not asked properly
INTERRUPTED: Final = 130  # 128 + SIGINT, as shells have it

out = Console(highlight=False)
err = Console(stderr=True, highlight=False)


def complain(message: str) -> None:
    """One red line on stderr."""
    err.print(Text(f"qrobot: {printable(' '.join(message.split()))}", style="red"), soft_wrap=True)


def note(message: str) -> None:
    """One line on stderr, for progress that is no result."""
    err.print(Text("\n".join(map(printable, message.split("\n")))), soft_wrap=True)


def plain_table(title: str, *headings: str, words: Collection[str] = ()) -> Table:
    """A table without lines: the first column and those headed by `words` to the left, numbers to the right."""
    table = Table(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="left" if number == 0 or heading in words else "right")
    return table


def write_json(value: Any, path: Path | None = None) -> None:
    """Print `value` as JSON, or write it to `path`. Raises OSError when the file cannot be written."""
    text = json.dumps(value, indent=2)
    if path is None:
        out.print(text, soft_wrap=True, markup=False)
    else:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text + "\n")


def run_app(app: App, tokens: Sequence[str], prepare: Callable[[], object] = lambda: None) -> int:
    """Run `prepare` and one command; returns the exit status: the command's own when it returns an integer.

    Every QRobotError becomes one line; anything else is our mistake and keeps its traceback.
    """
    app.suppress_keyboard_interrupt = False  # it would exit from inside
    try:
        prepare()
        result = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
        sys.stdout.flush()
    except CycloptsError as error:
        complain(f"{_sentence(error)} (see `qrobot --help`)")
        return USAGE
    except QRobotError as error:
        complain(str(error))
        return FAILURE
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # `qrobot log info | head`: the reader has had enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return SUCCESS
    return result if isinstance(result, int) else SUCCESS


def _sentence(error: CycloptsError) -> str:
    if isinstance(error, UnknownCommandError) and error.app is not None and error.unused_tokens:
        return _unknown_command(error.unused_tokens[0], [name for name in error.app if not name.startswith("-")])
    return str(error).strip().rstrip(".")


def _unknown_command(word: str, known: list[str]) -> str:
    # Cyclopts would import every command to say this.
    near = difflib.get_close_matches(word, known, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"there are: {', '.join(known)}"
    return f"no command {word!r}; {hint}"
