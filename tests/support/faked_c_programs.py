"""Programs in C on an arm that is faked: the fixtures that tests of how they end share, and where the arm is then."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from qrobot import rccl
from qrobot.rccl.c.program import run_executable
from qrobot.rci import VirtualLink
from qrobot.wire import Mode
from tests.support.c_programs import compiled_text
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK

MOVING = """
    POS_PTR p = jposition("P", 40., -90., 180., 0., 0., 0.);
    setime(100, 4000);
    move(p);
    waitas(p->scal > .3)
"""
Run = Callable[[str], int]


@pytest.fixture
def robot() -> Iterator[FakeRobot]:
    fake = FakeRobot(tuple(PARK))
    with rccl.use(lambda hello: VirtualLink(hello, fake.transfer)):
        yield fake


@pytest.fixture
def run(robot: FakeRobot, tmp_path: Path) -> Run:
    """The exit status of a program with this text."""
    return lambda text: run_executable(compiled_text(text, tmp_path))


def at_rest(robot: FakeRobot) -> bool:
    """The program let go of it in order: whoever breaks off leaves it tracking."""
    return bool(robot.goodbyes) and robot.mode is Mode.HOLDING


def part_of_the_way(robot: FakeRobot) -> bool:
    """Where `MOVING` leaves it."""
    return 0.1 < robot.path[-1][0] - PARK[0] < 0.6


def rests_on_its_way(robot: FakeRobot) -> bool:
    return at_rest(robot) and part_of_the_way(robot)
