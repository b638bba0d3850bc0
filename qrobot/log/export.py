"""Logs as tables for other programs: CSV for everyone, Parquet for data frames. One row per cycle."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config.scene import FORCE_AXES
from qrobot.errors import LogError, error_text
from qrobot.extras import missing_library
from qrobot.log.read import Log
from qrobot.printable import csv_line
from qrobot.servo.memory.telemetry import ADDED, ARRAYS, COUNTERS, FACTORS, LINES, SCALARS, TERMS, VECTORS
from qrobot.whole_file import written_whole

ANGULAR_UNITS: Final = {
    "q_ref": "rad", "v_ref": "rad_s", "a_ref": "rad_s2", "q": "rad", "v": "rad_s", "tau": "Nm", "gravity": "Nm",
    "friction": "Nm",
}  # fmt: skip
LINEAR_UNITS: Final = {
    "q_ref": "m", "v_ref": "m_s", "a_ref": "m_s2", "q": "m", "v": "m_s", "tau": "N", "gravity": "N", "friction": "N",
}  # fmt: skip
PAYLOAD_AXES: Final = ("xx", "yy", "zz", "xy", "xz", "yz")  # of an inertia
_CSV_ROWS: Final = 10_000  # turned into text at a time


def table_columns(log: Log) -> dict[str, NDArray[Any]]:
    """Columns by name: the scalars of a row, then each vector joint by joint with its unit, e.g. `q_ref_elbow_rad`."""
    columns = {name: log.rows[name] for name, _ in SCALARS}
    for name, _ in (*VECTORS, *TERMS):
        for j, joint in enumerate(log.header.joint_names):
            unit = (LINEAR_UNITS if log.header.is_prismatic(j) else ANGULAR_UNITS)[name]
            columns[f"{name}_{joint}_{unit}"] = log.rows[name][:, j]
    for name, _ in COUNTERS:
        for j, joint in enumerate(log.header.joint_names):
            columns[f"{name}_{joint}"] = log.rows[name][:, j]
    for name, length, _ in ARRAYS:
        for k, suffix in enumerate(_suffixes(log, name, length)):
            columns[f"{name}_{suffix}"] = log.rows[name][:, k]
    columns |= {name: log.rows[name] for name, _ in LINES}
    for name, length, _ in ADDED:
        for k, suffix in enumerate(_suffixes(log, name, length)):
            columns[f"{name}_{suffix}"] = log.rows[name][:, k]
    columns |= {name: log.rows[name] for name, _ in FACTORS}
    return columns


def _suffixes(log: Log, name: str, length: int) -> tuple[str, ...]:
    """Suffixes that tell the columns of an array apart, with the unit."""
    if name == "force":
        return tuple(f"{axis}_{'N' if axis.startswith('f') else 'Nm'}" for axis in FORCE_AXES)
    if name == "payload":
        return ("kg", *(f"{axis}_kgm" for axis in "xyz"), *(f"{axes}_kgm2" for axes in PAYLOAD_AXES))
    names = {"signals": log.signal_names, "program_signals": log.program_signal_names}
    told = names.get(name, ())
    return (*told, *(f"{k}_V" if name == "volts" else str(k + 1) for k in range(len(told), length)))


def export_csv(log: Log, path: Path) -> None:
    """Write a CSV file; numbers keep every bit. Raises LogError when the file cannot be written."""
    columns = table_columns(log)
    try:
        with written_whole(path) as place, place.open("w", encoding="utf-8", newline="\n") as file:
            file.write(csv_line(columns) + "\n")
            for start in range(0, log.rows.size, _CSV_ROWS):
                block = [column[start : start + _CSV_ROWS].tolist() for column in columns.values()]
                file.writelines(",".join(map(repr, row)) + "\n" for row in zip(*block, strict=True))
    except OSError as error:
        raise LogError(f"cannot write {path}: {error.strerror}") from None


def export_parquet(log: Log, path: Path) -> None:
    """Write a Parquet file, zstd, floats byte-stream split.

    Raises LogError when the file cannot be written or pyarrow is not installed.
    """
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise LogError(f"{missing_library('pyarrow')}, or export to CSV") from None
    columns = {name: np.ascontiguousarray(column) for name, column in table_columns(log).items()}
    floats = [name for name, column in columns.items() if column.dtype.kind == "f"]
    try:
        with written_whole(path) as place:
            pq.write_table(
                pa.table(columns), place, compression="zstd", use_dictionary=False,
                column_encoding=None, use_byte_stream_split=floats,
            )  # fmt: skip
    except OSError as error:
        raise LogError(f"cannot write {path}: {error_text(error)}") from None
