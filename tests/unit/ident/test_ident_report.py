"""The page about an identification: what people judge a model by is on it, and its figures show what they say."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.config.identified import IdentifiedModel
from qrobot.errors import IdentificationError
from qrobot.ident.figures import predicted_figure, residuals_figure
from qrobot.ident.model import Identified, identify
from qrobot.ident.report import predicted_by, report_page, write_report
from qrobot.ident.result import model_of
from qrobot.servo.memory.telemetry import TelemetryLayout
from tests.support.observations import drawn, generated, puma_base

PUMA = load_robot("puma560")
N = PUMA.n
SCALE = np.array([1.0, 0.9, 1.1, 1.0, 1.05, 1.0])


@cache
def found() -> Identified:
    observations = generated(*drawn(2), 0.05, 2, scale=SCALE)
    observations.torque[7] += 40.0
    regressor, base = puma_base()
    return identify(PUMA, base, regressor, observations)


@cache
def model() -> IdentifiedModel:
    return model_of(found(), TelemetryLayout(N).empty(3), "2026-11-21")


def test_a_page_has_every_parameter_every_joint_and_its_figures(tmp_path: Path) -> None:
    files = write_report(tmp_path / "new" / "report.html", found(), model(), previous=model())
    page = files[0].read_text()
    assert all(f"<td>{value.name}</td>" in page for value in model().value)
    assert all(f"<td>{name}</td>" in page for name in PUMA.joint_names)
    assert page.count("data:image/png;base64,") == 3
    assert "previous model" in page
    assert "in the commanded torque of shoulder" in page
    assert [file.read_bytes()[1:4] for file in files[1:]] == 3 * [b"PNG"]
    assert re.search(r"src=\"http|<script", page) is None  # it opens without a network


def test_a_previous_model_that_is_the_same_is_no_worse_whatever_was_carried_or_drifted() -> None:
    (beta, friction), (regressor, base) = drawn(2), puma_base()
    bare = generated(beta, friction, 0.05, 2, scale=SCALE, drift=0.1)
    carried = bare.followed_by(generated(beta, friction, 0.05, 3, poses=12, scale=SCALE, load_kg=2.0))
    both = identify(PUMA, base, regressor, carried)
    same = model_of(both, TelemetryLayout(N).empty(3), "2026-11-21")
    errors = report_page(both, same, same, pictures=[]).split("</table>")[0]
    for name in PUMA.joint_names:
        cells = re.findall(r"<td>([^<]*)</td>", errors[errors.index(f"<td>{name}</td>") :])
        assert cells[3] == cells[4]
        assert float(cells[3]) < float(cells[2])  # a load of 2 kg that no model knows would be 20 N m


def test_a_report_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(IdentificationError, match="cannot write the report"):
        write_report(tmp_path / "file" / "report.html", found(), model())


def test_a_model_predicts_as_the_fit_it_was_made_of_but_for_what_changed_meanwhile() -> None:
    seen, steady = found().observations, found().fit.values.copy()
    steady[-PUMA.n :] = 0.0
    np.testing.assert_allclose(predicted_by(model(), found()), found().unknowns.predict(steady, seen), atol=1e-4)


def test_a_panel_for_each_motor_has_its_passes_nearer_to_the_line_than_the_robot_file() -> None:
    panels = [axes for axes in predicted_figure(found()).axes if axes.get_visible()]
    assert [axes.get_title(loc="left") for axes in panels] == [name.replace("_", " ") for name in PUMA.joint_names]
    for axes in panels:
        _, before, now = axes.lines
        off = [np.abs(np.subtract(*line.get_data())).sum() for line in (before, now)]
        assert off[1] < off[0]


def test_outliers_are_marked_in_the_panel_of_their_motor() -> None:
    wild = residuals_figure(found()).axes[7 % N].lines[2]
    assert np.max(wild.get_ydata()) == pytest.approx(40.0, rel=0.02)
