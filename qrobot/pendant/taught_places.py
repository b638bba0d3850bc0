"""Places by name at the pendant: recorded, put in by their numbers, struck out. What cannot be done is told.

A change waits for the disk, and for others that write the file, and a look at the file waits for the disk. Both are
done in a thread, and pages say STOP meanwhile.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import ConfigError, QRobotError
from qrobot.model.orientation import rpy_angles
from qrobot.model.transform import rpy, transform
from qrobot.pendant.messages import PagePlace
from qrobot.transform_file import TransformFile
from qrobot.units import DEG_PER_RAD, M_PER_MM, MM_PER_M, RAD_PER_DEG

_log: Final = logging.getLogger(__name__)


class TaughtPlaces:
    """Places of one file, which is read once before anybody asks.

    Args:
        path: of the file, as `qrobot teach` has it.
        poses: names of the robot's own poses, which no place may have.
        tell: takes a line for people, from any thread; an empty one when the places are others.
    """

    def __init__(self, path: Path, poses: tuple[str, ...], tell: Callable[[str], None]) -> None:
        self._path, self._poses, self._tell = path, poses, tell
        self._changes = ThreadPoolExecutor(1, thread_name_prefix="pendant-places")  # one after the other, looks too
        self._look_due = False
        self._seen: tuple[int, ...] | None = None
        self._numbers: dict[str, list[float]] = {}  # replaced whole, for another thread reads it
        self._read_anew()

    def close(self) -> None:
        """Wait until everything that was asked for is done or refused; nothing may be asked for afterwards."""
        self._changes.shutdown()

    def numbers(self) -> dict[str, list[float]]:
        """x, y, z in mm and roll, pitch, yaw in degrees, by name; empty when the file cannot be read.

        They are those of the newest look at the file. Each call asks for another look, and `tell` is called when that
        finds other ones: every page asks at each change of anything, and each second.
        """
        if not self._look_due:
            self._look_due = True
            try:
                self._changes.submit(self._look_now)
            except RuntimeError:  # closed, or a thread cannot be started
                self._look_due = False
        return self._numbers

    def _look_now(self) -> None:
        try:
            if self._read_anew():
                self._tell("")
        except Exception:  # nobody asks the thread how it went
            _log.exception("a look at %s failed", self._path)
        finally:
            self._look_due = False

    def _read_anew(self) -> bool:
        """Read the file if it is another than it was; whether it is."""
        if (seen := self._stamp()) == self._seen:
            return False
        self._seen, self._numbers = seen, self._read()
        return True

    def _read(self) -> dict[str, list[float]]:
        try:
            values = TransformFile(self._path).values()
        except QRobotError:
            return {}
        return {name: _numbers(T) for name, T in values.items()}

    def _stamp(self) -> tuple[int, ...]:
        try:
            stat = self._path.stat()
        except OSError:
            return ()
        return (stat.st_mtime_ns, stat.st_ctime_ns, stat.st_size, stat.st_ino)

    def record(self, name: str, pose: Floats) -> None:
        """Put a pose, shape (4, 4), m, under a name; returns at once, as all that changes the file does."""
        self._change(lambda file: file.write(self._free(name), pose), f"recorded {name} in {self._path}")

    def remove(self, name: str) -> None:
        """Strike a place out."""
        self._change(lambda file: file.remove(name), f"removed {name} from {self._path}")

    def put(self, place: PagePlace) -> None:
        """Put a place under a name by its numbers; the name that it had is given up."""
        position, angles = np.array(place.numbers[:3]) * M_PER_MM, np.array(place.numbers[3:]) * RAD_PER_DEG

        def change(file: TransformFile) -> None:
            if place.instead and place.instead not in file.names():
                raise ConfigError(f"{self._path}: no place {place.instead!r}")
            if place.name != place.instead and place.name in file.names():
                raise ConfigError(f"{self._path}: there is a place {place.name!r} already")
            file.write(self._free(place.name), transform(rpy(*angles), position))
            if place.instead and place.instead != place.name:
                file.remove(place.instead)

        self._change(change, f"{place.name} is in {self._path}")

    def _free(self, name: str) -> str:
        if name in self._poses:
            raise ConfigError(f"{name!r} is a pose of the robot: choose another name")
        return name

    def _change(self, change: Callable[[TransformFile], None], done: str) -> None:
        self._changes.submit(self._change_now, change, done)

    def _change_now(self, change: Callable[[TransformFile], None], done: str) -> None:
        try:
            change(TransformFile(self._path))
            self._read_anew()
            self._tell(done)
        except QRobotError as error:
            self._tell(f"not recorded: {error}")
        except Exception as error:  # nobody asks the thread how it went
            _log.exception("a change of %s failed", self._path)
            self._tell(f"not recorded: {type(error).__name__}")


def _numbers(pose: Floats) -> list[float]:
    angles = np.array(rpy_angles(pose[:3, :3])) * DEG_PER_RAD
    return [round(float(number), 6) + 0.0 for number in [*(pose[:3, 3] * MM_PER_M), *angles]]
