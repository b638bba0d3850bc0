"""Arms of one program that keep their paths: the others wait for the one that was stopped, and all go on together."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from random import Random

import numpy as np
import pytest

from qrobot import rci
from qrobot.arrays import Floats
from qrobot.errors import MotionError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.model.transform import inverse
from qrobot.multi_rccl import (
    EQ,
    TL,
    TRANS,
    RobotManip,
    jposition,
    keep_path,
    kept,
    make_position,
    move,
    rccl_control,
    rccl_open,
    rccl_release,
    resume,
    retract,
    setvel,
    tracking_mode,
    wait_as,
    wait_for,
)
from qrobot.multi_rccl.program import _program
from qrobot.rccl import gentr_rpy
from qrobot.rccl.program import ending
from qrobot.rci import VirtualLink
from qrobot.wire import Mode
from tests.support.fake_robot import FakeRobot
from tests.support.kept_path import ROUNDING, SLOW, fail
from tests.support.puma import LIMITS, PARK, PERIOD_S
from tests.support.puma import arm as puma
from tests.support.rccl_table import turning_from_park
from tests.support.two_hands import HERE, THERE, TOOL, WORLD, carry, reach

NAMES = ("left", "right")


@pytest.fixture
def fakes() -> Iterator[dict[str, FakeRobot]]:
    robots = {name: FakeRobot(tuple(PARK)) for name in NAMES}
    token = _program.set(None)
    links = {name: lambda hello, robot=robot: VirtualLink(hello, robot.transfer) for name, robot in robots.items()}
    with rci.use(links), ending():
        yield robots
    _program.reset(token)


def apart(left: RobotManip, right: RobotManip) -> Floats:
    """The right hand in the left one, as both are sent. Shape (4, 4)."""
    hands = [inverse(WORLD[arm.name].value) @ arm.trans.value @ TOOL.value for arm in (left, right)]
    return np.asarray(inverse(hands[0]) @ hands[1])


def gentle(path: Floats) -> bool:
    """Setpoints (samples, n) keep the limits of speed and acceleration."""
    speeds, bends = np.abs(np.diff(path, axis=0)) / PERIOD_S, np.abs(np.diff(path, n=2, axis=0)) / PERIOD_S**2
    return bool((speeds <= LIMITS.v_max * (1.0 + ROUNDING)).all() and (bends <= LIMITS.a_max * 1.01).all())


@pytest.mark.parametrize("seed", range(3))
def test_two_hands_wait_with_what_they_carry_for_the_one_that_was_stopped_and_carry_on(
    fakes: dict[str, FakeRobot], seed: int
) -> None:
    random = Random(seed)
    way, at = random.choice(("stop", "fault")), random.randint(4, 25)
    obj, (left, right) = reach()
    for arm in (left, right):
        keep_path(arm)
    held = apart(left, right)
    carry(obj)
    begin = left.channel.how.t_ns
    wait_as(lambda: left.channel.how.t_ns >= begin + at * PERIOD_S * 1e9)
    fail(fakes["left"], way)
    wait_as(lambda: kept(left))
    assert "STREAM_LOST" in kept(left) or "FOLLOWING" in kept(left)
    assert not kept(right)
    begin = left.channel.how.t_ns
    wait_as(lambda: left.channel.how.t_ns > begin + 1.5e9)
    waited = obj.trans.value.copy(), right.j6.copy()
    back = len(fakes["left"].path)
    wait_as(lambda: left.channel.how.t_ns > begin + 2e9)
    assert (obj.trans.value == waited[0]).all()  # all that hangs together stands
    assert (right.j6 == waited[1]).all()
    assert not obj.completed.count
    resume(left)
    wait_as(lambda: not kept(left) and fakes["left"].mode is Mode.TRACKING)
    off = []
    wait_as(lambda: off.append(np.abs(apart(left, right) - held).max()) or obj.completed.count)
    assert np.abs(obj.trans.value - THERE.value).max() < ROUNDING
    assert max(off[-20:]) < ROUNDING
    after = np.array(fakes["left"].path[back:])
    assert gentle(after[1:])
    assert gentle(np.array(fakes["right"].path))
    first = np.abs(np.diff(after[: len(after) // 8], axis=0))
    assert first.size == 0 or (first <= SLOW).all()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("first", NAMES)
@pytest.mark.parametrize("way", ["stop", "fault"])
def test_two_hands_that_were_both_stopped_go_back_one_after_the_other_and_carry_on(
    fakes: dict[str, FakeRobot], way: str, first: str
) -> None:
    """As by the one emergency stop of their cell."""
    obj, robots = reach()
    for arm in robots:
        keep_path(arm)
    held = apart(*robots)
    carry(obj)
    begin = robots[0].channel.how.t_ns
    wait_as(lambda: robots[0].channel.how.t_ns >= begin + 15 * PERIOD_S * 1e9)
    for fake in fakes.values():
        fail(fake, way)
    wait_as(lambda: all(kept(arm) for arm in robots))
    stopped = robots[0].channel.how.t_ns
    wait_as(lambda: robots[0].channel.how.t_ns > stopped + 2e9)  # what they hold comes to rest
    back = {name: len(fake.path) for name, fake in fakes.items()}
    for arm in sorted(robots, key=lambda arm: arm.name != first):
        resume(arm)
        since = arm.channel.how.t_ns
        wait_as(lambda arm=arm, since=since: arm.channel.how.t_ns > since + 1e9)
    off = []
    wait_as(lambda: off.append(np.abs(apart(*robots) - held).max()) or obj.completed.count)
    assert np.abs(obj.trans.value - THERE.value).max() < ROUNDING
    assert max(off[-20:]) < ROUNDING
    assert all(gentle(np.array(fake.path[back[name] + 1 :])) for name, fake in fakes.items())


def test_when_one_hand_cannot_stay_with_what_both_hold_the_other_one_stops_with_it_and_the_program_is_told(
    fakes: dict[str, FakeRobot],
) -> None:
    obj, robots = reach()
    held = apart(*robots)
    setvel(obj, 100, 30)
    move(obj, make_position(TRANS, EQ, gentr_rpy("FAR", 1100, 0, 0, 0, 170, 0), TL, TRANS))
    with pytest.raises(MotionError, match=r"(left|right) cannot stay at the place .*all arms and objects come to rest"):
        wait_for(obj.completed)
    begin = robots[0].channel.how.t_ns
    wait_as(lambda: robots[0].channel.how.t_ns > begin + 1e9)
    rest = [np.array(fake.path[-2:]) for fake in fakes.values()]
    assert all((path[0] == path[1]).all() for path in rest)
    assert np.abs(apart(*robots) - held).max() < 0.05  # where the one that could go on was 0.4 m away
    assert obj.trans.value[0, 3] < 1.0
    move(obj, make_position(TRANS, EQ, HERE, TL, TRANS))  # and it goes on as it is told
    wait_for(obj.completed)


def test_a_program_that_ends_without_a_look_is_told_of_the_hand_that_was_lost(fakes: dict[str, FakeRobot]) -> None:
    obj, robots = reach()
    setvel(obj, 100, 30)
    move(obj, make_position(TRANS, EQ, gentr_rpy("FAR", 1100, 0, 0, 0, 170, 0), TL, TRANS))
    with pytest.raises(MotionError, match=r"the program has ended, .* cannot stay at the place"):
        robots[0].channel.finish()


def test_a_hand_that_is_lost_does_not_give_up_the_path_that_another_arm_keeps(fakes: dict[str, FakeRobot]) -> None:
    arms = [rccl_open(name) for name in NAMES]
    for arm in arms:
        rccl_control(arm)
    keep_path(arms[0])
    tracking_mode(arms[1])
    stays = make_position(TRANS, EQ, *turning_from_park(), TL, TRANS)
    move(arms[1], stays)
    wait_as(lambda: stays.code == -1)
    goal = jposition(arms[0], "END", (np.degrees(PARK) + np.array([40.0, 0, 0, 0, 0, 0])).tolist())
    move(arms[0], goal)
    wait_as(lambda: goal.scal > 0.1)
    fail(fakes["left"], "fault")
    with pytest.raises(MotionError, match="right cannot stay at the place"):
        wait_as(lambda: False)
    assert kept(arms[0])
    resume(arms[0])
    wait_as(lambda: arms[0].completed.count)
    assert goal.code == -1


def test_an_arm_on_a_path_of_its_own_waits_on_it_and_one_that_keeps_no_path_ends_the_program_s_hold(
    fakes: dict[str, FakeRobot],
) -> None:
    arms = [rccl_open(name) for name in NAMES]
    goals = []
    for arm, turn in zip(arms, (40.0, -40.0), strict=True):
        rccl_control(arm)
        goals.append(jposition(arm, "END", (np.degrees(PARK) + np.array([turn, 0, 0, 0, 0, 0])).tolist()))
        move(arm, goals[-1])
    keep_path(arms[0])
    wait_as(lambda: goals[0].scal > 0.3)
    fail(fakes["left"], "fault")
    wait_as(lambda: kept(arms[0]) and arms[1].channel.rate == 0.0)
    between = goals[1].scal
    assert 0.3 < between < 0.9
    resume(arms[0])
    wait_as(lambda: arms[0].completed.count and arms[1].completed.count)
    assert [goal.code for goal in goals] == [-1, -1]
    for name, goal in zip(NAMES, goals, strict=True):
        assert fakes[name].q == pytest.approx(goal.q, abs=1e-4)
    move(arms[0], goals[1])
    move(arms[1], goals[0])
    wait_as(lambda: goals[0].scal > 0.3)
    fail(fakes["right"], "stop")
    with pytest.raises(ServoFault):
        wait_as(lambda: False)


def test_on_virtual_time_a_wait_for_arms_of_which_nobody_lets_one_go_back_ends_with_what_has_stopped_it(
    fakes: dict[str, FakeRobot], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("qrobot.rci.standstill.HELD_S", 12.0)
    arms = [rccl_open(name) for name in NAMES]
    for arm, turn in zip(arms, (40.0, -40.0), strict=True):
        rccl_control(arm)
        keep_path(arm)
        move(arm, jposition(arm, "END", (np.degrees(PARK) + np.array([turn, 0, 0, 0, 0, 0])).tolist()))
    fakes["right"].before_period = lambda seq: fail(fakes["right"], "fault") if seq == 30 else None
    with pytest.raises(MotionError, match=r"12 s of virtual time.*FOLLOWING"):
        wait_as(lambda: all(arm.completed.count for arm in arms))
    for arm in arms:
        with suppress(ServoFault):
            rccl_release(arm)


@pytest.mark.parametrize("both", [False, True], ids=["one", "one another"])
def test_an_arm_goes_back_from_what_it_met_while_the_other_stands(fakes: dict[str, FakeRobot], both: bool) -> None:
    arms = [rccl_open(name) for name in NAMES]
    for arm, turn in zip(arms, (40.0, -40.0), strict=True):
        rccl_control(arm)
        retract(arm, 50.0)
        move(arm, jposition(arm, "END", (np.degrees(PARK) + np.array([turn, 0, 0, 0, 0, 0])).tolist()))
    wait_as(lambda: fakes["left"].q[0] > 0.2)
    met = [name for name in NAMES if both or name == "left"]
    for name in met:
        fakes[name].halt(FaultCode.COLLISION)
    far = {name: len(fakes[name].path) for name in NAMES}
    with pytest.raises(ServoFault, match="COLLISION"):
        wait_as(lambda: False)
    for name in met:
        before, back = np.array(fakes[name].path[: far[name]]), np.array(fakes[name].path[far[name] :])
        assert flange_m(back) == pytest.approx(0.05, abs=0.003)
        assert (
            np.abs(back[:, None] - before[None]).max(axis=2).min(axis=1).max() < 0.0065
        )  # rad; setpoints lie 0.012 apart
    if not both:
        other = np.array(fakes["right"].path)
        assert gentle(other)
        assert np.ptp(other[-10:], axis=0).max() == 0.0  # it stood before the left one was there
        assert 0.2 < abs(other[-1][0] - PARK[0]) < 0.6
    with suppress(ServoFault):  # of the other one, which the program has not heard of
        rccl_release(arms[1])


def test_no_arm_goes_back_with_what_another_one_holds_as_well(fakes: dict[str, FakeRobot]) -> None:
    obj, hands = reach()
    for arm in hands:
        retract(arm, 50.0)
    carry(obj)
    begin = len(fakes["left"].path)
    wait_as(lambda: len(fakes["left"].path) > begin + 15)
    assert not obj.completed.count
    fakes["left"].halt(FaultCode.COLLISION)
    held = fakes["left"].q
    with pytest.raises(ServoFault, match="COLLISION"):
        wait_as(lambda: False)
    assert fakes["left"].q == held


def flange_m(path: Floats) -> float:
    """How far the flange travels along setpoints (samples, n)."""
    return float(np.linalg.norm(np.diff([puma().forward(q)[:3, 3] for q in path], axis=0), axis=1).sum())
