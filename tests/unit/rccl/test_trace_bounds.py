"""A trace of a program that runs for weeks: it keeps the newest, and what is made of it takes time with its length."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.cli import motion_figures, traced
from qrobot.cli.motion_figures import NEAR, farthest_off
from qrobot.motion import EventKind, JointSpeed, MotionEvent, MoveRequest, Termination
from qrobot.rccl import trace as traces
from qrobot.rccl.setpoints import read_setpoints
from qrobot.rccl.trace import Trace
from tests.support.puma import ROBOT
from tests.support.thorough import wide

PERIOD_S, KEPT, KEPT_REQUESTS = 0.028, 100, 20
HOME = np.zeros(ROBOT.n)


@pytest.fixture
def trace(monkeypatch: pytest.MonkeyPatch) -> Trace:
    monkeypatch.setattr(traces, "KEPT_SAMPLES", KEPT)
    monkeypatch.setattr(traces, "KEPT_REQUESTS", KEPT_REQUESTS)
    return Trace(ROBOT, PERIOD_S)


def move(trace: Trace, samples: int, number: int = 0) -> MoveRequest:
    """A request that is asked for, begun and ended; its samples stand at `number`."""
    request = MoveRequest(f"goal {number}", HOME, JointSpeed(0.5))
    trace.asked(request)
    trace.told(MotionEvent(EventKind.BEGUN, request))
    for _ in range(samples):
        trace.sampled(np.full(ROBOT.n, float(number)), np.full(ROBOT.n, number + 0.5))
    trace.told(MotionEvent(EventKind.ENDED, request, Termination.COMPLETED))
    return request


@pytest.mark.parametrize("moves", [200, 400, 800])
def test_what_a_trace_holds_has_an_end_however_long_the_program_runs(trace: Trace, moves: int) -> None:
    for number in range(moves):
        move(trace, 3, number)
    assert (len(trace.setpoints.q), len(trace.measured), len(trace.requests)) == (KEPT, KEPT, KEPT_REQUESTS)
    assert len(trace._open) == len(trace._ended) < 10
    assert trace.forgotten == moves - KEPT_REQUESTS


def test_the_newest_is_kept_with_the_times_and_numbers_that_it_had(trace: Trace) -> None:
    for number in range(200):
        move(trace, 3, number)
    assert trace.setpoints.q[-1, 0] == 199.0
    assert trace.measured[-1, 0] == 199.5
    assert trace.begin_s == pytest.approx(500 * PERIOD_S)
    last = trace.requests[-1]
    assert (last.number, last.name, last.code) == (200, "goal 199", Termination.COMPLETED)
    assert last.ended_s == pytest.approx(600 * PERIOD_S)
    assert "(180 requests before these are not kept)" in trace.text()


def test_a_short_run_is_kept_as_a_whole_and_nothing_is_said_of_a_rest(trace: Trace) -> None:
    move(trace, KEPT)
    assert (trace.begin_s, trace.forgotten, len(trace.setpoints.q)) == (0.0, 0, KEPT)
    assert "not kept" not in trace.text()


def test_an_arm_that_loses_the_goal_it_had_reached_is_told_also_when_another_request_has_ended(trace: Trace) -> None:
    held = move(trace, 3)
    move(trace, 3, 1)
    trace.told(MotionEvent(EventKind.LOST, held, Termination.JOINT_LIMIT))
    assert trace.requests[0].lost_code == Termination.JOINT_LIMIT


def circle(samples: int) -> Floats:
    angle = np.linspace(0.0, 6.0, samples)
    return np.stack([np.cos(angle), np.sin(angle), angle], axis=1)


def test_how_far_the_measured_way_is_off_is_found_in_steps_that_grow_with_its_length(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[int] = []
    distance = motion_figures._distance

    def counted(place: Floats, begin: Floats, along: Floats, square: Floats) -> float:
        looked[-1] += len(begin)
        return distance(place, begin, along, square)

    monkeypatch.setattr(motion_figures, "_distance", counted)
    for samples in (2000, 4000, 8000):
        looked.append(0)
        farthest_off(circle(samples), circle(samples), NEAR)
    assert looked[1] < 2.2 * looked[0]
    assert looked[2] < 2.2 * looked[1]


@pytest.mark.parametrize("behind", [0, 1, 17, NEAR - 1])
def test_a_measured_way_that_lags_is_off_by_its_distance_from_the_way_and_not_by_the_lag(behind: int) -> None:
    asked = circle(2000)
    late = np.vstack([np.repeat(asked[:1], behind, axis=0), asked])[: len(asked)]
    beside = late * [1.5, 1.5, 1.0]  # half a radius outside
    assert farthest_off(asked, late, NEAR) == pytest.approx(0.0, abs=1e-9)
    assert farthest_off(asked, beside, NEAR) == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("samples", [3, 700, *wide(5000)])
def test_a_way_told_in_other_samples_is_compared_as_a_whole(samples: int) -> None:
    assert farthest_off(circle(2000), circle(samples)) == pytest.approx(0.0, abs=1e-5)
    assert farthest_off(circle(2000), circle(samples) * [1.5, 1.5, 1.0]) == pytest.approx(0.5, abs=0.01)


def test_one_place_is_off_by_its_distance_from_the_one_asked_for() -> None:
    assert farthest_off(np.zeros((1, 3)), np.array([[3.0, 4.0, 0.0]])) == 5.0


def test_the_end_of_a_long_run_writes_what_is_kept_and_draws_the_newest(
    trace: Trace, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drawn: list[int] = []

    def path_of(_robot: object, q: Floats) -> Floats:
        drawn.append(len(q))
        return np.zeros((len(q), 3))

    monkeypatch.setattr(traced, "FIGURED", 40)
    monkeypatch.setattr("qrobot.cli.motion_figures.path_of", path_of)
    monkeypatch.setattr(
        "qrobot.log.plot.save_figure",
        lambda figure, _path: drawn.append(len(figure.axes[0].lines[0].get_xdata())),
    )
    for number in range(200):
        move(trace, 3, number)
    traced._write_trace(trace, tmp_path, "", ideal=False)
    assert drawn == [40] * 4
    assert len(read_setpoints(tmp_path / "setpoints.csv").q) == KEPT
    said = " ".join(capsys.readouterr().err.split())
    assert "the setpoints before 14.000 s are not kept" in said
    assert "the figures show the last 1 s" in said
