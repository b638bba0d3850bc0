"""The way back after a collision: over the path just travelled, slow, from rest to rest, and once."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import LinkLost, MotionError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.motion import motion_limits
from qrobot.motion.kept.retreat import MOST_TURN, NEAR, slow_setpoints
from qrobot.rci import VirtualLink
from qrobot.wire import Mode
from tests.support.fake_robot import INTERVENTIONS, FakeRobot
from tests.support.kept_path import check_way_back
from tests.support.puma import PARK, ROBOT
from tests.support.puma import arm as puma

VIA, END = (np.degrees(PARK) + np.array(turn) for turn in ([40.0, -10, 5, 0, 0, 0], [20.0, 15, -10, 20, 0, 0]))
LENGTH_M = 0.04


@pytest.fixture
def fake() -> Iterator[FakeRobot]:
    robot = FakeRobot(tuple(PARK))
    with rccl.use(lambda hello: VirtualLink(hello, robot.transfer)):
        yield robot


def go(arm: rccl.Channel) -> None:
    for name, goal in (("VIA", VIA), ("END", END)):
        arm.move(arm.jposition(name, goal.tolist()))


def flange(path: np.ndarray) -> np.ndarray:
    return np.array([puma().forward(q)[:3, 3] for q in path])


def told(arm: rccl.Channel) -> ServoFault:
    with pytest.raises(ServoFault) as fault:
        arm.waitfor(arm.completed)
    return fault.value


@pytest.mark.parametrize("seed", range(6))
def test_at_any_instant_the_arm_goes_back_over_the_places_that_it_came_by(fake: FakeRobot, seed: int) -> None:
    random = Random(seed)
    thrown = np.array([random.uniform(-0.02, 0.02) for _ in PARK])
    with rccl.control("puma560") as arm:
        arm.retract(1e3 * LENGTH_M)
        go(arm)
        arm.waitas(lambda: arm.time > random.uniform(300, 1700))
        fake.halt(FaultCode.COLLISION)
        fake.q = tuple(np.array(fake.q) + thrown)
        before = np.array(fake.path)
        assert told(arm).code == FaultCode.COLLISION
    back = np.array(fake.path)[len(before) :]
    check_way_back(back)
    off = np.abs(back[:, None] - before[None]).max(axis=2).min(axis=1)
    assert off.max() < 0.03  # what the arm was thrown off by
    assert off[-1] < 0.005  # and is on its path again; setpoints lie further apart than that
    gone = np.linalg.norm(np.diff(flange(before), axis=0), axis=1).sum()
    way = np.linalg.norm(np.diff(flange(back), axis=0), axis=1).sum()
    assert abs(way - min(LENGTH_M, gone)) < 0.03


def test_the_arm_goes_back_over_no_ground_that_it_travelled_before_going_back_was_switched_off(fake: FakeRobot) -> None:
    with rccl.control("puma560") as arm:
        arm.retract(1e3 * LENGTH_M)
        arm.move(arm.jposition("VIA", VIA.tolist()))
        arm.waitfor(arm.completed)
        arm.retract(0)
        arm.move(arm.jposition("END", END.tolist()))
        arm.waitfor(arm.completed)
        arm.retract(1e3 * LENGTH_M)
        arm.move(arm.jposition("PARK", np.degrees(PARK).tolist()))
        begin = arm.time
        arm.waitas(lambda: arm.time > begin + 200)
        fake.halt(FaultCode.COLLISION)
        before = len(fake.path)
        assert told(arm).code == FaultCode.COLLISION
    back, way = np.array(fake.path)[before:], np.radians(END) - PARK
    shares = (back - PARK) @ way / (way @ way)
    assert np.abs(back - PARK - shares[:, None] * way).max() < 1e-3
    assert shares.max() < 1.001
    assert np.degrees(back[-1]) == pytest.approx(END, abs=0.1)


@pytest.mark.parametrize("seed", range(8))
def test_an_arm_that_has_been_there_before_goes_back_by_the_way_it_came_last(fake: FakeRobot, seed: int) -> None:
    """Out and back over one line, and on the way back it meets something; it may have been thrown about by that."""
    random = Random(seed)
    there = np.degrees(PARK) + np.array([40.0, 0, 0, 0, 0, 0])
    thrown = np.array([random.uniform(-0.002, 0.002), *(random.uniform(-0.03, 0.03) for _ in PARK[1:])])
    with rccl.control("puma560") as arm:
        arm.retract(1e3 * LENGTH_M)
        for _ in range(2):
            arm.move(arm.jposition("THERE", there.tolist()))
            arm.move(arm.jposition("PARK", np.degrees(PARK).tolist()))
        half = PARK[0] + np.radians(random.uniform(10.0, 22.0))
        arm.waitas(lambda: np.degrees(fake.q[0] - PARK[0]) > 28.0)
        arm.waitas(lambda: fake.q[0] < half)
        fake.halt(FaultCode.COLLISION)
        met = fake.q[0]
        fake.q = tuple(np.array(fake.q) + thrown)
        before = len(fake.path)
        assert told(arm).code == FaultCode.COLLISION
    back = np.array(fake.path)[before:]
    check_way_back(back)
    assert back[:, 0].min() > met - 0.005  # what it met is on the other side
    assert back[-1, 0] > met + 0.04


@pytest.mark.parametrize("pushed", [0.05, 0.2])
def test_an_arm_that_was_soft_and_pushed_back_goes_on_from_there(fake: FakeRobot, pushed: float) -> None:
    """It came slowly: what it came by last is little of its way."""
    with rccl.control("puma560") as arm:
        arm.retract(1e3 * LENGTH_M)
        arm.setjvel(0.05)
        arm.move(arm.jposition("THERE", (np.degrees(PARK) + np.array([40.0, 0, 0, 0, 0, 0])).tolist()))
        arm.waitas(lambda: fake.q[0] - PARK[0] > 0.4)
        fake.halt(FaultCode.COLLISION)
        fake.q = (fake.q[0] - pushed, *fake.q[1:])
        held, before = fake.q[0], len(fake.path)
        assert told(arm).code == FaultCode.COLLISION
    back = np.array(fake.path)[before:]
    check_way_back(back)
    assert back[:, 0].max() < held + 1e-3  # never towards what it met
    assert back[-1, 0] < held - 0.04


def test_a_way_back_of_the_wrist_alone_has_its_bound_too_and_stays_near_what_was_travelled(fake: FakeRobot) -> None:
    """The flange's origin does not move when the last joint turns, and ten strokes are too many for a smooth way."""
    with rccl.control("puma560") as arm:
        arm.retract(20.0)
        for _ in range(5):
            for turn in (30.0, 0.0):
                arm.move(arm.jposition("TURNED", (np.degrees(PARK) + np.array([0, 0, 0, 0, 0, turn])).tolist()))
        began = arm.time
        arm.waitas(lambda: arm.time > began + 2000 and abs(fake.q[5] - PARK[5]) > 0.2)
        fake.halt(FaultCode.COLLISION)
        before = len(fake.path)
        assert told(arm).code == FaultCode.COLLISION
    back = np.array(fake.path)[before:]
    check_way_back(back)
    assert np.abs(np.diff(back[:, 5])).sum() < MOST_TURN + 0.05
    assert np.ptp(back[:, :5], axis=0).max() < 1e-9
    assert (back[:, 5] - PARK[5]).min() > -NEAR
    assert (back[:, 5] - PARK[5]).max() < np.radians(30.0) + NEAR


def test_a_way_that_is_too_winding_is_gone_as_far_as_a_smooth_one_stays_near_it() -> None:
    arm, limits = puma(), motion_limits(ROBOT)
    strokes = np.linspace(0.0, 20.0 * np.pi, 800)
    way = PARK + np.outer(np.sin(strokes), [0.03, 0.0, 0.0, 0.0, 0.0, 0.0])
    gone = slow_setpoints(way, limits, 0.028, arm.forward)
    off = np.abs(gone[:, None] - way[None]).max(axis=2).min(axis=1)
    assert off.max() < NEAR
    assert np.abs(np.diff(gone[:, 0])).sum() > 0.02  # and it is gone


@pytest.mark.parametrize("why", ["another fault", "no way behind it", "not wanted"])
def test_an_arm_stays_where_it_is_when_there_is_nothing_to_go_back_from(fake: FakeRobot, why: str) -> None:
    with rccl.control("puma560") as arm:
        arm.retract(0 if why == "not wanted" else 50)
        if why != "no way behind it":
            go(arm)
            arm.waitas(lambda: arm.time > 700)
        code = FaultCode.STREAM_LOST if why == "another fault" else FaultCode.COLLISION
        fake.halt(code)
        before = len(fake.path)
        if why == "no way behind it":
            go(arm)
        assert told(arm).code == code
    assert all(np.abs(np.array(q) - fake.path[before - 1]).max() < 1e-9 for q in fake.path[before:])


@pytest.mark.parametrize("keeps", [False, True])
def test_an_arm_whose_servo_starts_anew_before_it_has_gone_back_stays_without_power(
    fake: FakeRobot, keeps: bool
) -> None:
    with rccl.control("puma560") as arm:
        if keeps:
            arm.keep_path()
        arm.retract(50)
        go(arm)
        arm.waitas(lambda: arm.time > 700)
        met = fake.seq + 1
        fake.before_period = lambda seq: {met: lambda: fake.halt(FaultCode.COLLISION), met + 1: fake.start_anew}.get(
            seq, lambda: None
        )()
        if keeps:
            arm.waitas(lambda: arm.time > 3000)
            assert "away" in arm.kept
            arm.stop()
        with pytest.raises(LinkLost, match="servo was away"):
            arm.waitfor(arm.completed)
    assert fake.mode is Mode.OFF


@pytest.mark.parametrize("how", ["met again", "stopped", "stopped before", "stopped at first"])
def test_what_comes_between_on_the_way_back_ends_it(fake: FakeRobot, how: str) -> None:
    with rccl.control("puma560") as arm:
        arm.retract(200)
        go(arm)
        arm.waitas(lambda: arm.time > 1200)
        fake.halt(FaultCode.COLLISION)
        before = len(fake.path)
        if how.startswith("stopped "):
            begin = arm.time
            arm.waitas(lambda: how == "stopped before" or arm.time > begin)
            arm.stop()
        else:
            arm.waitas(lambda: fake.mode is Mode.TRACKING and len(fake.path) > before + 30)
        there = len(fake.path)
        if how == "stopped":
            arm.stop()
        elif how == "met again":
            fake.halt(FaultCode.COLLISION)
        assert told(arm).code == FaultCode.COLLISION
    after = np.array(fake.path[there - 1 :])
    assert len(after) <= 20
    assert not how.startswith("stopped ") or np.ptp(after, axis=0).max() < 1e-9


@pytest.mark.parametrize("who", ["program", "operator"])
def test_a_pause_on_the_way_back_ends_it_and_the_path_waits_from_there(fake: FakeRobot, who: str) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        arm.retract(200)
        go(arm)
        arm.waitas(lambda: arm.time > 1200)
        fake.halt(FaultCode.COLLISION)
        before = len(fake.path)
        arm.waitas(lambda: fake.mode is Mode.TRACKING and len(fake.path) > before + 30)
        there = len(fake.path)
        if who == "program":
            arm.pause()
        fake.paused = who == "operator"
        arm.waitas(lambda: arm.kept)
        assert len(fake.path) <= there + 30
        assert "COLLISION" in arm.kept
        fake.paused = False
        arm.resume()
        arm.waitfor(arm.completed)
    assert np.degrees(fake.q) == pytest.approx(END)


def test_a_stop_on_the_way_back_gives_a_kept_path_up(fake: FakeRobot) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        arm.retract(200)
        go(arm)
        arm.waitas(lambda: arm.time > 1200)
        fake.halt(FaultCode.COLLISION)
        arm.waitas(lambda: arm.off_path)
        arm.stop()
        assert told(arm).code == FaultCode.COLLISION


@pytest.mark.parametrize("keeps", [False, True])
@pytest.mark.parametrize("later", range(5))
@pytest.mark.parametrize("what", INTERVENTIONS)
def test_an_arm_that_somebody_stops_or_a_fault_before_it_goes_back_stays_so(
    fake: FakeRobot, what: str, later: int, keeps: bool
) -> None:
    """Nothing is cleared, powered or moved that nobody has asked for."""
    with rccl.control("puma560") as arm:
        if keeps:
            arm.keep_path()
        arm.retract(50)
        go(arm)
        arm.waitas(lambda: arm.time > 700)
        at, before = len(fake.commands), len(fake.path)
        met = fake.script((0, FakeRobot.meet), (3, FakeRobot.rest), (later, INTERVENTIONS[what]))
        if keeps:
            arm.waitas(lambda: arm.kept and fake.seq > met + 50)
            arm.stop()
        assert told(arm).code == (FaultCode.RUNAWAY if what == "a fault" else FaultCode.COLLISION)
        fake.rest()
        mode = {"a fault": Mode.FAULT, "power off": Mode.OFF, "a stop": Mode.HOLDING}[what]
        assert fake.mode is mode
    assert fake.mode is mode
    assert not any(command.clear_fault for command in fake.commands[at:])
    assert np.ptp(fake.path[before:], axis=0).max() < 1e-9


@pytest.mark.parametrize("keeps", [False, True])
def test_a_stop_that_was_asked_for_when_the_way_back_was_about_to_begin_ends_it(fake: FakeRobot, keeps: bool) -> None:
    with rccl.control("puma560") as arm:
        if keeps:
            arm.keep_path()
        arm.retract(50)
        go(arm)
        arm.waitas(lambda: arm.time > 700)
        fake.halt(FaultCode.COLLISION)
        before = len(fake.path)
        arm.waitas(lambda: fake.mode is Mode.TRACKING)
        fake.tell_stop_before_stream()
        if keeps:
            begin = arm.time
            arm.waitas(lambda: arm.time > begin + 1000.0)
            assert "COLLISION" in arm.kept
            assert fake.mode is Mode.HOLDING
            arm.stop()
        assert told(arm).code == FaultCode.COLLISION
    assert np.ptp(fake.path[before:], axis=0).max() < 1e-9


@pytest.mark.parametrize("what", ["power off", "a stop"])
def test_a_push_from_before_the_motion_is_no_reason_to_go_back_after_a_stop(fake: FakeRobot, what: str) -> None:
    with rccl.control("puma560") as arm:
        arm.retract(50)
        fake.event = FaultCode.COLLISION
        go(arm)
        arm.waitas(lambda: arm.time > 700)
        INTERVENTIONS[what](fake)
        before = len(fake.path)
        told(arm)
    assert len(fake.path) == before


@pytest.mark.parametrize("later", range(1, 9))
@pytest.mark.parametrize("what", INTERVENTIONS)
def test_what_comes_between_the_word_to_go_on_and_the_way_to_the_path_waits_for_another_word(
    fake: FakeRobot, what: str, later: int
) -> None:
    """The word comes while the servo still brings the arm to rest."""
    with rccl.control("puma560") as arm:
        arm.keep_path()
        go(arm)
        arm.waitas(lambda: arm.time > 700)
        at, before = len(fake.commands), len(fake.path)
        met = fake.script(
            (0, FakeRobot.meet), (3, lambda _: arm.resume()), (10, FakeRobot.rest), (3 + later, INTERVENTIONS[what])
        )
        arm.waitas(lambda: fake.seq > met + 60)
        assert arm.kept
        assert not any(command.clear_fault for command in fake.commands[at:])
        assert len(fake.path) == before or np.ptp(fake.path[before:], axis=0).max() < 1e-9
        fake.before_period = None
        arm.resume()
        arm.waitfor(arm.completed)
    assert np.degrees(fake.q) == pytest.approx(END)


@pytest.mark.parametrize("wrong", [-1.0, 301.0, float("nan")])
def test_a_way_back_has_a_length_that_can_be(fake: FakeRobot, wrong: float) -> None:
    with rccl.control("puma560") as arm, pytest.raises(MotionError, match="retract"):
        arm.retract(wrong)
