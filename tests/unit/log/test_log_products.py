"""What is made of a log: numbers that follow from their definitions, tables of every bit, figures that show all."""

from __future__ import annotations

import csv
import json
import math
import os
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from qrobot.errors import LogError
from qrobot.log.export import export_csv, export_parquet, table_columns
from qrobot.log.plot import FIGURES, MAX_POINTS, errors_figure, positions_figure, save_figure, thin
from qrobot.log.read import Log
from qrobot.log.status import LogStatus
from qrobot.log.summary import tracking_summary
from qrobot.modecodes import Mode
from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.telemetry import FLAG_UNSEEN
from tests.support.log_samples import PERIOD_NS, make_header, make_rows

PNG = b"\x89PNG\r\n\x1a\n"


def make_log(n_rows: int, n: int = 6) -> Log:
    return Log(Path("run.mcap"), make_header(n), make_rows(n_rows, n))


def with_error(log: Log, amplitude: list[float]) -> Log:
    """Desired minus measured becomes +amplitude and -amplitude in turn, per joint."""
    sign = np.where(np.arange(log.rows.size) % 2, -1.0, 1.0)
    log.rows["q"] = log.rows["q_ref"] - sign[:, None] * np.array(amplitude)
    return log


def test_errors_are_those_of_the_tracking_cycles_per_joint() -> None:
    log = with_error(make_log(100, 3), [1e-3, 2e-3, 0.0])
    log.rows["mode"][80:] = Mode.HOLDING
    log.rows["q"][80:] += 1.0
    summary = tracking_summary(log)
    np.testing.assert_allclose(summary.max_abs_error, [1e-3, 2e-3, 0.0], atol=1e-15)
    np.testing.assert_allclose(summary.rms_error, [1e-3, 2e-3, 0.0], atol=1e-15)
    assert (summary.tracking_cycles, summary.cycles) == (80, 100)


def test_the_rms_of_a_single_outlier_among_n_cycles_is_its_size_over_root_n() -> None:
    log = with_error(make_log(400, 1), [0.0])
    log.rows["q"][7] = log.rows["q_ref"][7] + 0.2
    summary = tracking_summary(log)
    assert summary.max_abs_error[0] == pytest.approx(0.2)
    assert summary.rms_error[0] == pytest.approx(0.2 / 20)


def test_positions_that_were_carried_on_have_no_error() -> None:
    log = with_error(make_log(100, 2), [1e-3, 2e-3])
    log.rows["flags"][40:50] |= FLAG_UNSEEN
    log.rows["q"][40:50] = log.rows["q_ref"][40:50]
    summary = tracking_summary(log)
    np.testing.assert_allclose(summary.rms_error, [1e-3, 2e-3], atol=1e-15)
    assert (summary.tracking_cycles, summary.dropout_cycles) == (100, 10)


def test_a_log_that_never_tracked_has_no_error_instead_of_a_perfect_one() -> None:
    log = make_log(10, 2)
    log.rows["mode"] = Mode.HOLDING
    summary = tracking_summary(log)
    assert all(math.isnan(value) for value in (*summary.max_abs_error, *summary.rms_error))
    assert not (summary.max_abs_error[0] <= 5e-3)
    assert json.loads(json.dumps(summary.to_dict(), allow_nan=False))["max_abs_error"] == [None, None]


def test_an_empty_log_has_a_summary() -> None:
    summary = tracking_summary(make_log(0, 2))
    assert (summary.cycles, summary.late_cycles, summary.skipped_cycles, summary.faults) == (0, 0, 0, ())
    assert math.isnan(summary.wakeup_us.p99)


def test_a_cycle_is_late_beyond_half_a_period_and_percentiles_are_in_microseconds() -> None:
    log = make_log(1000)
    log.rows["late_ns"] = np.arange(1000) * 1000
    log.rows["late_ns"][:2] = PERIOD_NS // 2, PERIOD_NS // 2 + 1
    summary = tracking_summary(log)
    assert summary.late_cycles == 1 + (np.arange(2, 1000) * 1000 > PERIOD_NS // 2).sum()
    assert summary.wakeup_us.max == pytest.approx(999.0)
    assert summary.wakeup_us.p50 == pytest.approx(500.0, abs=1.0)
    assert summary.wakeup_us.p99 == pytest.approx(989.0, abs=1.1)


def test_skipped_cycles_are_told_from_rows_that_the_recorder_lost() -> None:
    log = make_log(100)
    log.rows["t_ns"][50:] += 3 * PERIOD_NS  # the loop left out three points of its grid
    rows = np.delete(log.rows, [10, 11, 12, 13])  # the recorder came too late for four rows
    summary = tracking_summary(replace(log, rows=rows, status=LogStatus(0, 96, 4, 0, 0)))
    assert (summary.skipped_cycles, summary.lost_rows, summary.cycles) == (3, 4, 96)


def test_faults_are_listed_once_each_in_the_order_of_time() -> None:
    log = make_log(10)
    log.rows["fault"][2], log.rows["fault"][4:7], log.rows["fault"][8] = 66, 22, 66
    assert tracking_summary(log).faults == (66, 22)


def test_csv_keeps_every_bit_under_names_with_units(tmp_path: Path) -> None:
    log = make_log(25, 2)
    log = replace(log, header=replace(log.header, prismatic=(False, True)))
    export_csv(log, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert len(table) == 25
    for k, record in enumerate(table):
        assert int(record["t_ns"]) == log.rows["t_ns"][k]
        assert float(record["q_ref_joint1_rad"]) == log.rows["q_ref"][k, 0]
        assert float(record["v_joint2_m_s"]) == log.rows["v"][k, 1]
        assert float(record["tau_joint2_N"]) == log.rows["tau"][k, 1]
        assert int(record["counts_joint2"]) == log.rows["counts"][k, 1]


def test_names_of_joints_with_commas_and_quotes_stay_columns_of_their_own(tmp_path: Path) -> None:
    log = make_log(3, 2)
    log = replace(log, header=replace(log.header, joint_names=("arm, left", 'the "wrist"')))
    export_csv(log, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert list(table[0]) == list(table_columns(log))
    assert float(table[2]['tau_the "wrist"_Nm']) == log.rows["tau"][2, 1]


@pytest.mark.parametrize("n", [1, 6, 9])
def test_a_table_has_one_column_per_number_of_a_row(n: int) -> None:
    log = make_log(3, n)
    columns = table_columns(log)
    assert len(columns) == log.header.layout.row_words
    assert all(column.shape == (3,) for column in columns.values())


def test_parquet_keeps_every_bit_and_type(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="Parquet export is an extra")
    log = make_log(5000)
    export_parquet(log, tmp_path / "run.parquet")
    table = parquet.read_table(tmp_path / "run.parquet")
    columns = table_columns(log)
    assert table.column_names == list(columns)
    for name, column in columns.items():
        np.testing.assert_array_equal(table[name].to_numpy(), column)


def test_without_pyarrow_the_way_out_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(LogError, match=r"qrobot\[logs\]"):
        export_parquet(make_log(3), tmp_path / "run.parquet")


@pytest.mark.parametrize("export", [export_csv, export_parquet])
def test_a_table_that_cannot_be_written_is_a_log_error(export: object, tmp_path: Path) -> None:
    assert callable(export)
    with pytest.raises(LogError, match="cannot write"):
        export(make_log(3), tmp_path / "absent" / "run")


@pytest.mark.parametrize("form", ["csv", "parquet", "png"])
def test_a_table_or_figure_that_is_broken_off_leaves_the_one_before(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if form == "parquet":
        pytest.importorskip("pyarrow", reason="Parquet export is an extra")
    path, log = tmp_path / f"run.{form}", make_log(30)
    write = {
        "csv": lambda: export_csv(log, path),
        "parquet": lambda: export_parquet(log, path),
        "png": lambda: save_figure(FIGURES["torques"](log), path),
    }[form]
    write()
    before = path.read_bytes()

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write()
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == [path.name]


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", list(FIGURES))
@pytest.mark.parametrize(("n", "n_rows"), [(9, 3), (1, 0)])
def test_every_figure_can_be_drawn_and_written(name: str, n: int, n_rows: int, tmp_path: Path) -> None:
    named = LawInForce(0, 0, "mine", "", (), (), (), "slip", "")
    save_figure(FIGURES[name](replace(make_log(n_rows, n), laws=(named,))), tmp_path / "deep" / f"{name}.png")
    assert (tmp_path / "deep" / f"{name}.png").read_bytes().startswith(PNG)


def test_the_papers_figures_have_one_labelled_line_per_joint_over_seconds() -> None:
    log = make_log(200)
    positions, errors = positions_figure(log).axes[0], errors_figure(log).axes[0]
    for axes, values in ((positions, log.rows["q_ref"]), (errors, log.tracking_error)):
        assert [line.get_label() for line in axes.get_lines()] == list(log.header.joint_names)
        for j, line in enumerate(axes.get_lines()):
            np.testing.assert_array_equal(line.get_xdata(), log.time_s)
            np.testing.assert_array_equal(line.get_ydata(), values[:, j])
    assert positions.get_ylabel() == "position (rad)"
    assert positions.get_xlabel() == "time (s)"


def test_sliding_joints_have_an_axis_in_metres_of_their_own() -> None:
    log = make_log(50, 3)
    figure = errors_figure(replace(log, header=replace(log.header, prismatic=(False, True, False))))
    turning, sliding = figure.axes
    assert [line.get_label() for line in turning.get_lines()] == ["joint1", "joint3"]
    assert [line.get_label() for line in sliding.get_lines()] == ["joint2"]
    assert sliding.get_ylabel() == "desired − measured (m)"


def test_no_peak_is_lost_in_a_long_log() -> None:
    log = with_error(make_log(50_000, 2), [1e-4, 0.0])
    log.rows["q"][31_234, 0] = log.rows["q_ref"][31_234, 0] + 0.5
    log.rows["q"][49_999, 1] = log.rows["q_ref"][49_999, 1] - 0.25
    first, second = errors_figure(log).axes[0].get_lines()
    assert np.min(first.get_ydata()) == pytest.approx(-0.5)
    assert np.max(second.get_ydata()) == pytest.approx(0.25)
    assert len(np.asarray(first.get_xdata())) <= MAX_POINTS * 1.1
    assert (np.diff(np.asarray(first.get_xdata())) >= 0).all()


def test_a_figure_in_an_unknown_format_is_a_log_error(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot write"):
        save_figure(positions_figure(make_log(3)), tmp_path / "x.abc")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_is_not_known_hides_no_peak_beside_it_from_a_figure(sign: float) -> None:
    values = np.zeros(10 * MAX_POINTS)
    values[1234], values[[1230, 1237]] = sign * 50.0, np.nan
    values[40_000:50_000] = np.nan
    _, line = thin(np.arange(values.size, dtype=np.float64), values)
    assert line.size <= MAX_POINTS
    assert sign * 50.0 in line
    assert np.isnan(line).sum() == pytest.approx(MAX_POINTS / 6, abs=2)


def test_no_error_is_drawn_where_no_torque_held_the_arm_to_its_reference() -> None:
    log = make_log(100)
    log.rows["mode"][:60], log.rows["mode"][60:90], log.rows["mode"][90:] = Mode.OFF, Mode.TRACKING, Mode.FAULT
    for line in errors_figure(log).axes[0].get_lines()[:6]:
        drawn = np.isfinite(np.asarray(line.get_ydata(), dtype=float))
        assert np.flatnonzero(drawn).tolist() == list(range(60, 90))
