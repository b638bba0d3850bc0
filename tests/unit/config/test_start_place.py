"""The place at which an arm begins that is not there."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.config.deployment import DeployedArm, load_deployment
from qrobot.config.start_place import BESIDE_RANGE, start_place, start_text
from qrobot.errors import ConfigError

SHARES = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6)


def arm_of(robot: str, pose: str = "park") -> DeployedArm:
    (arm,) = load_deployment("emulator").arm
    return arm.model_copy(update={"robot": robot, "board": arm.board.model_copy(update={"start_pose": pose})})


@pytest.mark.parametrize("robot", ["puma560", "stanford"])
def test_a_place_is_a_pose_or_all_joints_and_without_one_that_of_the_deployment_file(robot: str) -> None:
    known = load_robot(robot)
    for name, pose in known.poses.items():
        np.testing.assert_array_equal(start_place(name, arm_of(robot)), pose)
        np.testing.assert_array_equal(start_place(None, arm_of(robot, name)), pose)
    middle = 0.5 * (known.limits.q_min + known.limits.q_max)
    shown = np.where(known.prismatic, 1e3 * middle, np.degrees(middle))
    numbers = ",".join(map(str, shown))
    np.testing.assert_allclose(start_place(numbers, arm_of(robot)), middle, atol=1e-12)


@pytest.mark.parametrize("robot", ["puma560", "stanford"])
@given(shares=SHARES)
def test_what_is_written_of_a_place_is_read_as_that_place(robot: str, shares: list[float]) -> None:
    limits = load_robot(robot).limits
    q = limits.q_min + np.array(shares) * (limits.q_max - limits.q_min)
    np.testing.assert_allclose(start_place(start_text(q, load_robot(robot)), arm_of(robot)), q, atol=1e-6)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("nowhere", r"name a pose of puma560 \(zero, ready"),
        ("", "name a pose of puma560"),
        ("1,2,3", "each of 6 joints, not 3"),
        ("1,2,3,4,5,6,7", "each of 6 joints, not 7"),
        ("0,-90,90,0,0,nan", r"joint 6 \(.*\) is out of its range"),
        ("0,-90,90,0,inf,0", r"joint 5 \(.*\) is out of its range"),
        ("170,-90,90,0,0,0", r"joint 1 \(.*\) is out of its range"),
        ("0,-90,90,0,0,0;", "name a pose"),
    ],
)
def test_what_is_no_place_is_refused(text: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        start_place(text, arm_of("puma560"))


def test_an_arm_may_rest_at_the_very_end_of_a_range() -> None:
    robot = load_robot("puma560")
    q = robot.limits.q_max + 0.9 * BESIDE_RANGE
    np.testing.assert_allclose(start_place(start_text(q, robot), arm_of("puma560")), q, atol=1e-6)
