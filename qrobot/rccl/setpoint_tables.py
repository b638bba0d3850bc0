"""Setpoints as tables of other programs: Parquet both ways, and CSV without the head of a setpoint file.

A table has a column `t_s`, seconds at even steps, and one for each joint in rad or m: `q1`, `q2` and so on, or the
joints' own names. A Parquet file of ours tells robot and period besides, as metadata of its schema.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.robot import Robot
from qrobot.errors import ConfigError, error_text
from qrobot.rccl.setpoints import (
    ENCODING,
    FIRST_LINE,
    Setpoints,
    is_name,
    read_setpoints,
    told_period_us,
    write_setpoints,
)
from qrobot.whole_file import replace_bytes
from qrobot.wire.vocabulary import LONGEST_PERIOD_US, SHORTEST_PERIOD_US

TIME: Final = "t_s"
PARQUET: Final = ".parquet"
_ROBOT, _PERIOD = b"qrobot:robot", b"qrobot:period_us"
_JOINT: Final = re.compile(r"q([1-9][0-9]*)")
_UNEVEN: Final = 0.1  # of a period, by which a time may be off its place [A]


def read_setpoint_table(path: Path, robot: Robot) -> Setpoints:
    """Read a setpoint file, a Parquet file or a plain CSV table for `robot`.

    Raises:
        ConfigError: it cannot be read, has other columns or uneven times, or pyarrow is not installed for Parquet.
    """
    if path.suffix.lower() == PARQUET:
        return _read_parquet(path, robot)
    try:
        lines = path.read_text(encoding=ENCODING).split("\n")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read {path}: {error_text(error)}") from error
    return read_setpoints(path) if lines[0].startswith(FIRST_LINE[0]) else _read_csv(path, lines, robot)


def write_setpoint_table(path: Path, setpoints: Setpoints) -> None:
    """Write a setpoint file, or Parquet by the suffix. Raises ConfigError when that fails."""
    if path.suffix.lower() != PARQUET:
        write_setpoints(path, setpoints)
        return
    pa, pq = _pyarrow()
    whole = pa.BufferOutputStream()
    columns = {TIME: setpoints.t} | {f"q{j + 1}": np.ascontiguousarray(q) for j, q in enumerate(setpoints.q.T)}
    metadata = {_ROBOT: setpoints.robot.encode(), _PERIOD: str(setpoints.period_us).encode()}
    try:
        pq.write_table(pa.table(columns).replace_schema_metadata(metadata), whole)
        replace_bytes(path, whole.getvalue().to_pybytes())
    except OSError as error:
        raise ConfigError(f"cannot write {path}: {error.strerror}") from None


def _read_parquet(path: Path, robot: Robot) -> Setpoints:
    pa, pq = _pyarrow()
    try:
        with path.open("rb") as file, pq.ParquetFile(file) as parquet:
            table = parquet.read()
        names = table.column_names
    except (OSError, pa.ArrowException, UnicodeDecodeError) as error:
        raise ConfigError(f"cannot read {path}: {error_text(error)}") from error
    columns = dict(_parquet_columns(path, pa, table, _chosen(path, names, robot)))
    told = table.schema.metadata or {}
    period = told.get(_PERIOD, b"").decode(errors="replace")
    return _setpoints(path, columns, told.get(_ROBOT, b"").decode(errors="replace"), period, robot)


def _parquet_columns(path: Path, pa: Any, table: Any, places: Mapping[str, int]) -> Iterator[tuple[str, Any]]:
    """Columns of numbers. Raises ConfigError for others: a date or a truth value is no position."""
    for name, place in places.items():
        column = table.column(place)
        if not any(
            of_type(column.type) for of_type in (pa.types.is_floating, pa.types.is_integer, pa.types.is_decimal)
        ):
            raise ConfigError(f"{path}: its columns are not all numbers: {name} is of {column.type}")
        yield name, column.to_numpy()


def _pyarrow() -> tuple[Any, Any]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    return pa, pq


def _read_csv(path: Path, lines: list[str], robot: Robot) -> Setpoints:
    names, rest = [name.strip() for name in lines[0].split(",")], [line for line in lines[1:] if line.strip()]
    if not rest:
        raise ConfigError(f"{path}: no setpoints")
    try:
        numbers = np.loadtxt(rest, delimiter=",", ndmin=2, comments=None)
    except ValueError as error:
        raise ConfigError(
            f"{path}: {str(error).rstrip('.')}; wanted are a line of names and lines of numbers"
        ) from None
    if numbers.shape[1] != len(names):
        raise ConfigError(f"{path}: {len(names)} names, but {numbers.shape[1]} numbers in a line")
    columns = {name: numbers[:, place] for name, place in _chosen(path, names, robot).items()}
    return _setpoints(path, columns, "", "", robot)


def _chosen(path: Path, names: Sequence[str], robot: Robot) -> dict[str, int]:
    """Places of the columns that setpoints may be made of.

    Raises ConfigError: two have one name, or there are more joints than the robot has: it is another one's.
    """
    more = sorted(name for name in names if (found := _JOINT.fullmatch(name)) and int(found[1]) > robot.n)
    if more and set(_numbered(robot)) <= set(names):
        raise ConfigError(f"{path}: it has a column {more[0]}, and {robot.name} has {robot.n} joints")
    wanted = {TIME, *robot.joint_names, *_numbered(robot)} & set(names)
    if twice := sorted(name for name in wanted if names.count(name) > 1):
        raise ConfigError(f"{path}: two columns are called {twice[0]}")
    return {name: names.index(name) for name in names if name in wanted}


def _numbered(robot: Robot) -> list[str]:
    return [f"q{j + 1}" for j in range(robot.n)]


def _setpoints(path: Path, columns: Mapping[str, Any], name: str, period: str, robot: Robot) -> Setpoints:
    """Setpoints of columns, each of shape (samples,)."""
    for joints in (_numbered(robot), list(robot.joint_names)):
        if {TIME, *joints} <= set(columns):
            break
    else:
        wanted = ", ".join(_numbered(robot))
        raise ConfigError(f"{path}: wanted are columns {TIME} and {wanted}, or {TIME} and the names of the joints")
    try:
        q = np.column_stack([np.asarray(columns[joint], dtype=np.float64) for joint in joints])
        t = np.asarray(columns[TIME], dtype=np.float64)
    except (TypeError, ValueError):
        raise ConfigError(f"{path}: its columns are not all numbers") from None
    if not (np.isfinite(q).all() and np.isfinite(t).all()):
        raise ConfigError(f"{path}: every number must be finite")
    if name and not is_name(name):
        raise ConfigError(f"{path}: it is for a robot called {name!r}, which is no name")
    return Setpoints(name or robot.name, _period_us(path, t, period), q)


def _period_us(path: Path, t: Floats, told: str) -> int:
    """The period told, or that of the times. Raises ConfigError when times are uneven or too near or far."""
    if t.size < 2:
        raise ConfigError(f"{path}: two setpoints at least are needed to know their period")
    with np.errstate(over="ignore"):
        step_us, since = float(t[-1] - t[0]) / (t.size - 1) * 1e6, t - t[0]
    period_us = told_period_us(told) or (round(step_us) if abs(step_us) < 2 * LONGEST_PERIOD_US else 0)
    if not SHORTEST_PERIOD_US <= period_us <= LONGEST_PERIOD_US:
        allowed = f"{SHORTEST_PERIOD_US} to {LONGEST_PERIOD_US} us are possible"
        raise ConfigError(f"{path}: its setpoints are {period_us or step_us:.6g} us apart; {allowed}")
    off = np.abs(since - np.arange(t.size) * (period_us * 1e-6))
    if (uneven := int(np.argmax(off > _UNEVEN * period_us * 1e-6))) or off[0] > 0.0:
        raise ConfigError(f"{path}: setpoint {uneven + 1} is at {t[uneven]:g} s, off the even steps of {period_us} us")
    return period_us
