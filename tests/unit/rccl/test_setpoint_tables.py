"""Setpoints as tables of other programs: Parquet there and back, plain CSV, and tables that are no setpoints."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from qrobot.config import load_robot
from qrobot.errors import ConfigError
from qrobot.rccl.setpoint_tables import read_setpoint_table, write_setpoint_table
from qrobot.rccl.setpoints import Setpoints

ROBOT = load_robot("puma560")
SWING = np.random.default_rng(3).uniform(-1.0, 1.0, (50, 6))
NUMBERED = ",".join(["t_s", *(f"q{j + 1}" for j in range(6))])


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_setpoints_come_back_with_robot_and_period(tmp_path: Path, suffix: str) -> None:
    written = Setpoints("stanford", 28_000, SWING)
    write_setpoint_table(tmp_path / f"s{suffix}", written)
    again = read_setpoint_table(tmp_path / f"s{suffix}", ROBOT)
    assert (again.robot, again.period_us) == ("stanford", 28_000)
    np.testing.assert_allclose(again.q, SWING, rtol=1e-11)


@pytest.mark.parametrize("header", [NUMBERED, ",".join(["t_s", *ROBOT.joint_names])])
def test_a_table_of_another_program_is_of_the_arm_it_is_sent_to(tmp_path: Path, header: str) -> None:
    rows = np.column_stack([5.0 + np.arange(50) * 0.004, SWING])
    path = tmp_path / "table.csv"
    path.write_text("\n".join([header, *(",".join(map(repr, row)) for row in rows.tolist())]))
    read = read_setpoint_table(path, ROBOT)
    assert (read.robot, read.period_us) == ("puma560", 4000)
    np.testing.assert_array_equal(read.q, SWING)
    names = header.split(",")
    others = pa.table({"note": ["x"] * 50, **dict(zip(names, rows.T, strict=True))})
    pq.write_table(others, tmp_path / "table.parquet")
    read = read_setpoint_table(tmp_path / "table.parquet", ROBOT)
    assert (read.robot, read.period_us) == ("puma560", 4000)
    np.testing.assert_array_equal(read.q, SWING)


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        ([NUMBERED.replace("q6", "q7"), "0,1,2,3,4,5,6"], "wanted are columns t_s"),
        ([NUMBERED, "0,1,2,3,4,5,6"], "two setpoints at least"),
        ([NUMBERED], "no setpoints"),
        ([NUMBERED, "0,1,2,3,4,5,6", "0.01,1,2,3,4,5,x"], "lines of numbers"),
        ([NUMBERED, "0,1,2,3,4,5,6", "0.01,1,2,3,4,5"], "lines of numbers"),
        ([NUMBERED, "0,1,2,3,4,5,6", "0.01,1,2,3,4,5,nan"], "finite"),
        ([NUMBERED, "0,1,2,3,4,5,6", "0.01,1,2,3,4,5,6", "0.03,1,2,3,4,5,6"], "off the even steps"),
        ([NUMBERED, "0,1,2,3,4,5,6", "0.5,1,2,3,4,5,6"], "1000 to 100000"),
        ([NUMBERED, "0,1,2,3,4,5,6", "0,1,2,3,4,5,6"], "1000 to 100000"),
        ([NUMBERED + ",more", "0,1,2,3,4,5,6", "0.01,1,2,3,4,5,6"], "8 names, but 7 numbers"),
        (["# something else"], "line 1: not a setpoint file"),
        (
            ["# qrobot setpoints 1", "# robot puma560", "# period_us " + "9" * 5000, NUMBERED],
            "not '99999999999999999999'",
        ),
        ([NUMBERED, "# 1", "# 2"], "lines of numbers"),
        ([NUMBERED + ",q7", "0,1,2,3,4,5,6,7", "0.01,1,2,3,4,5,6,7"], "has a column q7, and puma560 has 6 joints"),
        ([NUMBERED + ",q1", "0,1,2,3,4,5,6,1", "0.01,1,2,3,4,5,6,1"], "two columns are called q1"),
        ([NUMBERED, "-1e308,1,2,3,4,5,6", "1e308,1,2,3,4,5,6"], "inf us apart"),
        ([NUMBERED, "0,1,2,3,4,5,6", "1e308,1,2,3,4,5,6"], "inf us apart"),
        ([NUMBERED, "0.01,1,2,3,4,5,6", "0,1,2,3,4,5,6"], "-10000 us apart"),
        ([NUMBERED, "0,1,2,3,4,5,6", "0.01,1,2,3,4,5,1e400"], "finite"),
        ([""], "no setpoints"),
    ],
)
def test_a_table_that_is_none_is_refused(tmp_path: Path, lines: list[str], told: str) -> None:
    (tmp_path / "t.csv").write_text("\n".join(lines))
    with pytest.raises(ConfigError, match=told):
        read_setpoint_table(tmp_path / "t.csv", ROBOT)


COLUMNS = {name: np.arange(5) * 0.01 for name in NUMBERED.split(",")}


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({name: ["a"] * 5 for name in COLUMNS}, "not all numbers: t_s is of string"),
        ({"q1": ["1.0"] * 5}, "not all numbers: q1 is of string"),
        ({"q1": [True] * 5}, "not all numbers: q1 is of bool"),
        ({"q1": pa.array([1] * 5, pa.date32())}, "not all numbers: q1 is of date32"),
        ({"q1": [[1.0]] * 5}, "not all numbers: q1 is of list<"),
        ({"t_s": pa.array(range(5), pa.duration("ms"))}, "not all numbers: t_s is of duration"),
        ({"q1": pa.nulls(5)}, "not all numbers: q1 is of null"),
        ({"q1": pa.array([1, None, 1, 1, 1])}, "finite"),
        ({"q1": [np.inf] * 5}, "finite"),
        ({"t_s": [-1e308, 0.0, 0.0, 0.0, 1e308]}, "inf us apart"),
        ({"t_s": [0.0, 0.01, 0.01, 0.03, 0.04]}, "off the even steps"),
        ({"t_s": np.arange(5)[::-1] * 0.01}, "-10000 us apart"),
    ],
)
def test_a_parquet_file_with_other_columns_is_refused(tmp_path: Path, changed: dict[str, Any], told: str) -> None:
    pq.write_table(pa.table(COLUMNS | changed), tmp_path / "t.parquet")
    with pytest.raises(ConfigError, match=told):
        read_setpoint_table(tmp_path / "t.parquet", ROBOT)


def test_what_is_no_file_of_its_kind_is_refused_and_what_a_spreadsheet_adds_is_not(tmp_path: Path) -> None:
    table = pa.table(COLUMNS)
    twice = pa.Table.from_arrays([*table.columns, table.column("q1")], names=[*COLUMNS, "q1"])
    pq.write_table(twice, tmp_path / "twice.parquet")
    for name, told in ((b"a\nb", "no name"), (b"\x1b[31m", "no name")):
        pq.write_table(table.replace_schema_metadata({b"qrobot:robot": name}), tmp_path / "n.parquet")
        with pytest.raises(ConfigError, match=told):
            read_setpoint_table(tmp_path / "n.parquet", ROBOT)
    (tmp_path / "r.parquet").write_bytes(bytes(range(256)))
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    for folder in ("f.parquet", "f.csv"):
        (tmp_path / folder).mkdir()
    pq.write_table(table, tmp_path / "f.parquet" / "inside.parquet")
    told_of = {"r.parquet": "cannot read", "b.csv": "cannot read", "f.csv": "Is a directory"}
    told_of |= {"f.parquet": "Is a directory", "none.parquet": "No such file", "twice.parquet": "two columns"}
    told_of |= {"none.csv": "none.csv: No such file or directory$"}
    for file, told in told_of.items():
        with pytest.raises(ConfigError, match=told):
            read_setpoint_table(tmp_path / file, ROBOT)
    pq.write_table(table.replace_schema_metadata({b"qrobot:period_us": b"9" * 5000}), tmp_path / "p.parquet")
    assert read_setpoint_table(tmp_path / "p.parquet", ROBOT).period_us == 10_000
    write_setpoint_table(tmp_path / "s.csv", Setpoints("puma560", 10_000, SWING))
    (tmp_path / "s.csv").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "s.csv").read_bytes())
    assert read_setpoint_table(tmp_path / "s.csv", ROBOT).period_us == 10_000


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_damaged_tables_get_an_error_of_ours_or_are_read(tmp_path: Path, suffix: str) -> None:
    path, draw, refused = tmp_path / f"t{suffix}", np.random.default_rng(2), 0
    write_setpoint_table(path, Setpoints("puma560", 10_000, SWING[:10]))
    whole = path.read_bytes()
    for _ in range(200):
        damaged = bytearray(whole)
        for place in draw.integers(0, len(whole), int(draw.integers(1, 6))):
            damaged[place] = int(draw.integers(0, 256))
        path.write_bytes(bytes(damaged[: int(draw.integers(0, len(whole) + 1))] if draw.random() < 0.2 else damaged))
        try:
            assert np.isfinite(read_setpoint_table(path, ROBOT).q).all()
        except ConfigError:
            refused += 1
    assert 100 < refused < 200


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_table_that_cannot_be_written_leaves_the_old_one_whole(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"t{suffix}"
    write_setpoint_table(path, Setpoints("puma560", 10_000, SWING))
    before = path.read_bytes()

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigError, match=r"cannot write .*: No space left on device"):
        write_setpoint_table(path, Setpoints("puma560", 10_000, SWING[:3]))
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(ConfigError, match="cannot write"):
        write_setpoint_table(tmp_path / "nowhere" / path.name, Setpoints("puma560", 10_000, SWING[:3]))
