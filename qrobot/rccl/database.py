"""The transform data base: named transforms in a file that people can read and edit (Hayward & Paul, section 4.3).

One line for each, millimetres and degrees, after a heading that says so:

    # name              x          y          z       roll      pitch        yaw
    TABLE         500.000     50.000   -300.000      0.000    180.000      0.000

What stands behind a # is a comment and is kept. A change writes a new file beside the old one and puts it in its place
in one step, under a lock: a reader sees all of it or nothing of it, and of two programs neither loses the other's.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError
from qrobot.model.orientation import rpy_angles
from qrobot.model.transform import rpy, transform
from qrobot.motion import Trsf
from qrobot.rccl.transforms import Transform, assigntr, newtrans, varb
from qrobot.units import DEG_PER_RAD, M_PER_MM, MM_PER_M, RAD_PER_DEG

_COLUMNS: Final = ("x", "y", "z", "roll", "pitch", "yaw")
HEADING: Final = "# name         " + " ".join(f"{column:>12}" for column in _COLUMNS)


class DataBase:
    """Transforms by name.

    Args:
        path: of the file; it need not exist yet.
    """

    def __init__(self, path: str | Path) -> None:
        self._path = Path(path)

    def names(self) -> list[str]:
        """Names of all transforms, as they stand in the file. Raises ConfigError: a line cannot be read."""
        return list(self._read())

    def get(self, name: str, kind: str = varb) -> Transform:
        """The transform of that name, of kind "const", "varb" or "hold".

        Raises:
            ConfigError: there is none, or a line cannot be read.
        """
        values = self._read()
        if name not in values:
            known = ", ".join(values) or "nothing"
            raise ConfigError(f"{self._path}: no transform {name!r}; it has {known}")
        made = newtrans(name, kind)
        made.set(values[name])
        return made

    def check(self) -> None:
        """Raises ConfigError when a transform could not be recorded: the file cannot be read, or not be written."""
        self._read()
        if not os.access(self._path if self._path.exists() else self._path.parent, os.W_OK):
            raise ConfigError(f"cannot write {self._path}: is there such a folder, and may you write there?")

    def read(self, trsf: Transform) -> bool:
        """Give `trsf` the value recorded under its name; False when there is none."""
        if (value := self._read().get(trsf.name)) is None:
            return False
        assigntr(trsf, Trsf(trsf.name, value=value))
        return True

    def record(self, trsf: Trsf) -> None:
        """Put a transform, as it is now, under its name; one of the same name is replaced.

        Raises:
            ConfigError: the name cannot stand in the file, or the file cannot be read or written.
        """
        if not trsf.name or any(letter.isspace() or letter == "#" for letter in trsf.name):
            raise ConfigError(f"{self._path}: a name without spaces and # is needed, not {trsf.name!r}")
        line = _line(trsf.name, trsf.value)

        def replace(lines: list[str]) -> list[str]:
            at = next((i for i, old in enumerate(lines) if _name(old) == trsf.name), None)
            return [*lines, line] if at is None else [*lines[:at], line + _comment(lines[at]), *lines[at + 1 :]]

        self._change(replace)

    def remove(self, name: str) -> None:
        """Strike out a transform. Raises ConfigError: there is none."""
        if name not in self._read():
            raise ConfigError(f"{self._path}: no transform {name!r}")
        self._change(lambda lines: [line for line in lines if _name(line) != name])

    def _read(self) -> dict[str, Floats]:
        return {name: self._value(i, line) for i, line in enumerate(self._lines()) if (name := _name(line))}

    def _lines(self) -> list[str]:
        try:
            return self._path.read_text().splitlines() if self._path.exists() else []
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"cannot read {self._path}: {error}") from error

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
                self._read()  # what cannot be read is not written over
                self._write(edit(self._lines() or [HEADING]))
        except OSError as error:
            raise ConfigError(f"cannot write {self._path}: {error.strerror}") from error

    def _write(self, lines: list[str]) -> None:
        new = self._path.with_name(f"{self._path.name}.{os.getpid()}")
        with new.open("w") as file:
            file.write("\n".join(lines) + "\n")
            file.flush()
            os.fsync(file.fileno())
        new.replace(self._path)

    @contextmanager
    def _lock(self) -> Iterator[None]:
        """One writer at a time; the kernel takes the lock from a program that dies."""
        with self._path.with_name(self._path.name + ".lock").open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            yield


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
