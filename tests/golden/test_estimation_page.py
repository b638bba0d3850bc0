"""The page on estimation and interpolation says what the code does, and the better choice is better by far."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from qrobot.rig.experiment import program_path, run_program
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.ground_truth import GroundTruthRig

DOCS = Path(__file__).parents[2] / "docs"
sys.path.insert(0, str(DOCS))

from estimation import PAGE, PARTS, forms, measure, rewrite, robot  # type: ignore[import-not-found]  # noqa: E402

TEXT = PAGE.read_text()
DIGITS = 0.08  # last digits printed, and what rounding makes of a run of thousands of cycles


def rows_of(part: str) -> list[list[str]]:
    """Cells of the measured table called `part`, without its heading."""
    found = re.search(rf"<!-- measured: {part} -->\n(.*?)<!-- end -->", TEXT, re.DOTALL)
    assert found is not None
    lines = [line for line in found[1].splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("velocity", ["difference", "observer"])
@pytest.mark.parametrize("plant", ["nominal", "mismatched"])
def test_the_velocity_errors_on_the_page_are_those_measured(plant: str, velocity: str) -> None:
    told = next(row for row in rows_of("velocity-errors") if row[:3] == ["1000", plant, velocity])
    seen = measure(1000, plant, velocity, "quintic")
    np.testing.assert_allclose(seen.velocity_error * 1e3, [float(cell) for cell in told[3:9]], atol=DIGITS, rtol=0.02)


@pytest.mark.thorough
@pytest.mark.parametrize("form", ["linear", "b-spline"])
def test_the_errors_of_the_forms_on_the_page_are_those_measured(form: str) -> None:
    told = next(row for row in rows_of("form-errors") if row[0] == f"`{form}`")
    seen = measure(1000, "nominal", "difference", form)
    np.testing.assert_allclose(seen.tracking_error * 1e3, [float(cell) for cell in told[1:7]], atol=DIGITS, rtol=0.02)


def test_the_table_of_forms_is_that_of_the_code() -> None:
    assert f"<!-- measured: forms -->\n\n{forms().strip()}\n\n<!-- end -->" in TEXT


def test_every_measured_part_stands_on_the_page_and_no_other() -> None:
    assert set(re.findall(r"<!-- measured: ([a-z-]+) -->", TEXT)) == set(PARTS)
    with pytest.raises(KeyError):
        rewrite("<!-- measured: poetry -->\n<!-- end -->")


def test_the_observer_is_at_least_twice_as_good_everywhere_and_far_quieter() -> None:
    for plant in ("nominal", "mismatched"):
        observer, difference = (measure(1000, plant, name, "quintic") for name in ("observer", "difference"))
        assert np.all(2.0 * observer.velocity_error < difference.velocity_error)
        assert np.median(4.0 * np.abs(observer.lag_s)) < np.median(difference.lag_s)
        assert np.all(2.5 * observer.ripple < difference.ripple)


@pytest.mark.thorough
@pytest.mark.parametrize("factor", [0.5, 4.0])
def test_the_observer_forgives_a_payload_nobody_told_it_of_and_an_inertia_far_off(factor: float) -> None:
    rig = GroundTruthRig(
        robot(), ServoSettings(velocity="observer"), Emulator(robot(), physics="rigid", payload_kg=2.5)
    )
    rig.params.inertia[:] *= factor
    run_program(rig, program_path())
    seen = rig.tracked_truth()
    assert not seen.rows["fault"].any()
    assert np.all(seen.velocity_error < measure(1000, "nominal", "difference", "quintic").velocity_error)
