"""Setpoints as tables of other programs: Parquet there and back, plain CSV, and tables that are no setpoints."""

from __future__ import annotations

from pathlib import Path

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
        ([""], "no setpoints"),
    ],
)
def test_a_table_that_is_none_is_refused(tmp_path: Path, lines: list[str], told: str) -> None:
    (tmp_path / "t.csv").write_text("\n".join(lines))
    with pytest.raises(ConfigError, match=told):
        read_setpoint_table(tmp_path / "t.csv", ROBOT)


def test_a_parquet_file_of_words_or_of_rubbish_is_refused(tmp_path: Path) -> None:
    (tmp_path / "r.parquet").write_bytes(bytes(range(256)))
    with pytest.raises(ConfigError, match="cannot read"):
        read_setpoint_table(tmp_path / "r.parquet", ROBOT)
    pq.write_table(pa.table({name: ["a", "b"] for name in NUMBERED.split(",")}), tmp_path / "w.parquet")
    with pytest.raises(ConfigError, match="not all numbers"):
        read_setpoint_table(tmp_path / "w.parquet", ROBOT)
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="cannot read"):
        read_setpoint_table(tmp_path / "b.csv", ROBOT)
