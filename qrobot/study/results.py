"""The file of a campaign: JSON, one line of terms and then one for each arm, in the order in which they came in.

Lines are only ever added. A run that was interrupted, or ended by a power cut, loses what had not come in: the same
command goes on from there, and one with more arms adds to them.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from qrobot.errors import ConfigError
from qrobot.realtime.file_lock import lock_alone
from qrobot.study.study import ArmResult


@dataclass(frozen=True)
class Results:
    """Contents of a file: the terms of its study, and an outcome for each arm, by seed."""

    terms: ArmResult
    outcomes: tuple[ArmResult, ...]

    @property
    def good(self) -> list[ArmResult]:
        """Outcomes of arms that did not end in an error."""
        return [outcome for outcome in self.outcomes if "failed" not in outcome]

    @property
    def failed(self) -> list[ArmResult]:
        """Outcomes of arms that did: `seed` and `failed`, the reason."""
        return [outcome for outcome in self.outcomes if "failed" in outcome]


def read_results(path: Path) -> Results:
    """Read a results file; a last line that was torn off is left out.

    Raises:
        ConfigError: there is none, or it is something else.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read results of `qrobot study` from {path}: {error}") from error
    try:
        terms, *outcomes = [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]
        by_seed = {int(outcome["seed"]): outcome for outcome in outcomes}
        if not isinstance(terms["study"], str):
            raise TypeError("the study has no name")
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise ConfigError(f"{path} is no results file of `qrobot study`") from error
    return Results(terms, tuple(by_seed[seed] for seed in sorted(by_seed)))


class ResultsWriter:
    """Adds outcomes to a results file."""

    def __init__(self, file: TextIO) -> None:
        self._file = file

    def add(self, outcome: ArmResult) -> None:
        """Put one outcome on the disk."""
        self._write(outcome)
        os.fsync(self._file.fileno())

    def _write(self, values: ArmResult) -> None:
        self._file.write(_line(values))
        self._file.flush()

    def begin(self, terms: ArmResult) -> None:
        """First line of a new file."""
        self._write(terms)


@contextmanager
def open_results(path: Path, terms: ArmResult) -> Iterator[tuple[ResultsWriter, frozenset[int]]]:
    """Begin a results file, or go on with one of the same terms: where to add, and the seeds it has already.

    Raises:
        ConfigError: it cannot be written, is of other terms, or another run is writing to it.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("a+", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot write results to {path}: {error.strerror}") from error
    with file:
        if not lock_alone(file):
            raise ConfigError(f"another run is writing to {path}: wait for it, or name another file")
        done = _go_on(file, path, terms)
        yield ResultsWriter(file), done


def _go_on(file: TextIO, path: Path, terms: ArmResult) -> frozenset[int]:
    """Seeds of what is there; a torn last line is cut off, an empty file gets its first line.

    A file without a whole line is somebody else's, unless it is a beginning of what would be written, or only zeros, as
    power cuts leave them.
    """
    data = path.read_bytes()
    whole = data.rfind(b"\n") + 1
    if not whole:
        if data.strip(b"\0") and not _line(terms).encode().startswith(data):
            raise ConfigError(f"{path} holds something else than results of `qrobot study`: name another file")
        file.truncate(0)
        ResultsWriter(file).begin(terms)
        return frozenset()
    before = read_results(path)
    if differing := sorted(key for key in {*terms, *before.terms} if terms.get(key) != before.terms.get(key)):
        raise ConfigError(f"{path} holds results of another {', '.join(differing)}: name another file")
    file.truncate(whole)
    return frozenset(outcome["seed"] for outcome in before.outcomes)


def _line(values: ArmResult) -> str:
    return json.dumps(values, separators=(",", ":")) + "\n"
