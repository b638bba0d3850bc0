"""Recordings small enough to ship: of a log, what identification needs, in a few hundred kilobytes.

Counts and DAC words are kept exactly, and so are the measured positions, which follow from them. What was desired is
rounded: its position to a count, its velocity and acceleration to `STEP`, far finer than what they are looked at for.
Whole numbers that change little from row to row are kept as differences, in an archive of NumPy's (.npz).
"""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Ints
from qrobot.config import Robot, load_robot
from qrobot.config.document import packaged_path
from qrobot.config.kinds import FileKind
from qrobot.errors import ConfigError, IdentificationError
from qrobot.model.transmission import counts_to_joint, joint_to_counts, transmission_params
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout

FOLDER: Final = "data"
ENDING: Final = ".npz"
STEP: Final = {"v_ref": 1e-4, "a_ref": 1e-2}  # rad/s (m/s), rad/s2 (m/s2)
WHOLE: Final = ("tick", "mode", "flags", "counts", "dac")
WIDTHS: Final = (np.int8, np.int16, np.int32, np.int64)


@dataclass(frozen=True, eq=False)
class CompactRecording:
    """Recorded motion of one arm.

    Attributes:
        robot: as its file says.
        rows: telemetry, shape (r,); fields that identification does not look at are 0.
        period_s: from row to row.
        facts: what else is known of it: how it was made and, of an emulated arm, the truth.
    """

    robot: Robot
    rows: Rows
    period_s: float
    facts: dict[str, Any]


def save_recording(path: Path, recording: CompactRecording) -> None:
    """Write what identification needs of a recording. Raises IdentificationError when the file cannot be written."""
    robot, rows = recording.robot, recording.rows
    columns = {name: rows[name] for name in WHOLE} | {"q_ref": _reference_counts(robot, rows["q_ref"])}
    columns |= {name: np.rint(rows[name] / step).astype(np.int64) for name, step in STEP.items()}
    about = {"robot": robot.name, "period_s": recording.period_s, "facts": recording.facts}
    packed: dict[str, Any] = {name: _packed(column) for name, column in columns.items()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(path, about=np.array(json.dumps(about)), **packed)
    except OSError as error:
        raise IdentificationError(f"cannot write the recording to {path}: {error.strerror}") from error


_DAMAGES: Final = (
    OSError, EOFError, LookupError, TypeError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip


def load_recording(name_or_path: str | Path) -> CompactRecording:
    """Read a recording: a path to an `.npz`, or the name of a packaged one.

    Raises:
        ConfigError: there is no such file, it is something else, or of a robot that this version does not know.
    """
    path = packaged_path(name_or_path, FileKind.RECORDING, FOLDER, ENDING)
    try:
        with np.load(path, allow_pickle=False) as archive:
            about = json.loads(str(archive["about"]))
            columns = {name: _unpacked(archive[name]) for name in (*WHOLE, "q_ref", *STEP)}
        robot = load_robot(about["robot"])
        return CompactRecording(robot, _rows(robot, columns), float(about["period_s"]), dict(about["facts"]))
    except _DAMAGES as error:
        raise ConfigError(f"{path} is no recording for identification: {error}") from error


def _rows(robot: Robot, columns: dict[str, Ints]) -> Rows:
    rows = TelemetryLayout(robot.n).empty(len(columns["tick"]))
    for name in WHOLE:
        rows[name] = columns[name]
    for name, step in STEP.items():
        rows[name] = columns[name] * step
    for name, counts in (("q", columns["counts"]), ("q_ref", columns["q_ref"])):
        rows[name] = _positions(robot, counts)
    return rows


def _positions(robot: Robot, counts: Ints) -> NDArray[np.float64]:
    """Joint positions as the servo computes them. Shape (r, n)."""
    params, q = transmission_params(robot), np.zeros(counts.shape)
    for each, at in zip(counts, q, strict=True):
        counts_to_joint(each, params, at)
    return q


def _reference_counts(robot: Robot, q: NDArray[np.float64]) -> Ints:
    """Nearest counts of joint positions (r, n)."""
    params, counts = transmission_params(robot), np.zeros(q.shape, np.int64)
    for each, nearest in zip(np.ascontiguousarray(q), counts, strict=True):
        joint_to_counts(each, params, nearest)
    return counts


def _packed(column: Ints) -> NDArray[Any]:
    """Differences from row to row in as few bits as they need, joint by joint."""
    differences = np.diff(column, axis=0, prepend=np.zeros_like(column[:1])).T
    reach = int(np.abs(differences).max(initial=0))
    return np.ascontiguousarray(differences, next(width for width in WIDTHS if reach <= np.iinfo(width).max))


def _unpacked(packed: NDArray[Any]) -> Ints:
    return np.ascontiguousarray(np.cumsum(packed.T, axis=0, dtype=np.int64))
