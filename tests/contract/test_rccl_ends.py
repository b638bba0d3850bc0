"""How a program in Python ends: well, and its motions are done first; or by an error, and the arm stops."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from itertools import count

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import MotionError
from qrobot.motion import Termination
from qrobot.rccl import EQ, TL, gentr_rot, gentr_trsl, makeposition, newtrans, t6, yunit
from qrobot.rccl.program import ending
from qrobot.rci import VirtualLink
from qrobot.wire import Hello
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK

GOAL_DEG = [10.0, -50.0, 175.0, 0.0, 45.0, 0.0]


@pytest.fixture
def robot() -> Iterator[FakeRobot]:
    fake = FakeRobot(tuple(PARK))
    with rccl.use(lambda hello: VirtualLink(hello, fake.transfer)):
        yield fake
        rccl.release()


def asked() -> rccl.Position:
    """A goal that two motions are to lead to."""
    goal = rccl.jposition("GOAL", GOAL_DEG)
    rccl.move(rccl.park)
    rccl.move(goal)
    return goal


def arrived(robot: FakeRobot) -> bool:
    return robot.goodbyes == 1 and np.allclose(robot.q, np.radians(GOAL_DEG), rtol=0, atol=1e-9)


def test_the_end_of_a_with_block_waits_for_its_motions(robot) -> None:
    with rccl.control():
        goal = asked()
    assert goal.code == Termination.COMPLETED
    assert arrived(robot)


def test_an_error_in_a_with_block_stops_the_arm_at_once(robot) -> None:
    goals: list[rccl.Position] = []

    def program() -> None:
        with rccl.control():
            goals.append(asked())
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        program()
    assert goals[0].code == Termination.STOPPED
    assert robot.goodbyes == 1


def test_release_stops_the_arm_at_once_as_it_says(robot) -> None:
    rccl.control()
    goal = asked()
    rccl.release()
    assert goal.code == Termination.STOPPED


@pytest.mark.parametrize("end", [lambda: None, sys.exit, lambda: sys.exit(0)])
def test_a_program_that_ends_well_has_its_motions_done(robot, end) -> None:
    with suppress(SystemExit), ending():
        rccl.control()
        goal = asked()
        end()
    assert goal.code == Termination.COMPLETED
    assert arrived(robot)


@pytest.mark.parametrize("error", [SystemExit(1), SystemExit("no part"), KeyboardInterrupt(), ValueError()])
def test_a_program_that_ends_badly_has_its_arm_stopped(robot, error) -> None:
    goals: list[rccl.Position] = []

    def program() -> None:
        with ending():
            rccl.control()
            goals.append(asked())
            raise error

    with pytest.raises(type(error)):
        program()
    assert goals[0].code == Termination.STOPPED
    assert robot.goodbyes == 1


def goes_out_of_reach() -> None:
    with rccl.control() as arm:
        away = newtrans("OUT", lambda t: setattr(t.p, "x", 400.0 + 0.5 * arm.time))
        e, table = gentr_trsl("E", 0, 0, 100), gentr_rot("T", 0, 50, -300, yunit, 180)
        arm.setmode("cartesian")
        arm.setvel(100, 90)
        arm.move(makeposition("AWAY", t6, e, EQ, table, away, TL, e))


def test_a_last_motion_that_cannot_be_done_is_an_error_and_the_arm_is_let_go(robot) -> None:
    with pytest.raises(MotionError, match=r"puma560: the program has ended, but not all its motions were done: AWAY"):
        goes_out_of_reach()
    assert robot.goodbyes == 1


ARMS = 8


@pytest.fixture
def left() -> Iterator[list[int]]:
    """Numbers of arms, in the order in which a program that takes `ARMS` of them has let go of them."""
    gone: list[int] = []

    def link(hello: Hello) -> VirtualLink:
        number, fake = next(numbers), FakeRobot(tuple(PARK))

        def transfer(data: bytes) -> bytes:
            before, answer = fake.goodbyes, fake.transfer(data)
            gone.extend([number] * (fake.goodbyes - before))
            return answer

        return VirtualLink(hello, transfer)

    numbers = count()
    with rccl.use(link):
        yield gone


def test_several_arms_end_in_the_order_in_which_they_were_taken(left: list[int]) -> None:
    with ending():
        for arm in [rccl.control() for _ in range(ARMS)]:
            arm.move(rccl.jposition("GOAL", GOAL_DEG))
    assert left == list(range(ARMS))


def test_when_one_arm_cannot_do_its_motions_all_are_let_go_of_and_its_error_is_told(left: list[int]) -> None:
    def program() -> None:
        with ending():
            arms = [rccl.control() for _ in range(3)]
            away = newtrans("OUT", lambda t: setattr(t.p, "x", 400.0 + 0.5 * arms[0].time))
            e, table = gentr_trsl("E", 0, 0, 100), gentr_rot("T", 0, 50, -300, yunit, 180)
            arms[0].setmode("cartesian")
            arms[0].setvel(100, 90)
            arms[0].move(makeposition("AWAY", t6, e, EQ, table, away, TL, e))

    with pytest.raises(MotionError, match="not all its motions were done: AWAY"):
        program()
    assert left == [0, 1, 2]


SCRIPT = """
from qrobot import rccl
from qrobot.rccl.offline import OfflineLink
used = rccl.use(OfflineLink)
used.__enter__()
seen.append(rccl.control().jposition("GOAL", [10, -50, 175, 0, 45, 0]))
rccl.move(seen[0])
"""


@pytest.mark.parametrize(("last", "code"), [("", Termination.COMPLETED), ("raise ValueError", Termination.STOPPED)])
def test_a_script_of_a_plain_interpreter_ends_as_one_of_qrobot_run(last: str, code: int) -> None:
    script = f"import atexit\nseen = []\natexit.register(lambda: print(int(seen[0].code)))\n{SCRIPT}{last}\n"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert done.stdout == f"{int(code)}\n"
