"""Output of the command: results on stdout, one line per error on stderr, and an exit status that means something."""

from __future__ import annotations

import difflib
import errno
import json
import os
import shutil
import sys
import sysconfig
from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, TextIO

from cyclopts import App, CycloptsError, UnknownCommandError, ValidationError
from rich.console import Console, ConsoleDimensions
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from qrobot.errors import ConfigError, QRobotError
from qrobot.extras import missing_extra
from qrobot.printable import printable
from qrobot.realtime.compile_progress import COMPILING
from qrobot.realtime.interrupt import INTERRUPTED
from qrobot.realtime.signals import SignalledEnd
from qrobot.whole_file import replace_file

PROGRAM: Final = "qrobot"

SUCCESS: Final = 0
FAILURE: Final = 1  # what was asked could not be done
USAGE: Final = 2  # it was not asked properly
NOT_WRITTEN: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)

PIPE_COLUMNS: Final = 10_000  # what is not shown on a terminal is cut nowhere


class _Results(Console):
    """A console as wide as its terminal, or as anything may be where a pipe or a file takes the lines."""

    @property  # type: ignore[misc]  # Rich also sets it, which nobody does here
    def size(self) -> ConsoleDimensions:
        """Columns and lines."""
        found = super().size
        return found if self.is_terminal else ConsoleDimensions(PIPE_COLUMNS, found.height)

    def on_broken_pipe(self) -> None:
        """Let `run_app` end the command: its reader has had enough, which is no failure."""
        raise  # noqa: PLE0704  # Rich calls this while it handles the BrokenPipeError


class _Messages(Console):
    """A console that nobody has to read."""

    def on_broken_pipe(self) -> None:
        """Say nothing more; results go on."""
        self.quiet = True


# Paths and names may have brackets, and words between colons that are no pictures.
out = _Results(highlight=False, markup=False, emoji=False)
err = _Messages(stderr=True, highlight=False, markup=False, emoji=False)


def complain(message: str) -> None:
    """One red line on stderr."""
    _say(Text(f"qrobot: {printable(' '.join(message.split()))}", style="red"))


def note(message: str) -> None:
    """One line on stderr, for progress that is no result."""
    _say(Text("\n".join(map(printable, message.split("\n")))))


def _say(line: Text) -> None:
    """Print on stderr; a full disk behind it ends nothing that goes on, nor does it change how a command ends."""
    with suppress(OSError):
        err.print(line, soft_wrap=True)


class EveryTenth:
    """Some ten lines for who waits for the compiler, the first at once; numbers of kernels may be left out."""

    _tenth = 0

    def __call__(self, name: str, number: int, of: int) -> None:
        """Tell that a kernel is being compiled, when it is the first one or another tenth is done."""
        tenth = number * 10 // of
        if number == 1 or tenth > self._tenth:
            note(f"{COMPILING} {number} of {of}, once for this version on this machine: {name}")
        self._tenth = tenth


def plain_table(title: str, *headings: str, words: Collection[str] = ()) -> Table:
    """A table without lines: the first column and those headed by `words` to the left, numbers to the right."""
    table = Table(title=title or None, title_justify="left", box=None, padding=(0, 2, 0, 0))
    for number, heading in enumerate(headings):
        table.add_column(heading, justify="left" if number == 0 or heading in words else "right")
    return table


def command_name() -> str:
    """Name of this program in a line to copy: with its folder, where a terminal does not find this one by itself."""
    own, found = Path(sysconfig.get_path("scripts"), PROGRAM), shutil.which(PROGRAM)
    if not own.exists() or (found is not None and own.samefile(found)):
        return PROGRAM
    return str(own.relative_to(Path.cwd())) if own.is_relative_to(Path.cwd()) else str(own)


def print_table(table: Table) -> None:
    """Print a table with all of its words and numbers, where the terminal is too narrow for them wider than that."""
    title, table.title = table.title, None
    if title:
        out.print(title, style="italic", soft_wrap=True)
    everything = out.options.update(max_width=PIPE_COLUMNS)
    needed = Measurement.get(out, everything, table).minimum
    if needed <= out.width:
        out.print(table)
        return
    wide = Console(
        width=needed, file=out.file, force_terminal=out.is_terminal, highlight=False, markup=False, emoji=False
    )
    wide.print(table)


def write_json(value: Any, path: Path | None = None) -> None:
    """Print `value` as JSON, or write it to `path`. Raises ConfigError when the file cannot be written."""
    text = json.dumps(value, indent=2)
    if path is None:
        out.print(text, soft_wrap=True, markup=False)
    else:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, text + "\n")
        except OSError as error:
            raise ConfigError(f"cannot write {path}: {error.strerror}") from None


def run_app(app: App, tokens: Sequence[str], prepare: Callable[[], object] = lambda: None) -> int:
    """Run `prepare` and one command; returns the exit status: the command's own when it returns an integer.

    Every QRobotError becomes one line, and so does what the system says of a file; anything else is our mistake and
    keeps its traceback.
    """
    app.suppress_keyboard_interrupt = False  # it would exit from inside
    try:
        prepare()
        result = app(tokens, exit_on_error=False, print_error=False, result_action="return_value")
        if sys.stdout is not None:  # the shell may have closed it
            sys.stdout.flush()
    except CycloptsError as error:
        complain(f"{_sentence(error)} (see `{' '.join(['qrobot', *(error.command_chain or ())])} --help`)")
        return USAGE
    except (QRobotError, ModuleNotFoundError) as error:
        if (told := str(error) if isinstance(error, QRobotError) else missing_extra(error)) is None:
            raise
        complain(told)
        return FAILURE
    except (KeyboardInterrupt, ImportError) as error:
        if (interrupt := _interrupt_behind(error)) is None:
            raise
        _forget_unwritten()
        _forget_interrupt()
        return interrupt.status if isinstance(interrupt, SignalledEnd) else INTERRUPTED
    except BrokenPipeError:  # `qrobot log info | head`: the reader has had enough
        _let_be_lost(sys.stdout)
        return SUCCESS
    except OSError as error:
        if error.filename is None and error.errno not in NOT_WRITTEN:
            raise
        _forget_unwritten()
        # A file or folder of the user's, or the disk behind it; without a name, where its output goes most of all.
        complain(f"{error.filename or 'what it writes is not taken'}: {error.strerror}")
        return FAILURE
    return result if isinstance(result, int) else SUCCESS


def _interrupt_behind(error: BaseException) -> KeyboardInterrupt | None:
    """The interrupt that an error is or comes of: a compiled library that is loaded makes an ImportError of each."""
    while isinstance(error, ImportError) and error.__cause__ is not None:
        error = error.__cause__
    return error if isinstance(error, KeyboardInterrupt) else None


def _forget_interrupt() -> None:
    """Let the process end by its status.

    An interrupt that comes while a text is executed, as in the making of a dataclass, is noted by CPython, and `python
    -m` then ends by SIGINT though it was handled (`unhandled_keyboard_interrupt`, pythonrun.c, main.c). The next text
    that is executed begins with a clean note.
    """
    exec("")


def _forget_unwritten() -> None:
    """Let be lost what a closed terminal or a full disk has not taken, without another error as the process ends."""
    for stream in filter(None, (sys.stdout, sys.stderr)):  # the shell may have closed one
        try:
            stream.flush()
        except OSError:
            _let_be_lost(stream)


def _let_be_lost(stream: TextIO) -> None:
    """Let what a stream has not taken, and whatever comes, go nowhere: there is nobody to read it."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _sentence(error: CycloptsError) -> str:
    if isinstance(error, UnknownCommandError) and error.app is not None and error.unused_tokens:
        return _unknown_command(error.unused_tokens[0], [name for name in error.app if not name.startswith("-")])
    if isinstance(error, ValidationError):
        return _refused_value(error)
    return str(error).strip().rstrip(".")


def _refused_value(error: ValidationError) -> str:
    """The message of a check of `option_types.py`, which names the value; Cyclopts knows no option of a default."""
    option = f"{error.argument.name}: " if error.argument is not None else ""
    return f"{option}{error.exception_message}"


def _unknown_command(word: str, known: list[str]) -> str:
    # Cyclopts would import every command to say this.
    near = difflib.get_close_matches(word, known, n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"there are: {', '.join(known)}"
    return f"no command {word!r}; {hint}"
