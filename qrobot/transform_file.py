"""Named transforms in a file that people can read and edit: the data base of RCCL, the symbol table of ARCL.

One line for each, millimetres and degrees, after a heading that says so:

    # name              x          y          z       roll      pitch        yaw
    TABLE         500.000     50.000   -300.000      0.000    180.000      0.000

What stands behind a # is a comment and is kept. A change writes a new file beside the old one and puts it in its place
in one step, under a lock: a reader sees all of it or nothing of it, and of two programs neither loses the other's.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError, error_text
from qrobot.model.orientation import rpy_angles
from qrobot.model.transform import rpy, transform
from qrobot.realtime.file_lock import lock_alone
from qrobot.units import DEG_PER_RAD, M_PER_MM, MM_PER_M, RAD_PER_DEG
from qrobot.whole_file import probe_file, probe_folder, replace_file

_COLUMNS: Final = ("x", "y", "z", "roll", "pitch", "yaw")
PATIENCE_S: Final = 5.0  # with somebody else who writes the file, which takes a second on a slow disk
_LOOK_S: Final = 0.02
HEADING: Final = "# name         " + " ".join(f"{column:>12}" for column in _COLUMNS)


class TransformFile:
    """Transforms by name.

    Args:
        path: of the file; it need not exist yet.
    """

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)

    def names(self) -> list[str]:
        """Names of all transforms, as they stand in the file. Raises ConfigError: a line cannot be read."""
        return list(self.values())

    def values(self) -> dict[str, Floats]:
        """Poses by name, shape (4, 4), m, as they stand in the file.

        Raises:
            ConfigError: a line cannot be read, or has the name of one before it.
        """
        values: dict[str, Floats] = {}
        for i, line in enumerate(self._lines()):
            if (name := _name(line)) in values:
                raise ConfigError(f"{self._path}, line {i + 1}: {name!r} stands in a line before it; strike one")
            if name:
                values[name] = self._value(i, line)
        return values

    def check(self) -> None:
        """Raises ConfigError when a transform could not be recorded: the file cannot be read, or not be written."""
        self.values()
        if not self._path.parent.is_dir():
            raise ConfigError(f"cannot write {self._path}: is there such a folder?")
        try:
            probe_file(self._path)
            for folder in {self._path.parent, self._path.resolve().parent}:  # its lock, and what takes its place
                probe_folder(folder)
        except OSError as error:
            raise ConfigError(f"cannot write {self._path}: {error_text(error)}") from error

    def write(self, name: str, value: Floats) -> None:
        """Put a pose, shape (4, 4), m, under a name; one of the same name is replaced.

        Raises:
            ConfigError: the name cannot stand in the file, the file cannot be read or written, or another program has
                kept it locked for `PATIENCE_S`.
        """
        self.write_all({name: value})

    def write_all(self, values: dict[str, Floats]) -> None:
        """Put poses under their names in one step; raises what `write` raises, and then none is written."""
        for name in values:
            if not name or any(letter.isspace() or letter == "#" for letter in name):
                raise ConfigError(f"{self._path}: a name without spaces and # is needed, not {name!r}")

        def replace(lines: list[str]) -> list[str]:
            for name, value in values.items():
                lines = _with_line(lines, name, _line(name, value))
            return lines

        self._change(replace)

    def remove(self, name: str) -> None:
        """Strike out a transform. Raises ConfigError: there is none."""
        if name not in self.values():
            raise ConfigError(f"{self._path}: no transform {name!r}")
        self._change(lambda lines: [line for line in lines if _name(line) != name])

    def _lines(self) -> list[str]:
        try:
            return self._path.read_text(encoding="utf-8-sig").splitlines() if self._path.exists() else []
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"cannot read {self._path}: {error_text(error)}") from error

    def _value(self, index: int, line: str) -> Floats:
        words = line.partition("#")[0].split()[1:]
        try:
            x, y, z, *angles = (float(word) for word in words)
            roll, pitch, yaw = (angle * RAD_PER_DEG for angle in angles)
            if not np.isfinite([x, y, z, *angles]).all():
                raise ValueError(line)
        except ValueError as error:
            wanted = "a name and six numbers: x y z in mm, roll pitch yaw in degrees"
            raise ConfigError(f"{self._path}, line {index + 1}: {wanted}, not {line.strip()!r}") from error
        return transform(rpy(roll, pitch, yaw), [x * M_PER_MM, y * M_PER_MM, z * M_PER_MM])

    def _change(self, edit: Callable[[list[str]], list[str]]) -> None:
        try:
            with self._lock():
                self.values()  # what cannot be read is not written over
                self._write(edit(self._lines() or [HEADING]))
        except OSError as error:
            raise ConfigError(f"cannot write {self._path}: {error.strerror}") from error

    def _write(self, lines: list[str]) -> None:
        replace_file(self._path, "\n".join(lines) + "\n")

    @contextmanager
    def _lock(self) -> Iterator[None]:
        """One writer at a time; the kernel takes the lock from a program that dies."""
        place = self._path.with_name(self._path.name + ".lock")
        with place.open("w") as file:
            looks = round(PATIENCE_S / _LOOK_S)
            while not lock_alone(file):
                if not looks:
                    raise ConfigError(f"another program has kept {place} locked for {PATIENCE_S:g} s: is one halted?")
                looks -= 1
                _rest()
            yield


def _rest() -> None:
    """Wait for the next look at a lock that another program has."""
    time.sleep(_LOOK_S)


def _with_line(lines: list[str], name: str, line: str) -> list[str]:
    """The lines with `line` in place of that of the same name, whose comment stays, or at their end."""
    at = next((i for i, old in enumerate(lines) if _name(old) == name), None)
    return [*lines, line] if at is None else [*lines[:at], line + _comment(lines[at]), *lines[at + 1 :]]


def _name(line: str) -> str:
    words = line.partition("#")[0].split()
    return words[0] if words else ""


def _comment(line: str) -> str:
    text = line.partition("#")[2]
    return f"  #{text}" if text else ""


def _line(name: str, value: Floats) -> str:
    angles = np.array(rpy_angles(value[:3, :3])) * DEG_PER_RAD
    numbers = [*(value[:3, 3] * MM_PER_M), *angles]
    return f"{name:<14} " + " ".join(f"{number + 0.0:12.6f}" for number in numbers)
