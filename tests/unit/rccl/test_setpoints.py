"""Setpoint files: written, read, refused; and played with a stop at any instant."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.config.fences import Fence
from qrobot.errors import ConfigError, FenceCrossed, JointLimit, MotionError
from qrobot.fences.fence_set import FenceSet
from qrobot.motion import motion_limits
from qrobot.motion.trajectory.setpoint_player import SetpointPlayer
from qrobot.rccl.setpoints import Setpoints, check_fences, read_setpoints, write_setpoints
from tests.support.thorough import examples

ROBOT = load_robot("puma560")
LIMITS = motion_limits(ROBOT)
PERIOD_S = 0.028


def swing(samples: int = 101, width: float = 0.5) -> Setpoints:
    """Joint 1 from park and back, at rest at both ends."""
    q = np.tile(ROBOT.poses["park"], (samples, 1))
    q[:, 0] += 0.5 * width * (1.0 - np.cos(2.0 * np.pi * np.linspace(0.0, 1.0, samples)))
    return Setpoints(ROBOT.name, round(PERIOD_S * 1e6), q)


@pytest.fixture
def lines(tmp_path: Path) -> list[str]:
    write_setpoints(tmp_path / "good.csv", swing())
    return (tmp_path / "good.csv").read_text().splitlines()


def read_lines(folder: Path, lines: list[str]) -> Setpoints:
    (folder / "changed.csv").write_text("\n".join(lines) + "\n")
    return read_setpoints(folder / "changed.csv")


def test_what_is_written_is_read_to_twelve_digits(tmp_path: Path) -> None:
    write_setpoints(tmp_path / "s.csv", swing())
    again = read_setpoints(tmp_path / "s.csv")
    assert (again.robot, again.period_us) == ("puma560", 28_000)
    np.testing.assert_allclose(again.q, swing().q, rtol=1e-11, atol=1e-15)
    again.check(LIMITS, "s.csv")


@pytest.mark.parametrize(
    ("number", "text", "complaint"),
    [
        (1, "t,q1", "line 1: not a setpoint file"),
        (2, "# arm puma560", "line 2: should say '# robot"),
        (3, "# period_us 5", "line 3: the period must be"),
        (3, "# period_us many", "line 3: the period must be"),
        (4, "t_s,q1,q3", "line 4: should name the columns"),
        (7, "0.056,1,2,3", "line 7: 7 finite numbers needed"),
        (7, "0.056,1,2,3,4,5,nan", "line 7: 7 finite numbers needed"),
        (7, "0.056;1;2", "line 7: 7 numbers with commas needed"),
        (7, "0.084,0,0,0,0,0,0", r"line 7: its time should be 0\.056000, not 0\.084"),
    ],
)
def test_a_bad_line_is_refused_with_its_number(tmp_path, lines, number, text, complaint) -> None:
    lines[number - 1] = text
    with pytest.raises(ConfigError, match=complaint):
        read_lines(tmp_path, lines)


def test_a_file_cut_off_within_its_head_is_refused(tmp_path, lines) -> None:
    with pytest.raises(ConfigError, match="line 3: should say '# period_us"):
        read_lines(tmp_path, lines[:2])
    with pytest.raises(ConfigError, match="line 4: should name the columns"):
        read_lines(tmp_path, lines[:3])


def test_a_file_that_is_not_there_is_refused(tmp_path) -> None:
    with pytest.raises(ConfigError, match=r"none\.csv: No such file or directory$"):
        read_setpoints(tmp_path / "none.csv")


def test_a_motion_beyond_the_arm_is_refused_with_the_line() -> None:
    far = swing()
    far.q[50, 0] = 4.0
    with pytest.raises(JointLimit, match=r"f\.csv, line 55: .*joint 1"):
        far.check(LIMITS, "f.csv")


def test_a_motion_too_fast_is_refused() -> None:
    with pytest.raises(MotionError, match=r"joint 1 .*would move at"):
        swing(21, width=2.0).check(LIMITS, "f.csv")


@pytest.mark.parametrize("cut", [slice(25, None), slice(0, 75)])
def test_a_motion_that_begins_or_ends_at_speed_is_refused(cut) -> None:
    part = Setpoints(ROBOT.name, 28_000, swing().q[cut])
    with pytest.raises(MotionError, match=r"joint 1 .*would accelerate by"):
        part.check(LIMITS, "f.csv")


def test_an_empty_motion_and_another_number_of_joints_are_refused() -> None:
    with pytest.raises(MotionError, match="no setpoints"):
        Setpoints(ROBOT.name, 28_000, np.empty((0, 6))).check(LIMITS, "f.csv")
    with pytest.raises(MotionError, match="6 finite joint positions"):
        Setpoints(ROBOT.name, 28_000, np.zeros((3, 5))).check(LIMITS, "f.csv")


def test_a_fence_between_two_setpoints_is_not_gone_through() -> None:
    turn = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
    park = np.array(ROBOT.poses["park"])
    _, start, end, _ = FenceSet(ROBOT, []).capsules_at(park + turn)[-1]
    x, y, z = 0.5 * (start + end)
    fences = FenceSet(ROBOT, [Fence(name="post", shape="box", size_m=(0.01, 0.01, 0.01), position_m=(x, y, z))])
    around = np.array([park, park, park + 2.0 * turn, park + 2.0 * turn])
    for row in around:
        fences.check(row, fences.floor(park), "a setpoint", 0.0)
    with pytest.raises(FenceCrossed, match="post") as caught:
        check_fences(around, fences, "f.csv")
    assert 1.0 / 3.0 < caught.value.share < 0.5
    check_fences(around[:2], fences, "f.csv")
    check_fences(around[:1], fences, "f.csv")
    check_fences(around, None, "f.csv")


def test_a_player_gives_out_the_list_itself() -> None:
    motion = swing()
    player = SetpointPlayer(motion.q, PERIOD_S, LIMITS)
    sent = []
    while not player.done:
        sent.append(player.step(len(sent)))
    np.testing.assert_array_equal(sent, motion.q)


def test_a_player_makes_up_for_samples_that_were_left_out() -> None:
    motion = swing()
    player = SetpointPlayer(motion.q, PERIOD_S, LIMITS)
    for tick in (7, 8, 10, 13, 14, 19):  # the arm's first sample has any number
        np.testing.assert_array_equal(player.step(tick), motion.q[tick - 7])
    assert not player.done
    np.testing.assert_array_equal(player.step(500), motion.q[-1])
    assert player.done


@given(st.lists(st.tuples(st.integers(0, 60), st.one_of(st.just(0.0), st.just(1.0), st.floats(0.0, 1.0))), max_size=5))
@settings(max_examples=examples(60), deadline=None)
def test_a_player_passes_the_same_places_in_the_same_order_at_any_override(
    changes: list[tuple[int, float]],
) -> None:
    """A joint that goes one way has gone through all its places once, gently, and no faster than in the list."""
    s = np.linspace(0.0, 1.0, 101)
    q = np.tile(ROBOT.poses["park"], (101, 1)) + np.outer(s**3 * (10.0 - 15.0 * s + 6.0 * s**2), [0.5] * 6)
    player = SetpointPlayer(q, PERIOD_S, LIMITS)
    sent: list[Floats] = []
    for samples, override in [*changes, (1_000, 1.0)]:
        for _ in range(samples):
            if not player.done:
                sent.append(player.step(len(sent), override))
    assert player.done
    np.testing.assert_array_equal(sent[0], q[0])
    np.testing.assert_array_equal(sent[-1], q[-1])
    x = np.array(sent)[:, 0]
    v, a = np.diff(x) / PERIOD_S, np.diff(x, n=2) / PERIOD_S**2
    fastest = np.diff(q[:, 0]).max() / PERIOD_S
    assert (v >= -1e-3 * fastest).all()  # from rest the curve between two rows swings by some millionths
    assert v.max() <= fastest * 1.001
    assert np.abs(a).max() <= np.abs(np.diff(q[:, 0], n=2)).max() / PERIOD_S**2 + LIMITS.a_max[0]


def test_a_player_stands_in_a_pause_and_does_not_begin_in_one() -> None:
    motion = swing()
    player = SetpointPlayer(motion.q, PERIOD_S, LIMITS)
    for tick in range(10):
        np.testing.assert_array_equal(player.step(tick, 0.0), motion.q[0])
    assert not player.moves
    ahead = [player.step(tick, 1.0) for tick in range(10, 60)]
    assert player.moves
    assert ahead[-1][0] > ahead[0][0]
    held = [player.step(tick, 0.0) for tick in range(60, 160)]
    assert (held[-1] == held[-2]).all()
    assert player.rate == 0.0
    assert not player.done
    player.stop()
    assert (player.step(160, 1.0) == held[-1]).all()
    assert player.done


@pytest.mark.parametrize("end", ["q_min", "q_max"])
def test_a_player_that_dwells_at_the_end_of_a_range_does_not_leave_it_at_an_override(end: str) -> None:
    """Between rows its curve is rounder than they are."""
    limit = getattr(LIMITS, end)[0]
    way = 0.02 if end == "q_min" else -0.02
    q = np.tile(ROBOT.poses["park"], (12, 1))
    q[:, 0] = limit + way * np.array([6, 6, 5, 4, 3, 2, 1, 0, 0, 0, 0, 0])
    player = SetpointPlayer(q, PERIOD_S, LIMITS)
    sent: list[Floats] = []
    while not player.done:
        sent.append(player.step(len(sent), 0.3))
    assert all(LIMITS.q_min[0] <= row[0] <= LIMITS.q_max[0] for row in sent)
    np.testing.assert_array_equal(sent[-1], q[-1])


def test_a_player_that_is_stopped_before_it_begins_stays_where_it_is() -> None:
    motion = swing()
    player = SetpointPlayer(motion.q, PERIOD_S, LIMITS)
    player.stop()
    np.testing.assert_array_equal(player.step(0), motion.q[0])
    assert player.done


@pytest.mark.parametrize("at", [0, 1, 20, 50, 99])
def test_a_player_that_is_stopped_comes_to_rest_on_the_path_without_a_jump(at: int) -> None:
    player = SetpointPlayer(swing().q, PERIOD_S, LIMITS)
    sent = [player.step(tick) for tick in range(at)]
    player.stop()
    while not player.done:
        sent.append(player.step(len(sent)))
    x = np.array(sent + [sent[-1]] * 2)[:, 0]
    v, a = np.diff(x) / PERIOD_S, np.diff(x, n=2) / PERIOD_S**2
    full = np.diff(swing().q[:, 0])
    assert np.abs(v).max() <= np.abs(full).max() / PERIOD_S * 1.001
    assert np.abs(a).max() <= LIMITS.a_max[0] + np.abs(np.diff(full)).max() / PERIOD_S**2
    assert x[-1] == x[-2]
