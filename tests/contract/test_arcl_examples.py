"""The programs of the ARCL paper (S-11 to S-13), off line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from qrobot.arcl.stream import RecordKind, cartesian_table, read_stream
from tests.support.arcl import run_example

pytestmark = pytest.mark.usefixtures("arcl_alone")


def test_the_papers_program_runs_and_its_last_configuration_is_an_error_that_it_goes_on_from_s11(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_example("s11_first_program.py", tmp_path)
    said = capsys.readouterr().out
    assert re.search(r"EVENT_LIMIT: move to pos: configuration 'lun'.*joint 1 \(waist\) at 179.99 deg", said)
    assert "T6 at 415.0 150.0 397.8 mm" in said
    stream = read_stream(tmp_path / "puma560.arcl")
    assert len(stream.of(RecordKind.EXEC)) == 3
    _, joints = stream.table(RecordKind.JOINTS, 6)
    assert np.allclose(np.degrees(joints[-1]), [39.751, 92.120, -183.904, 20.018, 69.067, -43.181], atol=0.3)


def test_the_tool_weaves_with_ten_millimetres_at_two_hertz_along_the_seam_s12(tmp_path: Path) -> None:
    run_example("s12_weave.py", tmp_path)
    stream = read_stream(tmp_path / "puma560.arcl")
    table, begin_s = cartesian_table(stream), [record.t_ms for record in stream.of(RecordKind.EXEC)][1] / 1e3
    swing = [record.t_ms for record in stream.of(RecordKind.EXEC)]
    assert len(swing) == 2
    during = (table["t_s"] > begin_s + 0.8) & (table["t_s"] < table["t_s"][-1] - 0.5)
    t, across = table["t_s"][during], table["x_mm"][during] - 500.0
    design = np.column_stack([np.sin(4 * np.pi * t), np.cos(4 * np.pi * t), np.ones_like(t)])
    fit = np.linalg.lstsq(design, across, rcond=None)[0]
    assert np.hypot(fit[0], fit[1]) == pytest.approx(10.0, abs=0.2)
    assert np.abs(across - design @ fit).max() < 0.5
    assert np.diff(table["y_mm"][during]).min() > 0.0  # it goes along meanwhile


def test_two_arms_are_never_in_the_shared_place_together_s13(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run_example("s13_two_arms.py", tmp_path)
    said = re.findall(r"([\d.]+) s: arm (\d) (enters|is done)", capsys.readouterr().out)
    assert [(arm, what) for _, arm, what in said] == [
        ("1", "enters"),
        ("1", "is done"),
        ("2", "enters"),
        ("2", "is done"),
    ]
    first, second = (read_stream(tmp_path / name) for name in ("puma560.arcl", "puma560-2.arcl"))
    assert not first.damage
    assert not second.damage
    (t1, q1), (t2, q2) = (stream.table(RecordKind.JOINTS, 6) for stream in (first, second))
    waits = (t2 > 0.5) & (t2 < float(said[1][0]) - 0.1)
    assert np.ptp(q2[waits], axis=0).max() < 1e-9  # the second stands at park until the first is done
    assert np.abs(q1[-1] - q2[-1]).max() < 1e-9
    assert t2[-1] > t1[-1]
