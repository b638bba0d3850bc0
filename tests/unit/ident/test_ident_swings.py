"""Swings of a recording: forwards and back through one place belong together, and the ways between them stand alone."""

from __future__ import annotations

from functools import cache

import numpy as np

from qrobot.config import Robot
from qrobot.ident.base import base_of_robot
from qrobot.ident.compact_recording import load_recording
from qrobot.ident.observe import Observations, Observer
from qrobot.ident.regressor import gravity_regressor
from qrobot.ident.swings import swings_of
from tests.support.observations import PUMA, TWO_SPEEDS, drawn, generated

POSES = 12
SWEEPS = 18  # of six joints at three speeds


@cache
def recorded() -> tuple[Robot, Observations]:
    """Passes of a whole plan, made in lock-step: the ways from swing to swing are steady passes too."""
    recording = load_recording("unknown_arm")
    robot, regressor = recording.robot, gravity_regressor(recording.robot)
    base = base_of_robot(robot, regressor)
    return robot, Observer(robot, regressor, base).observe(recording.rows, recording.period_s)


def passes_of(robot: Robot, seen: Observations) -> list[list[int]]:
    """Numbers of the passes of each swing."""
    swing = swings_of(robot, seen)
    return [np.unique(seen.passed[swing == number]).tolist() for number in range(swing.max() + 1)]


def rates(robot: Robot, seen: Observations, passed: int) -> np.ndarray:
    """Speeds of the motors in a pass, zero where one is not observed."""
    found, mine = np.zeros(robot.n), seen.passed == passed
    found[seen.motor[mine]] = seen.rate[mine]
    return found


def test_every_swing_of_a_plan_is_its_two_passes_and_each_way_between_stands_alone() -> None:
    robot, seen = recorded()
    swings = passes_of(robot, seen)
    assert sum(len(swing) == 2 for swing in swings) == POSES + SWEEPS
    assert {len(swing) for swing in swings} == {1, 2}
    for forwards, back in (swing for swing in swings if len(swing) == 2):
        np.testing.assert_allclose(rates(robot, seen, back), -rates(robot, seen, forwards), rtol=0.02)
    assert any(swing[0] % 2 for swing in swings if len(swing) == 2)  # pairs by number would be others


def test_a_pass_that_is_lost_leaves_the_other_swings_as_they_are() -> None:
    robot, seen = recorded()
    swings = passes_of(robot, seen)
    lost = next(swing[0] for swing in swings if len(swing) == 2)
    left = [[each for each in swing if each != lost] for swing in swings]
    assert passes_of(robot, seen.only(seen.passed != lost)) == left


def test_passes_through_one_place_at_two_speeds_are_two_swings() -> None:
    seen = generated(*drawn(0), 0.01, 0, poses=3, speeds=TWO_SPEEDS)
    assert passes_of(PUMA, seen) == [[2 * swing, 2 * swing + 1] for swing in range(6)]


def test_the_same_way_twice_or_elsewhere_is_no_swing() -> None:
    seen = generated(*drawn(0), 0.01, 0, poses=1, speeds=TWO_SPEEDS[:1])
    seen.rate[seen.passed == 1] *= -1.0
    assert passes_of(PUMA, seen) == [[0], [1]]
    seen.rate[seen.passed == 1] *= -1.0
    seen.q[seen.passed == 1] += 0.1
    assert passes_of(PUMA, seen) == [[0], [1]]
