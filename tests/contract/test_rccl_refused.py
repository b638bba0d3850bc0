"""What a program says for one motion counts again when that is refused, if the next one goes to the same position."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from qrobot import multi_rccl, rccl, rci
from qrobot.errors import MotionError, Unreachable
from qrobot.motion import Termination
from qrobot.motion.planning.request_queue import QUEUE_SIZE
from qrobot.rccl import gentr_trsl, trsl
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.program import ending
from qrobot.rci import VirtualLink
from qrobot.wire import RobotState
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK, arm
from tests.support.rccl_table import TABLE, TIP, on_table, programmed

DONE = Termination.COMPLETED
Refusal = Callable[[Callable[[], None]], None]
shift = gentr_trsl("SHIFT", 0, 0, 0)
P = on_table("P", shift)


class BehindRobot(FakeRobot):
    """Its shoulder stays behind its reference by so many rad."""

    behind = 0.0

    def _state(self) -> RobotState:
        state = super()._state()
        return replace(state, q_setpoint=tuple(state.q + np.array([0.0, self.behind, 0.0, 0.0, 0.0, 0.0])))


@pytest.fixture
def robot() -> Iterator[FakeRobot]:
    with programmed() as fake:
        go()
        yield fake


def go(position: rccl.Position = P) -> None:
    rccl.move(position)
    rccl.waitfor(rccl.completed)


def height(robot: FakeRobot) -> float:
    """Of the tip along z of the table, mm, when the robot has taken the last setpoint."""
    begin = rccl.time
    rccl.waitas(lambda: rccl.time > begin + 60.0)
    return float(1000.0 * (np.linalg.inv(TABLE.value) @ arm().forward(np.array(robot.q)) @ TIP)[2, 3])


def out_of_reach(say: Callable[[], None]) -> None:
    say()
    trsl(shift, -3000, 0, 0)
    with pytest.raises(Unreachable):
        rccl.move(P)
    trsl(shift, 0, 0, 0)


def in_another_configuration(say: Callable[[], None]) -> None:
    say()
    rccl.setconf("ruf")
    with pytest.raises(MotionError, match="no straight line"):
        rccl.move(P)
    rccl.setconf("")


def without_room(say: Callable[[], None]) -> None:
    for _ in range(QUEUE_SIZE):
        rccl.move(P)
    say()
    with pytest.raises(MotionError, match="no room"):
        rccl.move(P)
    rccl.stop(0)
    rccl.waitfor(rccl.completed)


refusals = pytest.mark.parametrize("refuse", [out_of_reach, in_another_configuration, without_room])


@refusals
def test_a_distance_counts_again_and_once(robot: FakeRobot, refuse: Refusal) -> None:
    refuse(lambda: rccl.distance("dz", -10))
    go()
    assert height(robot) == pytest.approx(-10.0, abs=1e-6)
    go()
    assert height(robot) == pytest.approx(0.0, abs=1e-6)


@refusals
def test_a_monitor_counts_again_and_once(robot: FakeRobot, refuse: Refusal) -> None:
    refuse(lambda: rccl.evalfn(lambda: 5))
    codes = []
    for _ in range(2):
        go()
        codes.append(P.code)
    assert codes == [5, DONE]


@refusals
def test_a_time_counts_again_and_once(robot: FakeRobot, refuse: Refusal) -> None:
    refuse(lambda: rccl.setime(280, 2800))
    took = []
    for _ in range(2):
        begin = rccl.time
        go()
        took.append(rccl.time - begin)
    assert took[0] > 2800.0 > took[1]


@refusals
def test_an_update_counts_again_and_once(robot: FakeRobot, refuse: Refusal) -> None:
    pin = gentr_trsl("PIN", 0, 0, -50)
    refuse(lambda: rccl.update(pin, on_table("MEASURED", pin)))
    for _ in range(2):
        go()
        assert pin.p.z == pytest.approx(0.0, abs=1e-3)
        rccl.distance("dz", -10)


@refusals
def test_a_limit_counts_again_and_once(refuse: Refusal) -> None:
    fake = BehindRobot(tuple(PARK))
    with rccl.use(lambda hello: VirtualLink(hello, fake.transfer)), rccl.control("puma560"):
        rccl.setmode("cartesian")
        rccl.setvel(200, 90)
        go()
        fake.behind = 0.02  # 11 mm at the tool
        refuse(lambda: rccl.limit("dz", 5.0))
        codes = []
        for _ in range(2):
            go()
            codes.append(P.code)
        assert codes == [Termination.MOTION_LIMIT, DONE]


def test_what_is_said_again_takes_the_place_of_what_was_said(robot: FakeRobot) -> None:
    """As in a loop that says everything before each try."""
    pin = gentr_trsl("PIN", 0, 0, -50)
    measured = on_table("MEASURED", pin)

    def say(dz: float) -> None:
        rccl.distance("dz", dz)
        rccl.update(pin, measured)

    out_of_reach(lambda: say(-10))
    say(-20)
    go()
    assert pin.p.z == pytest.approx(-20.0, abs=0.5)
    rccl.update(pin, measured)
    with pytest.raises(MotionError, match="has to update PIN already"):
        rccl.update(pin, measured)


def test_a_motion_to_another_place_is_not_meant_and_ends_it(robot: FakeRobot) -> None:
    """A program that cannot go on goes home, which is no guarded motion."""
    home = on_table("HOME")
    out_of_reach(lambda: rccl.distance("dz", -10))
    for position in (home, P):
        go(position)
        assert height(robot) == pytest.approx(0.0, abs=1e-6)


# -------------------------------------------------------------------------------------------- several manipulators


@pytest.fixture
def manips() -> Iterator[tuple[multi_rccl.RobotManip, multi_rccl.Manip]]:
    token = multi_rccl.program._program.set(None)
    with rci.use({"left": OfflineLink}), ending():
        left, obj = multi_rccl.rccl_open("left"), multi_rccl.rccl_open("OBJECT_FRAME")
        multi_rccl.rccl_control(left)
        multi_rccl.rccl_control(obj)
        assert isinstance(left, multi_rccl.RobotManip)
        yield left, obj
    multi_rccl.program._program.reset(token)


def at(*terms: rccl.Transform) -> rccl.Position:
    return multi_rccl.make_position(multi_rccl.TRANS, multi_rccl.EQ, *terms, multi_rccl.TL, multi_rccl.TRANS)


def test_a_monitor_of_a_frame_counts_again_and_once(manips) -> None:
    _, obj = manips
    p, codes = at(gentr_trsl("UP", 0, 0, 90)), []
    multi_rccl.evalfn(obj, lambda: 5)
    multi_rccl.setvel(obj, 1e-200, 1e-200)
    with pytest.raises(MotionError, match="more samples than can be counted"):
        multi_rccl.move(obj, p)
    multi_rccl.setvel(obj, 90, 90)
    for _ in range(2):
        multi_rccl.move(obj, p)
        multi_rccl.wait_for(obj.completed)
        codes.append(p.code)
    assert codes == [5, DONE]


def test_an_arm_that_may_not_maintain_a_place_does_not_stay_with_the_goal_of_its_next_motion(manips) -> None:
    left, obj = manips
    hand = gentr_trsl("HAND", 0, 0, 0)
    hand.set(left.trans.value)
    held = at(obj.trans, hand)
    multi_rccl.comply(left, "fz", 1e6)
    with pytest.raises(MotionError, match="ask for less"):
        multi_rccl.maintain(left, held)
    multi_rccl.lock(left, "fz")
    multi_rccl.move(left, held)
    multi_rccl.wait_for(left.completed)
    stood = np.array(left.trans.value)
    multi_rccl.move(obj, at(gentr_trsl("UP", 0, 0, 90)))
    multi_rccl.wait_for(obj.completed)
    assert np.array_equal(left.trans.value, stood)
