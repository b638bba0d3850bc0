"""Control laws in files of their users: `path/to/file.py:name`, or `path/to/file.py` when it holds only one."""

from __future__ import annotations

import hashlib
import importlib.util
import linecache
import sys
import traceback
from pathlib import Path
from types import ModuleType

from qrobot.config import Robot
from qrobot.errors import ConfigError, error_text
from qrobot.realtime.source_digest import forget_stamps
from qrobot.servo.laws.casadi_law import CasadiLaw
from qrobot.servo.laws.law import Law
from qrobot.servo.laws.names import split_name


def law_digest(name: str) -> str:
    """Digest of the text of the file that a law stands in. Raises ConfigError when there is none."""
    return hashlib.sha256(_text(Path(split_name(name)[0]))).hexdigest()


def load_law(name: str, robot: Robot) -> Law:
    """The law in a file, for a robot. The file is run, as any program of the user's.

    Raises:
        ConfigError: no such file or law; the file fails, with its line; the law cannot be made.
    """
    path, wanted = split_name(name)
    file = Path(path)
    laws = {
        key: value
        for key, value in vars(_module(file)).items()
        if isinstance(value, (Law, CasadiLaw)) and key[0] != "_"
    }
    if not wanted and len(laws) == 1:
        wanted = next(iter(laws))
    if wanted not in laws:
        there = f"there are: {', '.join(laws)}" if laws else "there is none: put @law or @casadi_law above a function"
        raise ConfigError(f"{file} has no law {wanted!r}; {there}")
    found = laws[wanted]
    try:
        return found.for_robot(robot) if isinstance(found, CasadiLaw) else found
    except ConfigError as error:
        raise ConfigError(f"{place_of(file, error)}: {error}") from error


def _module(file: Path) -> ModuleType:
    """The file as a module; one that has changed since is run anew."""
    text = _text(file)
    digest = hashlib.sha256(file.resolve().as_posix().encode() + text).hexdigest()[:16]
    name = f"qrobot_user_laws.{file.stem}_{digest}"
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, file.resolve())
    if spec is None or spec.loader is None:
        raise ConfigError(f"{file} is no Python file")
    forget_stamps()  # the file may have changed while we run: neither its old code nor its old text will do
    linecache.cache.pop(str(file.resolve()), None)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where Numba finds the functions of a cached law
    try:
        # not by the loader, which takes a file of the same size and second for the one it has compiled
        exec(compile(text, str(file.resolve()), "exec"), vars(module))
    except (Exception, SystemExit) as error:  # whatever a user's file raises
        del sys.modules[name]
        raise ConfigError(f"{place_of(file, error)}: {type(error).__name__}: {error}") from error
    return module


def _text(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise ConfigError(f"no law file {file}: {error_text(error)}") from error


def place_of(file: Path, error: BaseException) -> str:
    """The file, and the line in it where things went wrong, as `FILE, line N`; also of what caused the error."""
    if isinstance(error, SyntaxError):
        return f"{file}, line {error.lineno}"
    lines = [
        entry.lineno for entry in traceback.extract_tb(error.__traceback__) if Path(entry.filename) == file.resolve()
    ]
    if not lines and error.__cause__ is not None:
        return place_of(file, error.__cause__)
    return f"{file}, line {lines[-1]}" if lines else str(file)


def law_and_line(name: str, error: BaseException) -> str:
    """A law's name, and of one in a file the line where things went wrong, as `FILE:NAME, line N`."""
    path, _ = split_name(name)
    return name + place_of(Path(path), error).removeprefix(str(Path(path)))
