"""The numbered examples, run as they are, against a robot that follows perfectly."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.config import load_robot
from qrobot.rci import VirtualLink
from tests.support.fake_robot import FakeRobot

EXAMPLES = Path(__file__).parents[2] / "examples"
PERIOD_S = 0.028
SLOW = 0.35


def run(name: str, robot: FakeRobot) -> None:
    with rccl.use(lambda hello: VirtualLink(hello, robot.transfer)):
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")


def test_park_and_return_is_the_papers_experiment(capsys) -> None:
    """S-15: park to end at constant speed, back at triple speed."""
    poses = load_robot("puma560").poses
    robot = FakeRobot(tuple(poses["park"]))
    run("01_park_and_return.py", robot)
    path = np.array(robot.path)
    furthest = np.abs(path - poses["park"]).max(axis=1).argmax()
    assert path[furthest] == pytest.approx(poses["end"])
    assert path[-1] == pytest.approx(poses["park"])
    speed = np.abs(np.diff(path, axis=0)).max(axis=1) / PERIOD_S
    cruise_out, cruise_back = speed[:furthest].max(), speed[furthest:].max()
    assert (cruise_out, cruise_back) == pytest.approx((SLOW, 3 * SLOW), rel=0.02)
    # at constant speed for as long as the distance takes, less what the two transitions of 392 ms take off
    distance = np.abs(poses["end"] - poses["park"]).max()
    for cruise, leg in ((SLOW, speed[:furthest]), (3 * SLOW, speed[furthest:])):
        assert (leg > 0.99 * leg.max()).sum() * PERIOD_S == pytest.approx(distance / cruise - 0.392, abs=3 * PERIOD_S)
    assert len(re.findall(r"^.* \d+\.\d\d s, now at", capsys.readouterr().out, re.MULTILINE)) == 3
    assert robot.goodbyes


def test_a_busy_program_asks_for_the_next_place_while_its_arm_goes_to_the_one_before(capsys) -> None:
    robot = FakeRobot(tuple(load_robot("puma560").poses["park"]))
    run("23_busy_program.py", robot)
    path = np.array(robot.path)
    assert np.abs(path - path[0]).max() > 0.05  # rad: it has been there
    assert path[-1] == pytest.approx(path[0], abs=0.01)  # the sixth place is within a millimetre of the beginning
    assert "6 places, and no stop on the way" in capsys.readouterr().out
