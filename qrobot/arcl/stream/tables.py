"""Joint and Cartesian setpoints of a stream as tables: `jtraj` and `ctraj` of the paper, for other programs.

| ending of the file | form |
|---|---|
| `.csv` | text, numbers with every bit |
| `.parquet` | data frames (needs pyarrow) |
| `.npy`, `.npz` | NumPy: one table, or an array per column |
| `.mat` | MATLAB, level 4 of its format: a variable per column |
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from qrobot.arcl.stream.layout import RecordKind
from qrobot.arcl.stream.reader import Stream
from qrobot.arrays import Floats
from qrobot.errors import ConfigError
from qrobot.extras import missing_library
from qrobot.model.orientation import euler_angles, oat_angles, rpy_angles
from qrobot.model.transform import quaternion, so3_log
from qrobot.units import DEG_PER_RAD, MM_PER_M
from qrobot.whole_file import written_whole

TrajectoryTable = dict[str, Floats]
"""Columns by name, each of shape (rows,)."""

_POSITION: Final = ("x_mm", "y_mm", "z_mm")


def _degrees(angles: Any) -> list[float]:
    return [float(angle) * DEG_PER_RAD for angle in angles]


ORIENTATIONS: Final[dict[str, tuple[tuple[str, ...], Callable[[Floats], list[float]]]]] = {
    "rpy": (("roll_deg", "pitch_deg", "yaw_deg"), lambda R: _degrees(rpy_angles(R))),
    "euler": (("phi_deg", "theta_deg", "psi_deg"), lambda R: _degrees(euler_angles(R))),
    "oat": (("o_deg", "a_deg", "t_deg"), lambda R: _degrees(oat_angles(R))),
    "rotvec": (("rx_deg", "ry_deg", "rz_deg"), lambda R: _degrees(so3_log(R))),
    "quat": (("qs", "qx", "qy", "qz"), lambda R: list(quaternion(R))),
    "matrix": (tuple(f"{axis}{row}" for axis in "noa" for row in "xyz"), lambda R: R.T.ravel().tolist()),
}
"""How a Cartesian table tells orientations: columns, and the numbers of a rotation matrix."""


def joint_table(stream: Stream, measured: bool = False) -> TrajectoryTable:
    """Time, s, and joint setpoints, degrees (mm on a sliding joint); or measured positions.

    Raises ConfigError: none was measured.
    """
    kinds = stream.start.structure
    times, rows = stream.table(RecordKind.MEASURED if measured else RecordKind.JOINTS, stream.start.n)
    if measured and not len(times):
        raise ConfigError(f"no joint positions were measured: the machine was {stream.start.machine}")
    names = [f"j{i + 1}_{'mm' if kind == 'P' else 'deg'}" for i, kind in enumerate(kinds)]
    scales = np.array([MM_PER_M if kind == "P" else DEG_PER_RAD for kind in kinds])
    return {"t_s": times} | dict(zip(names, (rows * scales).T.copy(), strict=True))


def cartesian_table(stream: Stream, orientation: str = "rpy") -> TrajectoryTable:
    """Time, s, position of T6, mm, and its orientation in one of the forms of `ORIENTATIONS`.

    Raises:
        ConfigError: no such form.
    """
    if orientation not in ORIENTATIONS:
        raise ConfigError(f"no form of orientations {orientation!r}; there are {', '.join(ORIENTATIONS)}")
    names, form = ORIENTATIONS[orientation]
    times, rows = stream.table(RecordKind.CARTESIAN, 12)
    poses = rows.reshape(-1, 4, 3)
    turns = np.array([form(np.ascontiguousarray(pose[:3].T)) for pose in poses]).reshape(-1, len(names))
    columns = np.hstack((poses[:, 3] * MM_PER_M, turns))
    return {"t_s": times} | dict(zip((*_POSITION, *names), columns.T.copy(), strict=True))


def table_text(table: TrajectoryTable) -> str:
    """A table for people."""
    head = " ".join(f"{name:>12}" for name in table)
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    return "\n".join([head, *(" ".join(f"{number + 0.0:12.4f}" for number in row) for row in rows)]) + "\n"


def write_table(table: TrajectoryTable, path: Path) -> None:
    """Write a table in the form that the file's ending names. Raises ConfigError: no such form, or it cannot."""
    if (suffix := path.suffix.lower()) not in _FORMS:
        raise ConfigError(f"{path}: a table is written as {', '.join(_FORMS)}")
    if suffix == ".parquet":
        _pyarrow()  # before what is there is overwritten
    try:
        with written_whole(path) as place, place.open("wb") as file:
            _FORMS[suffix](table, file)
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from error


def _csv(table: TrajectoryTable, file: IO[bytes]) -> None:
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    file.write((",".join(table) + "\n").encode())
    file.writelines((",".join(map(repr, row)) + "\n").encode() for row in rows)


def _pyarrow() -> Any:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise ConfigError(f"{missing_library('pyarrow')}, or write CSV") from None
    return pa, pq


def _parquet(table: TrajectoryTable, file: IO[bytes]) -> None:
    pa, pq = _pyarrow()
    pq.write_table(pa.table(table), file)


def _npy(table: TrajectoryTable, file: IO[bytes]) -> None:
    np.save(file, np.column_stack(list(table.values())))


def _npz(table: TrajectoryTable, file: IO[bytes]) -> None:
    columns: dict[str, Any] = dict(table)
    np.savez(file, **columns)


def _mat(table: TrajectoryTable, file: IO[bytes]) -> None:
    """MAT-file level 4 (The MathWorks, "MAT-File Format"): type 0, rows, columns, no imaginary part, name, numbers."""
    for name, column in table.items():
        label = name.encode() + b"\0"
        file.write(struct.pack("<5i", 0, column.size, 1, 0, len(label)) + label + column.astype("<f8").tobytes())


_FORMS: Final[dict[str, Callable[[TrajectoryTable, IO[bytes]], None]]] = {
    ".csv": _csv, ".parquet": _parquet, ".npy": _npy, ".npz": _npz, ".mat": _mat,
}  # fmt: skip
