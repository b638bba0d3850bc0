"""An arm keeps away from the floor, from its column and from itself."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from qrobot.config import Robot, load_robot
from qrobot.ident.clearance import Clearance
from qrobot.ident.link_lines import HAND_M, SPACING_M, LinkLines
from qrobot.model.arm import Arm
from qrobot.model.transform import rot_x, transform

PUMA = load_robot("puma560")
DRAWN = np.random.default_rng(7).uniform(PUMA.limits.q_min, PUMA.limits.q_max, (1000, PUMA.n))
FOLDED = (0, -90, 240, 0, 0, 0)  # the forearm beside the upper arm, as far as the elbow goes


@pytest.mark.parametrize("name", ["puma560", "stanford"])
def test_lines_lead_from_the_floor_to_the_end_of_the_hand(name: str) -> None:
    robot = load_robot(name)
    q = np.random.default_rng(1).uniform(robot.limits.q_min, robot.limits.q_max, (20, robot.n))
    lines = LinkLines(robot).lines(q)
    assert len(lines) == robot.n + 2
    np.testing.assert_allclose(lines[0][:, 0], np.tile([0.0, 0.0, -robot.geometry.base_height_m], (20, 1)))
    for before, after in pairwise(lines):
        np.testing.assert_allclose(before[:, -1], after[:, 0], atol=1e-12)
    ends = [(Arm(robot).flange(each) @ transform(translation=[0.0, 0.0, HAND_M]))[:3, 3] for each in q]
    np.testing.assert_allclose(lines[-1][:, -1], ends, atol=1e-12)


def test_points_along_a_body_are_close_together() -> None:
    for line in LinkLines(PUMA).lines(np.zeros((1, PUMA.n))):
        assert (np.linalg.norm(np.diff(line[0], axis=0), axis=1) <= 0.081).all()


@pytest.mark.parametrize("low_m", [-0.9, -0.4, -0.1, 0.2])
def test_whichever_way_a_body_slides_its_points_are_close_together_and_its_shortest_length_is_known(
    low_m: float,
) -> None:
    stanford = load_robot("stanford")
    joint, limits = int(stanford.prismatic.argmax()), stanford.limits
    q_min, q_max = limits.q_min.copy(), limits.q_max.copy()
    q_min[joint], q_max[joint] = low_m, low_m + 0.5
    robot = stanford.model_copy(update={"limits": limits.model_copy(update={"q_min": q_min, "q_max": q_max})})
    q = np.zeros((101, robot.n))
    q[:, joint] = np.linspace(low_m, low_m + 0.5, len(q))
    lines = LinkLines(robot)
    body = lines.lines(q)[1 + joint]
    steps = np.linalg.norm(np.diff(body, axis=1), axis=2)
    assert steps.max() <= SPACING_M + 1e-9
    assert lines.lengths[1 + joint] == pytest.approx(steps.sum(axis=1).min(), abs=0.006)


@pytest.mark.parametrize(
    ("degrees", "clear"),
    [
        ((0, -90, 90, 0, 0, 0), True),
        ((0, 0, 90, 0, 0, 0), True),  # stretched level, at shoulder height
        ((0, 43, 90, 0, 0, 0), False),  # stretched, pointing at the floor
        ((0, 43, 235, 0, 0, 0), False),  # folded in below the shoulder
    ],
)
def test_floor_and_column_are_kept_away_from(degrees: tuple[float, ...], clear: bool) -> None:
    assert Clearance(PUMA).of_pose(np.radians(degrees)) is clear


@pytest.mark.parametrize(("bend", "clear"), [(100.0, False), (-100.0, True), (0.0, True)])
def test_a_hand_bent_into_its_own_upper_arm_is_refused_and_one_bent_away_is_not(bend: float, clear: bool) -> None:
    q = np.radians(FOLDED)
    q[4] = np.radians(bend)
    assert Clearance(PUMA).of_pose(q) is clear


@pytest.mark.parametrize("name", ["puma560", "stanford"])
def test_named_poses_of_a_robot_are_clear_of_itself(name: str) -> None:
    robot = load_robot(name)
    assert all(Clearance(robot).of_pose(robot.poses[pose]) for pose in ("ready", "park", "end"))


def test_a_way_is_looked_at_all_along() -> None:
    begin, end = np.radians([0, -60, 90, 0, 0, 0]), np.radians([0, -120, 90, 0, 0, 0])
    assert Clearance(PUMA).of_way(begin, end)
    through_floor = np.radians([0, 43, 90, 0, 0, 0])
    assert not Clearance(PUMA).of_way(through_floor + (begin - through_floor), 2 * through_floor - begin)


def test_a_path_is_refused_for_what_is_between_its_poses() -> None:
    """The wrist turns half round with the hand bent: on the way the hand comes through the upper arm."""
    away, into = np.radians([0, -90, 240, -90, 100, 0]), np.radians([0, -90, 240, 90, 100, 0])
    assert Clearance(PUMA).of_path(np.array([away, away]))
    assert Clearance(PUMA).of_path(np.array([into, into]))
    assert not Clearance(PUMA).of_path(np.array([away, into]))


def placed(gravity: np.ndarray, height_m: float, turn: float = 0.0) -> Robot:
    """A PUMA that feels such gravity, frame 0 at a height over the floor and turned about its x."""
    alpha = PUMA.geometry.alpha_rad.copy()
    alpha[0] += turn
    place = {"gravity_m_s2": np.asarray(gravity), "base_height_m": height_m, "alpha_rad": alpha}
    return PUMA.model_copy(update={"geometry": PUMA.geometry.model_copy(update=place)})


def heights_of_flange(robot: Robot) -> np.ndarray:
    """Of the poses drawn, over the floor."""
    up = -robot.geometry.gravity_m_s2 / np.linalg.norm(robot.geometry.gravity_m_s2)
    return np.array([Arm(robot).flange(q)[:3, 3] @ up for q in DRAWN]) + robot.geometry.base_height_m


@pytest.mark.parametrize("turn", [0.4, -1.3, 2.5])
def test_how_its_base_frame_lies_makes_no_difference_to_an_arm(turn: float) -> None:
    g = PUMA.geometry
    turned = placed(rot_x(turn) @ g.gravity_m_s2, g.base_height_m, turn)
    clear = Clearance(PUMA).of_poses(DRAWN)
    np.testing.assert_array_equal(Clearance(turned).of_poses(DRAWN), clear)
    assert 0.1 < clear.mean() < 0.9


@pytest.mark.parametrize("gravity", [(9.81, 0.0, 0.0), (0.0, -9.81, 0.0), (0.0, 0.0, 9.81), (0.0, 6.0, 7.0)])
@pytest.mark.parametrize("height_m", [0.4, 0.7])
def test_an_arm_on_a_wall_on_a_slant_or_that_hangs_keeps_off_the_floor_below_it(
    gravity: tuple[float, float, float], height_m: float
) -> None:
    robot = placed(np.array(gravity), height_m)
    clear, heights = Clearance(robot).of_poses(DRAWN), heights_of_flange(robot)
    assert heights.min() < 0.2
    assert clear.any()
    assert heights[clear].min() >= 0.25


@pytest.mark.parametrize("gravity", [(9.81, 0.0, 0.0), (0.0, 0.0, 9.81)])
def test_an_arm_high_on_a_wall_or_below_a_ceiling_keeps_off_itself_alone(gravity: tuple[float, float, float]) -> None:
    floating = Clearance(placed(np.zeros(3), 5.0)).of_poses(DRAWN)
    high = Clearance(placed(np.array(gravity), 5.0)).of_poses(DRAWN)
    assert high[floating].all()  # of a floating arm a column is known besides, below its base frame
    assert (high & ~floating).any()
