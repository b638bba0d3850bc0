"""Setpoint files: written, read, refused; and played with a stop at any instant."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import ConfigError, JointLimit, MotionError
from qrobot.motion import motion_limits
from qrobot.motion.trajectory.setpoint_player import SetpointPlayer
from qrobot.rccl.setpoints import Setpoints, read_setpoints, write_setpoints

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


def test_a_player_gives_out_the_list_itself() -> None:
    motion = swing()
    player = SetpointPlayer(motion.q, PERIOD_S, LIMITS)
    given = []
    while not player.done:
        given.append(player.step())
    np.testing.assert_array_equal(given, motion.q)


@pytest.mark.parametrize("at", [0, 1, 20, 50, 99])
def test_a_player_that_is_stopped_comes_to_rest_on_the_path_without_a_jump(at: int) -> None:
    player = SetpointPlayer(swing().q, PERIOD_S, LIMITS)
    given = [player.step() for _ in range(at)]
    player.stop()
    while not player.done:
        given.append(player.step())
    x = np.array(given + [given[-1]] * 2)[:, 0]
    v, a = np.diff(x) / PERIOD_S, np.diff(x, n=2) / PERIOD_S**2
    full = np.diff(swing().q[:, 0])
    assert np.abs(v).max() <= np.abs(full).max() / PERIOD_S * 1.001
    assert np.abs(a).max() <= LIMITS.a_max[0] + np.abs(np.diff(full)).max() / PERIOD_S**2
    assert x[-1] == x[-2]
