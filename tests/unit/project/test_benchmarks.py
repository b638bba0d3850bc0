"""The benchmarks' own arithmetic, and that contenders compute the same. Nothing is timed."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from benchmarks import (
    identification,
    kinematics,
    laws,
    logs,
    multi_rccl,
    page,
    pendant,
    rci,
    sixlaw,
    trajectory,
    transports,
    twolink,
    twolink_numpy,
    wakeup,
)
from benchmarks.box import FRAME_NS, REACH, setpoints
from benchmarks.ctwin import compiler
from benchmarks.machine import described, machine
from benchmarks.rows import Goal, Row, against, load, row, save
from benchmarks.timing import FULL, QUICK, interleaved
from benchmarks.tour import MOTIONS, PERIOD_S, planned_tour, walk_again
from qrobot.config import load_robot
from qrobot.ident.stribeck import fit_stribeck
from qrobot.model.paul import T_PAUL_VAL, to_paul
from qrobot.realtime.jit import jit_disabled

ROOT = Path(__file__).parents[3]
needs_compiler = pytest.mark.skipif(
    compiler() is None, reason="no C compiler: the benchmarks then have no C twin either"
)


# --- rows --------------------------------------------------------------------------------------------------------


def test_a_ratio_is_ours_over_theirs_and_goals_look_at_either() -> None:
    ours = against("law", 30.0, "ns", "C", 40.0, Goal(1.1, "ratio"))
    assert (ours.ratio, ours.met, ours.goal) == (0.75, True, "ratio ≤ 1.1")
    assert against("law", 50.0, "ns", "C", 40.0, Goal(1.1, "ratio")).met is False
    assert row("tick", 600.0, "ns", Goal(500.0)).met is False
    assert row("factor", 120.0, "x", Goal(100.0, at_least=True)).met is True
    assert row("factor", 120.0, "x").met is None


def test_a_ratio_to_nothing_is_none_and_meets_no_goal() -> None:
    lone = against("law", 1.0, "ns", "C", 0.0, Goal(1.1, "ratio"))
    assert (lone.ratio, lone.met) == (None, False)


def test_a_goal_is_missed_by_what_is_no_number() -> None:
    assert not Goal(1.0).holds(float("nan"), None)
    assert not Goal(1.0, at_least=True).holds(float("nan"), None)


def test_rows_come_back_from_their_file_with_the_machine(tmp_path: Path) -> None:
    rows = [row("a", 1.5, "s"), against("b", 2.0, "s", "C", 4.0, Goal(1.0, "ratio"), rate="1000 Hz")]
    save(rows, machine(), tmp_path / "sub" / "bench.json")
    assert load(tmp_path / "sub" / "bench.json")[0] == rows
    document = json.loads((tmp_path / "sub" / "bench.json").read_text())
    assert {"name", "value", "unit", "reference", "ratio", "goal", "met"} <= set(document["rows"][0])
    assert {"processor", "cores", "kernel", "load"} <= set(document["machine"])


def test_contenders_take_turns_and_the_order_rotates() -> None:
    order: list[str] = []
    best = interleaved({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 3)
    assert order == ["a", "b", "b", "a", "a", "b"]
    assert all(seconds >= 0.0 for seconds in best.values())


def test_a_quick_run_makes_a_share_of_the_iterations_and_at_least_one() -> None:
    assert (FULL.times(1000), QUICK.times(1000), QUICK.times(1)) == (1000, 20, 1)


# --- the page ----------------------------------------------------------------------------------------------------


def wake_up_rows() -> list[Row]:
    turns = {
        wakeup.SPIN: [wakeup.Turn(np.full(1000, 0.01), 0.3, 0)],
        wakeup.PYTHON: [wakeup.Turn(np.full(1000, 5000.0), 0.1, 5)],
        wakeup.CYCLICTEST: [wakeup.Turn(np.full(1000, 20.0))],
    }
    return list(wakeup.figures(4000, wakeup.IDLE, turns))


def test_the_page_has_a_line_per_figure_and_a_table_per_load() -> None:
    tasks = list(rci.beside(rci.case(250, wakeup.BUSY, "compiled, tasks: 3"), np.full(9, 12.5), None, 2))
    rows = [against("law", 30.0, "ns", "C", 40.0, Goal(1.1, "ratio")), *wake_up_rows(), *tasks]
    text = page.rewrite("# P\n\n<!-- measured -->\nold\n<!-- end -->\ntail\n", rows, machine())
    assert "| law | 30 ns | 40 ns (C) | 0.75 | ratio ≤ 1.1 | yes |" in text
    assert "| 4000 Hz | sleep then spin | 0.01 us | 0.01 us | 0.01 us | 0 ppm | 0 ppm | 30 % | 4 of 4 |" in text
    assert "| rate | loop | p50 | p99 | missed |" in text
    assert "RCI, busy Python thread:" in text
    assert "| 250 Hz | compiled, tasks: 3 | 12.5 us | 12.5 us | 2 |" in text
    assert described(machine())[:40] in text
    assert "old" not in text
    assert text.endswith("tail\n")


def test_a_page_without_a_place_for_the_figures_is_refused() -> None:
    with pytest.raises(ValueError, match="measured"):
        page.rewrite("# P\n", wake_up_rows(), machine())


def test_the_projects_page_has_its_place() -> None:
    text = page.PAGE.read_text()
    assert page.rewrite(text, wake_up_rows(), machine()) != text
    assert {"rci", "multi_rccl"} <= page.own_parts(text)


def test_a_benchmark_with_a_part_of_its_own_leaves_the_others_as_they_are() -> None:
    text = "<!-- measured -->\nall\n<!-- end -->\n<!-- measured: rci -->\nold\n<!-- end -->\n"
    of_rci = [replace(row("answer", 50.0, "us"), group="rci")]
    anew = page.rewrite(text, of_rci, machine())
    assert "all" in anew
    assert "old" not in anew
    assert "| answer | 50 us |" in anew
    both = page.rewrite(text, [*of_rci, replace(row("law", 1.0, "s"), group="laws")], machine())
    assert both.index("| law |") < both.index("| answer |")
    with pytest.raises(ValueError, match="no part between"):
        page.rewrite(text.replace("measured -->", "", 1), [row("law", 1.0, "s")], machine())


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (0.1234, "0.123"),
        (85.33, "85.3"),
        (14400000.0, "1.4e+07"),
        (203321.0, "203,321"),
        (5e-17, "5.0e-17"),
    ],
)
def test_numbers_have_three_digits_and_few_exponents(value: float, text: str) -> None:
    assert page.number(value) == text


# --- wake-ups ----------------------------------------------------------------------------------------------------


def test_a_histogram_of_cyclictest_becomes_its_wake_ups() -> None:
    text = "# Histogram\n000000 000000\n000017 000003\n000021 000001\n# Total: 000000004\n"
    assert wakeup.parse_histogram(text).tolist() == [17.0, 17.0, 17.0, 21.0]
    assert wakeup.parse_histogram("no permission").size == 0


def test_late_wake_ups_are_counted_in_parts_per_million_of_half_and_whole_periods() -> None:
    late = np.array([10.0] * 997 + [130.0, 260.0, 260.0])
    found = {r.labels["figure"]: r for r in wakeup.figures(4000, wakeup.IDLE, {wakeup.PYTHON: [wakeup.Turn(late)]})}
    assert (found["> T/2"].value, found["> T"].value) == (pytest.approx(3000.0), pytest.approx(2000.0))
    assert "CPU" not in found


def test_our_loop_is_judged_against_cyclictest_and_left_alone_without_it() -> None:
    goals = {r.labels["figure"]: r.met for r in wake_up_rows() if r.labels["loop"] == wakeup.SPIN and r.met is not None}
    assert goals == {"p50": True, "p99": True, "p99.9": True, "page faults": True}
    alone = {wakeup.SPIN: [wakeup.Turn(np.ones(9), 0.3, 0)], wakeup.PYTHON: [wakeup.Turn(np.ones(9), 0.1, 0)]}
    assert [r.met for r in wakeup.figures(4000, wakeup.IDLE, alone) if r.labels["figure"] == "p50"] == [None, None]


def test_pooled_turns_are_one_sample() -> None:
    turns = [wakeup.Turn(np.zeros(10)), wakeup.Turn(np.full(10, 100.0))]
    found = {r.labels["figure"]: r.value for r in wakeup.figures(1000, wakeup.IDLE, {wakeup.PYTHON: turns})}
    assert found["p50"] == pytest.approx(50.0)


# --- contenders compute the same ---------------------------------------------------------------------------------


def test_a_pendant_costs_what_the_99th_per_cent_of_cycles_is_longer() -> None:
    without = {"busy_ns": np.arange(1.0, 1001.0) * 1e3}
    told, ratio = pendant.compared(without, {"busy_ns": 2.0 * without["busy_ns"]}, "busy_ns")
    assert (told["without"], ratio) == ((500.5, 990.01), pytest.approx(2.0))


def test_the_table_2_law_is_the_same_in_numpy() -> None:
    assert twolink_numpy.iterations(300) == pytest.approx(twolink.iterations(twolink.fresh(), 300), rel=1e-12)


@needs_compiler
def test_the_table_2_law_is_the_same_in_c() -> None:
    c = laws.c_iterations()
    assert c(300) == pytest.approx(twolink.iterations(twolink.fresh(), 300), rel=1e-12)


@needs_compiler
@pytest.mark.parametrize("smooth", [True, False])
def test_the_six_joint_law_is_the_same_in_c(smooth: bool) -> None:
    ours = sixlaw.law_calls(*sixlaw.arguments(), smooth, 200)
    assert laws.c_law_calls(smooth)(200) == pytest.approx(ours, rel=1e-12)


@needs_compiler
@pytest.mark.realtime
def test_the_loop_in_c_wakes_as_often_as_asked() -> None:
    late = np.full(20, -1, dtype=np.int64)
    wakeup.bodies()[wakeup.TWIN](1_000_000, late)
    assert (late >= 0).all()


@pytest.mark.realtime
@pytest.mark.parametrize("loop", [wakeup.SPIN, wakeup.SLEEP, wakeup.PYTHON])
def test_our_loops_wake_as_often_as_asked_and_never_early(loop: str) -> None:
    late = np.full(20, -1, dtype=np.int64)
    wakeup.bodies()[loop](1_000_000, late)
    assert (late >= (-200_000 if jit_disabled() else 0)).all()


def test_the_inverse_on_random_poses_meets_every_goal_that_no_clock_decides() -> None:
    errors = list(kinematics.error_rows(kinematics.random_poses(300)))
    assert [row.met for row in errors] == [True] * 4


@pytest.mark.skipif(not find_spec("eaik"), reason='no EAIK: .venv/bin/pip install "eaik>=1.2"')
def test_eaik_finds_our_solutions() -> None:
    poses = kinematics.random_poses(20)
    peer = kinematics.eaik_puma(poses.arm)
    for q, T in zip(poses.q, poses.T, strict=True):
        found = np.exp(1j * peer.IK(T_PAUL_VAL @ T).Q)
        ours = np.exp(1j * np.array([to_paul(each) for each in poses.arm.inverses(T, q).values()]))
        distance = np.abs(found[:, None] - ours).max(axis=2)
        assert distance.min(axis=0).max() < 1e-6


@pytest.mark.thorough
def test_the_compiled_setpoints_are_the_generators_and_keep_the_limits_from_sample_to_sample() -> None:
    tour, q = planned_tour(4000)
    failed, again = walk_again(tour)
    assert set(tour.place) == set(range(MOTIONS))
    assert failed == 0
    np.testing.assert_allclose(again, q, rtol=0.0, atol=1e-12)
    limits = load_robot("puma560").limits
    assert (np.abs(np.diff(q, axis=0)) <= limits.v_max * PERIOD_S).all()
    assert (np.abs(np.diff(q, 2, axis=0)) <= limits.a_max * PERIOD_S**2).all()


def test_the_complying_cycle_that_is_timed_does_comply() -> None:
    complying = trajectory.Round(comply=True)
    complying.times_s(20)
    assert complying.yielding == 1


def test_two_arms_whose_samples_are_timed_hold_what_they_follow() -> None:
    followed = multi_rccl.follow(["left", "right"], True, 20)
    assert followed.times_us.shape == (20,)
    assert followed.off_m < 1e-9


def test_without_its_peer_a_row_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kinematics, "eaik_puma", lambda *_: None)
    monkeypatch.setattr(trajectory, "ruckig_updates", lambda *_: None)
    poses, (tour, _) = kinematics.random_poses(5), planned_tour(2000)
    names = [row.name for row in (*kinematics.timed_rows(poses, QUICK), *trajectory.setpoint_rows(tour, QUICK))]
    assert [name for name in names if "EAIK is not installed" in name]
    assert [name for name in names if "ruckig is not installed" in name]


def test_trajectory_derivatives_are_derivatives() -> None:
    h, t = 1e-5, 0.7
    before, here, after = (twolink.trajectory(t + s, 0.8, 1.0) for s in (-h, 0.0, h))
    for k in range(4):
        assert (after[k] - before[k]) / (2 * h) == pytest.approx(here[k + 1], rel=1e-6)


def test_the_model_of_table_2_is_differentiated_right() -> None:
    """h, dh/dt and d2h/dt2 along a motion with constant jerk."""

    def motion(t: float) -> tuple[twolink.Quad, tuple[float, float]]:
        q = (0.3 + 0.5 * t + 0.2 * t**2 + 0.1 * t**3, -0.4 + 0.7 * t - 0.3 * t**2 + 0.2 * t**3)
        v = (0.5 + 0.4 * t + 0.3 * t**2, 0.7 - 0.6 * t + 0.6 * t**2)
        return (*q, *v), (0.4 + 0.6 * t, -0.6 + 1.2 * t)

    def rate(t: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        return np.array(twolink.bias_rate(*motion(t), 0.35, 12.0, 4.0))

    h, t = 1e-5, 0.4
    ahead, behind = (np.array(twolink.bias(motion(t + s)[0], 0.35, 12.0, 4.0)) for s in (h, -h))
    np.testing.assert_allclose((ahead - behind) / (2 * h), rate(t), rtol=1e-7)
    curvature = twolink.bias_curvature(*motion(t), (0.6, 1.2), 0.35, 12.0, 4.0)
    np.testing.assert_allclose((rate(t + h) - rate(t - h)) / (2 * h), curvature, rtol=1e-7)


# --- what is measured on -----------------------------------------------------------------------------------------


def test_the_box_motion_starts_at_ready_and_goes_round_its_corners() -> None:
    robot = load_robot("puma560")
    path = setpoints(robot, 8.0)
    assert len(path) == round(8.0 * 1e9 / FRAME_NS)
    np.testing.assert_array_equal(path[0], robot.poses["ready"])
    swing = path - robot.poses["ready"]
    assert np.ptp(swing, axis=0)[0] > 1.5 * REACH
    assert np.abs(swing).max() <= REACH * 1.01
    assert np.abs(np.diff(path, axis=0)).max() / (FRAME_NS * 1e-9) < 1.0


def test_the_torques_that_are_fitted_have_the_friction_they_are_said_to_have() -> None:
    robot = load_robot("puma560")
    speed = identification.FADES * robot.limits.v_max
    found = fit_stribeck(identification.motion(6000, identification.EXCESS), robot.n, speed)
    preset = robot.friction[robot.control.friction_preset]
    assert (np.abs(found.coulomb[:, 0] - preset.coulomb_pos) < 2.0 * found.coulomb_half_width[:, 0]).all()
    assert found.coulomb[0, 0] == pytest.approx(preset.coulomb_pos[0], rel=0.02)
    np.testing.assert_allclose(found.scatter, identification.NOISE_NM, rtol=0.1)


def test_benchmark_telemetry_has_every_tick_once() -> None:
    rows = logs.telemetry(50, 6)
    assert rows["tick"].tolist() == list(range(50))
    assert np.ptp(rows["q"], axis=0).min() > 0.0


@pytest.mark.thorough
def test_images_go_over_every_transport_and_over_the_bare_library() -> None:
    found = {row.name: row for row in transports.rows(QUICK)}
    assert all(row.value > 0 for row in found.values())
    for transport, peer in (("Modbus", "bare pymodbus"), ("CAN by UDP multicast", "bare python-can")):
        over = found[f"image over {transport}"]
        assert over.peer == peer
        assert over.ratio is not None
        assert over.reference is not None
