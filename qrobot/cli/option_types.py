"""Types of options whose values are checked before a command begins: numbers in a range, files that can be written.

Every number that a command takes has one of these types, and so has every path that it writes to: what cannot be done
is refused while nothing has been started, moved or computed. Defaults are checked too, for the folder they are in may
not be writable either. A file is written over only where its suffix, and its contents where several kinds share
one, say that it is of the kind that is written.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Final

from cyclopts import Parameter

from qrobot.config.deployment import LEAST_GB, MOST_GB
from qrobot.config.kinds import FileKind, kind_of_file
from qrobot.errors import ConfigError, LogError, error_text
from qrobot.extras import missing_library
from qrobot.servo.calibration.state import FEWEST_INDEXES, MOST_INDEXES
from qrobot.servo.rates import HIGHEST_RATE_HZ, LOWEST_RATE_HZ
from qrobot.whole_file import probe_file, probe_folder
from qrobot.wire.vocabulary import LARGEST_OVERRIDE

PARQUET: Final = ".parquet"
SHOWN_DIGITS: Final = 40  # of a number that is none
MOST_GAIN: Final = 1e12  # [A] above the stiffest joint by far; the servo knows what its arm bears
MOST_SEED: Final = 2**32 - 1
MOST_ARMS: Final = 1_000_000  # [A]
MOST_POSES: Final = 1_000  # [A] a plan of 24 takes minutes
MOST_WORKERS: Final = 1_024  # [A] processes of one machine
MOST_FACTOR: Final = 100.0  # [A] of a study's grid of gains
MOST_LOAD_KG: Final = 1_000.0  # [A] of a weighed load
MOST_MB: Final = 1e9  # [A]
LEAST_MB: Final = 0.1  # [A] a part of a log has a header and files of some tens of kilobytes


@dataclass(frozen=True)
class Range:
    """Refuses numbers outside of `least` to `most`, each one of several, and NaN; infinity unless it is `most`."""

    least: float
    most: float = math.inf
    unit: str = ""

    def __call__(self, _type: Any, value: float | Sequence[float] | None) -> None:
        """Raises ValueError with what is allowed."""
        for each in value if isinstance(value, Sequence) else (value,):
            if each is not None and not self.least <= each <= self.most:
                raise ValueError(f"{str(each)[:SHOWN_DIGITS]} is not allowed, only {self}")

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if self.most == math.inf:
            return f"at least {self.least:g}{unit}"
        return f"{self.least:.10g} to {self.most:.10g}{unit}"


def require_writable_file(path: Path) -> None:
    """Raise ValueError when `path` cannot be written whole; nothing is changed, and an existing file stays as it is."""
    _tell(path, _try_whole_file)


def require_growing_file(path: Path) -> None:
    """Raise ValueError when `path` cannot be written piece by piece, into a file that may be there."""
    _tell(path, _try_file)


def require_new_growing_file(path: Path) -> None:
    """The same, and when it has something in it already: what a board did does not come again."""
    _tell(path, _refuse_written)
    _tell(path, _try_file)


def require_writable_folder(path: Path) -> None:
    """Raise ValueError when there can be no files in the folder `path`; it is not made."""
    _tell(path, _try_folder)


def checked_folder(path: Path) -> Path:
    """A folder that no option named, but a file or the command itself; ConfigError when there can be no files in it."""
    return _checked(path, "folder", require_writable_folder)


def checked_file(path: Path) -> Path:
    """A file that no option named, but the command itself; ConfigError when it cannot be written."""
    return _checked(path, "file", require_writable_file)


def _checked(path: Path, kind: str, require: Callable[[Path], None]) -> Path:
    try:
        require(path)
    except ValueError as error:
        raise ConfigError(f"{error}; name another {kind}, or run the command elsewhere") from None
    return path


def require_writable_log(path: Path) -> None:
    """Raise ValueError when neither the log (.mcap) nor the folder `path` can be written.

    A log of virtual time can be made again and is written over. One of a running arm cannot, and is not.
    """
    _tell(path, _try_log if path.suffix == ".mcap" else _try_folder)


def require_new_log(path: Path) -> None:
    """Raise ValueError when `path` cannot be written, or is a log already: what an arm did does not come again."""
    _tell(path, _refuse_recorded)
    _tell(path, _try_file if path.suffix == ".mcap" else _try_folder)


@dataclass(frozen=True)
class FileOfKind:
    """Refuses a file that cannot be written, or that is of another kind by its suffix: it may be somebody's work.

    Attributes:
        what: it is, with its article.
        suffixes: in small letters.
        require: what raises ValueError when it cannot be written.
        kind: what a file with something in it has to be, where other kinds have the same suffix.
    """

    what: str
    suffixes: tuple[str, ...]
    require: Callable[[Path], None] = require_writable_file
    kind: FileKind | None = None

    def __call__(self, path: Path) -> None:
        """Raises ValueError with the suffixes that are wanted, the extra that is missing, or what it is instead."""
        if (suffix := path.suffix.lower()) not in self.suffixes:
            raise ValueError(f"cannot write {path}: {self.what} ends in {' or '.join(self.suffixes)}")
        if suffix == PARQUET and find_spec("pyarrow") is None:
            raise ValueError(missing_library("pyarrow"))
        self.require(path)
        if self.kind is not None and path.is_file() and path.stat().st_size:
            found = kind_of_file(path)
            if found is not self.kind:
                told = "something else" if found is None else found.called
                raise ValueError(f"cannot write {path}: it is {told}, not {self.kind.called}; name another file")


def require_writable_film(path: Path) -> None:
    """Raise ValueError when no film can be written to `path`: by its suffix, or for want of ffmpeg."""
    from qrobot.log.animation import check_film_file

    try:
        check_film_file(path)
    except LogError as error:
        raise ValueError(str(error)) from None
    require_writable_file(path)


def _tell(path: Path, attempt: Callable[[Path], None]) -> None:
    try:
        attempt(path)
    except OSError as error:
        raise ValueError(f"cannot write {path}: {error_text(error)}") from None


def _refuse_recorded(path: Path) -> None:
    if path.suffix == ".mcap" and _parts_written(path):
        raise OSError("it is a recording already, name another file")


def _refuse_written(path: Path) -> None:
    if path.is_file() and path.stat().st_size:
        raise OSError("there is a file of that name with something in it, name another")


def _try_log(path: Path) -> None:
    from qrobot.log.header import LOCKSTEP
    from qrobot.log.mcap_scan import header_of_part

    _try_file(path)
    for part in _parts_written(path):
        try:
            header = header_of_part(part)
        except LogError as error:
            raise OSError(f"{error}; name another file") from None
        if header is None or header.clock != LOCKSTEP:
            raise OSError("it is the recording of a running arm, name another file")


def _parts_written(path: Path) -> list[Path]:
    """Parts with something in them of the log that begins at `path`: the first ones may have been removed."""
    from qrobot.log.mcap_scan import parts_left

    return [part for part in (path, *parts_left(path)) if part.is_file() and part.stat().st_size]


def _try_file(path: Path) -> None:
    if not path.exists():
        _try_folder(path.parent)
    elif path.is_file():
        probe_file(path)
    elif path.is_dir() or not os.access(path, os.W_OK):
        raise OSError("it is a folder, and a file is wanted" if path.is_dir() else "it may not be written")


def _try_whole_file(path: Path) -> None:
    _try_file(path)
    if path.is_file():  # another one will take its place
        probe_folder(path.resolve().parent)


def _try_folder(folder: Path) -> None:
    place = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not place.is_dir():
        raise OSError(f"{place} is no folder")
    probe_folder(place)


def _each_path(require: Callable[[Path], None]) -> Callable[[Any, Path | None], None]:
    """Make a validator for Cyclopts, which passes the type, and also the value of an option that was left out."""
    return lambda _type, path: None if path is None else require(path)


OutputFile = Annotated[Path, Parameter(validator=_each_path(require_writable_file))]
OutputNewGrowing = Annotated[Path, Parameter(validator=_each_path(require_new_growing_file))]
OutputFilm = Annotated[Path, Parameter(validator=_each_path(require_writable_film))]
OutputFolder = Annotated[Path, Parameter(validator=_each_path(require_writable_folder))]
OutputLog = Annotated[Path, Parameter(validator=_each_path(require_writable_log))]
OutputNewLog = Annotated[Path, Parameter(validator=_each_path(require_new_log))]
OutputFigure = Annotated[Path, Parameter(validator=_each_path(FileOfKind("a figure", (".png", ".pdf", ".svg"))))]
OutputTable = Annotated[Path, Parameter(validator=_each_path(FileOfKind("a table", (".csv", PARQUET))))]
OutputArrays = Annotated[
    Path, Parameter(validator=_each_path(FileOfKind("a table", (".csv", PARQUET, ".npy", ".npz", ".mat"))))
]
OutputModel = Annotated[Path, Parameter(validator=_each_path(FileOfKind("a model", (".toml",), kind=FileKind.MODEL)))]
OutputRobot = Annotated[
    Path, Parameter(validator=_each_path(FileOfKind("a robot file", (".toml",), kind=FileKind.ROBOT)))
]
OutputCalibration = Annotated[
    Path, Parameter(validator=_each_path(FileOfKind("a table", (".txt",), kind=FileKind.CALIBRATION)))
]
OutputSummary = Annotated[Path, Parameter(validator=_each_path(FileOfKind("a summary", (".json",))))]
OutputPage = Annotated[Path, Parameter(validator=_each_path(FileOfKind("a page", (".html",))))]
OutputResults = Annotated[
    Path, Parameter(validator=_each_path(FileOfKind("a results file", (".jsonl",), require_growing_file)))
]

Seconds = Annotated[float, Parameter(validator=Range(0.0, unit="s"))]
RateHz = Annotated[float, Parameter(validator=Range(LOWEST_RATE_HZ, HIGHEST_RATE_HZ, "Hz"))]
Port = Annotated[int, Parameter(validator=Range(0, 65_535))]
Indexes = Annotated[int, Parameter(validator=Range(FEWEST_INDEXES, MOST_INDEXES))]
GainsOption = Annotated[list[float], Parameter(validator=Range(0.0, MOST_GAIN), consume_multiple=True)]
Factors = Annotated[tuple[float, ...], Parameter(validator=Range(0.01, MOST_FACTOR))]
Percent = Annotated[float, Parameter(validator=Range(0.0, 100.0 * LARGEST_OVERRIDE, "%"))]
Seed = Annotated[int, Parameter(validator=Range(0, MOST_SEED))]
SmoothOption = Annotated[float, Parameter(validator=Range(0.05, 100.0, "mm"))]
PosesOption = Annotated[int, Parameter(validator=Range(1, MOST_POSES))]
MoveNumber = Annotated[int, Parameter(validator=Range(1))]
ArmCount = Annotated[int, Parameter(validator=Range(1, MOST_ARMS))]
Workers = Annotated[int, Parameter(validator=Range(1, MOST_WORKERS))]
Megabytes = Annotated[float, Parameter(validator=Range(LEAST_MB, MOST_MB, "MB"))]
Gigabytes = Annotated[float, Parameter(validator=Range(LEAST_GB, MOST_GB, "GB"))]
LoadKg = Annotated[float, Parameter(validator=Range(0.0, MOST_LOAD_KG, "kg"))]
NumberList = Annotated[str, Parameter(allow_leading_hyphen=True)]  # with commas between them
StartPlace = Annotated[str, Parameter(allow_leading_hyphen=True)]  # see qrobot.config.start_place
