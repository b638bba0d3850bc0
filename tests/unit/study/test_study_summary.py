"""What studies are summed up to, how it is shown, and that the pictures have every arm in them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.cli.study_tables import identification_lines
from qrobot.errors import ConfigError
from qrobot.study.gain_figure import gain_figure
from qrobot.study.gain_summary import summarise_gains
from qrobot.study.identification_figure import identification_figure
from qrobot.study.identification_summary import summarise_identification
from qrobot.study.results import Results

TERMS = {"study": "identification", "joints": ["turn", "lift"]}


def identified(seed: int, gravity: float, deviation: float, after: float) -> dict[str, Any]:
    return {
        "seed": seed,
        "payload_kg": 1.0,
        "gravity_before": [4.0, 8.0],
        "gravity_rms": [gravity, 2.0 * gravity],
        "friction_error": [[0.01, -0.2, 0.03], [0.0, 0.0, 0.0]],
        "deviations": {"hx1": deviation, "lift.viscous": 0.0},
        "tracking": {"before": [3.0, 4.0], "after": [0.6 * after, 0.8 * after], "exact": [0.6, 0.8]},
    }


ARMS = Results(TERMS, (identified(0, 0.1, 1.0, 1.0), identified(1, 0.2, -3.0, 1.25), {"seed": 2, "failed": "no"}))


def test_an_identification_study_tells_median_and_worst_by_joint() -> None:
    found = summarise_identification(ARMS).to_dict()
    assert found["arms"] == 2
    assert found["failed"] == {"2": "no"}
    np.testing.assert_allclose(found["gravity_rms"]["median"], [0.15, 0.3])
    np.testing.assert_allclose(found["gravity_rms"]["worst"], [0.2, 0.4])
    assert found["friction_error"]["coulomb_pos"]["worst"] == 0.2
    assert found["friction_within_a_tenth"] == pytest.approx(10 / 12)


def test_it_counts_which_truths_are_inside_their_intervals() -> None:
    found = summarise_identification(ARMS).to_dict()
    assert found["inside_95"] == 0.75
    assert found["inside_95_by_value"] == {"hx1": 0.5, "lift.viscous": 1.0}


def test_values_that_only_some_arms_have_are_judged_by_those_and_by_name() -> None:
    first, second = ARMS.good
    more = second | {"deviations": {"hx1": -3.0, "lift.load_share": 0.5, "lift.viscous": 0.0}}
    told = summarise_identification(Results(TERMS, (first, more)))
    plain = told.to_dict()
    assert plain["inside_95_by_value"] == {"hx1": 0.5, "lift.viscous": 1.0, "lift.load_share": 1.0}
    assert plain["inside_95"] == 0.8
    assert "80 %" in identification_figure(told).axes[2].get_title("left")


def test_tracking_is_compared_with_before_and_with_the_exact_model() -> None:
    tracking = summarise_identification(ARMS).to_dict()["tracking"]
    assert tracking["gain"]["worst"] == pytest.approx(4.0)
    assert tracking["over_exact"]["worst"] == pytest.approx(1.25)


def inertia(before: float, after: float, **deviations: float) -> dict[str, Any]:
    return {"inertia": {"before": [before, before], "after": [after, after], "deviations": deviations}}


def test_inertia_is_compared_with_the_robot_files_and_with_the_truth() -> None:
    first, second = ARMS.good
    outcomes = first | inertia(0.4, 0.1, Izz1=0.5, Izz2=2.5), second | inertia(0.6, 0.1, Izz1=-1.0, Izz2=1.0)
    told = summarise_identification(Results(TERMS, outcomes))
    plain = told.to_dict()["inertia"]
    assert plain["before"]["median"] == [0.5, 0.5]
    assert plain["after"]["worst"] == [0.1, 0.1]
    assert plain["inside_95"] == 0.75
    said = " ".join(identification_lines(told))
    assert "turn 0.10 (0.50), lift 0.10 (0.50)" in said
    assert "75.0 % of the true inertias" in said


def test_inertia_in_no_known_unit_is_judged_by_its_prediction_alone() -> None:
    told = summarise_identification(Results(TERMS, (ARMS.good[0] | inertia(0.4, 0.1),)))
    assert told.to_dict()["inertia"]["inside_95"] is None
    assert "true inertias" not in " ".join(identification_lines(told))


def test_a_study_without_tracking_or_without_arms_says_so() -> None:
    still = {name: value for name, value in ARMS.outcomes[0].items() if name != "tracking"}
    assert summarise_identification(Results(TERMS, (still,))).to_dict()["tracking"] is None
    with pytest.raises(ConfigError, match="no arm of this study was identified: no"):
        summarise_identification(Results(TERMS, ARMS.outcomes[2:]))
    with pytest.raises(ConfigError, match="tried any gains: there is none yet"):
        summarise_gains(Results({"study": "gains"}, ()))


def test_every_arm_is_a_point_of_the_figure(tmp_path: Path) -> None:
    gravity, friction, intervals, tracking = identification_figure(summarise_identification(ARMS)).axes
    drawn = np.concatenate([line.get_ydata() for line in gravity.lines if line.get_marker() == "."])
    assert sorted(drawn.tolist()) == [0.1, 0.2, 0.2, 0.4, 4.0, 4.0, 8.0, 8.0]
    assert sum(len(line.get_ydata()) for line in friction.lines if line.get_marker() == ".") == 12
    assert intervals.get_title(loc="left").startswith("75 % of the truths")
    assert sum(len(line.get_ydata()) for line in tracking.lines if line.get_marker() == ".") == 6


def tried(bandwidth: float, rms: float, chatter: float) -> dict[str, Any]:
    return {"bandwidth": bandwidth, "damping": 1.0, "rms": rms, "largest": 2.0 * rms, "chatter": chatter}


LOUD = tried(4.0, 0.01, 0.01)
STOPPED = {"bandwidth": 4.0, "damping": 1.0, "fault": "GUARD_TRIP"}
GAINS = Results(
    {"study": "gains"},
    (
        {"seed": 0, "tried": [tried(1.0, 0.2, 0.010), tried(2.0, 0.05, 0.015), tried(3.0, 0.02, 0.05), STOPPED]},
        {"seed": 1, "tried": [tried(1.0, 0.3, 0.010), tried(2.0, 0.10, 0.015), tried(3.0, 0.02, 0.05), LOUD]},
    ),
)


def test_the_best_pair_errs_least_on_the_worst_arm_without_stopping_one_and_without_noise() -> None:
    found = summarise_gains(GAINS)
    assert found.best is not None
    assert (found.best.bandwidth, found.best.rms.max()) == (2.0, 0.1)
    assert found.pairs[3].to_dict()["faults"] == {"GUARD_TRIP": 1}
    assert found.to_dict()["best"] == {"bandwidth": 2.0, "damping": 1.0}


def test_when_every_pair_stops_some_arm_none_is_proposed() -> None:
    found = summarise_gains(Results({"study": "gains"}, ({"seed": 0, "tried": [STOPPED]},)))
    assert found.best is None
    assert found.to_dict()["pairs"][0]["rms"] is None


def test_the_figure_of_gains_marks_where_an_arm_was_stopped() -> None:
    rms, *_ = gain_figure(summarise_gains(GAINS)).axes
    crosses = [line for line in rms.lines if line.get_marker() == "x"]
    assert [x for line in crosses for x in line.get_xdata()] == [4.0]
    (median,) = [line for line in rms.lines if line.get_marker() == "o"]
    np.testing.assert_allclose(median.get_ydata(), [25.0, 7.5, 2.0, 1.0])


def results_file(folder: Path, results: Results) -> str:
    path = folder / "r.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in (results.terms, *results.outcomes)))
    return str(path)


@pytest.mark.parametrize(
    ("results", "words"),
    [(ARMS, "75.0 % of the true values are inside"), (GAINS, "chatter: bandwidth × 2, damping × 1")],
    ids=["identification", "gains"],
)
def test_show_prints_a_table_or_json_and_draws(
    results: Results, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, plot = results_file(tmp_path, results), tmp_path / "p" / "plot.png"
    assert run_app(make_app("study"), ["study", "show", file, "--plot", str(plot)]) == 0
    assert words in " ".join(capsys.readouterr().out.split())
    assert plot.stat().st_size > 10_000
    assert run_app(make_app("study"), ["study", "show", file, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["terms"] == results.terms


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["show", "nowhere.jsonl"], "cannot read results"),
        (["identify", "--output", "r.jsonl", "--robot", "pumo560"], "no configuration named 'pumo560'"),
        (["gains", "--output", "r.jsonl", "--law", "qrobt", "--workers", "1"], "no control law 'qrobt'"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else None,
)
def test_what_cannot_be_done_is_one_line(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run_app(make_app("study"), ["study", *words]) == 1
    assert said in capsys.readouterr().err
    assert list(tmp_path.glob("*.jsonl")) == []


@pytest.mark.parametrize(
    ("study", "outcome"),
    [("gains", {"seed": 0, "payload_kg": 1.0}), ("gains", {"seed": 0, "tried": [3]}), ("identification", {"seed": 0})],
)
def test_outcomes_of_another_version_are_told_in_one_line(
    study: str, outcome: dict[str, object], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = results_file(tmp_path, Results({"study": study, "joints": ["a"]}, (outcome,)))
    assert run_app(make_app("study"), ["study", "show", file]) == 1
    assert "results of another version, or damaged: " in " ".join(capsys.readouterr().err.split())


def test_a_study_of_another_version_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_app(make_app("study"), ["study", "show", results_file(tmp_path, Results({"study": "x"}, ()))]) == 1
    assert "knows no study 'x'; it knows identification, gains" in capsys.readouterr().err
