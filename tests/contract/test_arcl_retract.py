"""The way back of ARCL from what an arm has met, as that of RCCL (tests/unit/rccl/test_retreat.py)."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random

import numpy as np
import pytest

from qrobot import rci
from qrobot.arcl import ARCL_AMI, ARCL_PERIOD, EVENT_DONE, MOV_TIME, Motion, arcl_open, arcl_retract, joint_pos, move
from qrobot.arcl.robot import ArclRobot
from qrobot.errors import MotionError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.rci import VirtualLink, thread_driver
from qrobot.wire import Mode
from tests.support.fake_robot import INTERVENTIONS, FakeRobot, PassingBridge
from tests.support.kept_path import check_way_back
from tests.support.puma import PARK
from tests.support.puma import arm as puma

pytestmark = pytest.mark.usefixtures("arcl_alone")

LENGTH_MM = 40.0
TURN = np.array([40.0, -10, 5, 0, 0, 0])
PATIENCE = 100  # periods without a command, of a robot in real time


@pytest.fixture
def fake() -> Iterator[FakeRobot]:
    robot = FakeRobot(tuple(PARK))
    with rci.use(lambda hello: VirtualLink(hello, robot.transfer)):
        yield robot


def go(rp: ArclRobot, ms: int = 1500) -> Motion:
    return move(rp, joint_pos(rp, "END", (rp.joints + TURN).tolist()), MOV_TIME, ms, 0)


def going_back(fake: FakeRobot, rp: ArclRobot) -> int:
    """Let the arm meet something, and go half of its way back; how many setpoints were followed before."""
    rp.wait(lambda: rp.treal > 1000.0)
    fake.halt(FaultCode.COLLISION)
    before = len(fake.path)
    rp.wait(lambda: fake.mode is Mode.TRACKING and len(fake.path) > before + 30)
    return len(fake.path)


def told(rp: ArclRobot) -> int:
    with pytest.raises(ServoFault) as fault:
        rp.wait()
    return fault.value.code


@pytest.mark.parametrize("seed", range(4))
def test_at_any_instant_the_arm_goes_back_over_the_places_that_it_came_by(fake: FakeRobot, seed: int) -> None:
    random = Random(seed)
    rp = arcl_open(ARCL_AMI, "bridge")
    arcl_retract(rp, LENGTH_MM)
    go(rp)
    rp.wait(lambda: rp.treal > random.uniform(700.0, 1400.0))
    fake.halt(FaultCode.COLLISION)
    before = np.array(fake.path)
    assert told(rp) == FaultCode.COLLISION
    back = np.array(fake.path)[len(before) :]
    check_way_back(back)
    assert np.abs(back[:, None] - before[None]).max(axis=2).min(axis=1).max() < 0.02  # setpoints lie so far apart
    flange = np.array([puma().forward(q)[:3, 3] for q in back])
    assert np.linalg.norm(np.diff(flange, axis=0), axis=1).sum() == pytest.approx(1e-3 * LENGTH_MM, abs=0.01)


def test_the_arm_goes_back_over_no_ground_that_it_travelled_before_going_back_was_switched_off(fake: FakeRobot) -> None:
    rp = arcl_open(ARCL_AMI, "bridge")
    begin = rp.joints
    for mm, turn in ((LENGTH_MM, TURN), (0.0, np.array([20.0, 15, -10, 20, 0, 0]))):
        arcl_retract(rp, mm)
        move(rp, joint_pos(rp, "GOAL", (begin + turn).tolist()), MOV_TIME, 1500, 0)
        rp.wait()
    end = np.array(fake.path[-1])
    arcl_retract(rp, LENGTH_MM)
    move(rp, joint_pos(rp, "BEGIN", begin.tolist()), MOV_TIME, 1500, 0)
    now = rp.treal
    rp.wait(lambda: rp.treal > now + 250.0)
    fake.halt(FaultCode.COLLISION)
    before = len(fake.path)
    assert told(rp) == FaultCode.COLLISION
    back, way = np.array(fake.path[before:]), PARK - end
    assert np.abs(back - end - np.outer((back - end) @ way / (way @ way), way)).max() < 1e-3
    assert ((back - end) @ way).min() > -1e-3
    assert back[-1] == pytest.approx(end, abs=2e-3)


@pytest.mark.parametrize("why", ["another fault", "not wanted", "paused", "held by the operator", "nothing behind it"])
def test_an_arm_stays_where_it_is_when_there_is_nothing_to_go_back_from(fake: FakeRobot, why: str) -> None:
    rp = arcl_open(ARCL_AMI, "bridge")
    arcl_retract(rp, 0.0 if why == "not wanted" else LENGTH_MM)
    if why != "nothing behind it":
        go(rp)
        rp.wait(lambda: rp.treal > 700.0)
    if why == "paused":
        rp.pause()
    fake.paused = why == "held by the operator"
    rp.wait(lambda: rp.treal > 1500.0)
    code = FaultCode.STREAM_LOST if why == "another fault" else FaultCode.COLLISION
    fake.halt(code)
    before = len(fake.path)
    if why == "nothing behind it":
        go(rp)
    assert told(rp) == code
    assert all(np.abs(np.array(q) - fake.path[before - 1]).max() < 1e-9 for q in fake.path[before:])


@pytest.mark.parametrize("how", ["met again", "stop", "pause", "the operator's pause"])
@pytest.mark.parametrize("kept", [False, True])
def test_what_comes_between_on_the_way_back_ends_it(fake: FakeRobot, how: str, kept: bool) -> None:
    """The program is told, or its motion waits, unless `stop` gives that up."""
    rp = arcl_open(ARCL_AMI, "bridge")
    if kept:
        rp.keep_path()
    rp.retract(200.0)
    motion = go(rp)
    there = going_back(fake, rp)
    assert rp.off_path
    assert rp.kept == ""
    if how == "met again":
        fake.halt(FaultCode.COLLISION)
    elif how == "stop":
        rp.stop()
    elif how == "pause":
        rp.pause()
    fake.paused = how == "the operator's pause"
    if not kept or how == "stop":
        assert told(rp) == FaultCode.COLLISION
        after = np.array(fake.path[there - 1 :])
        assert len(after) <= 30
        assert how != "met again" or np.ptp(after, axis=0).max() < 1e-9
        return
    rp.wait(lambda: rp.kept)
    assert "COLLISION" in rp.kept
    fake.paused = False
    rp.resume()
    rp.wait()
    assert motion.code is EVENT_DONE


@pytest.mark.parametrize("later", range(5))
@pytest.mark.parametrize("what", INTERVENTIONS)
def test_an_arm_that_somebody_stops_or_a_fault_before_it_goes_back_stays_so(
    fake: FakeRobot, what: str, later: int
) -> None:
    rp = arcl_open(ARCL_AMI, "bridge")
    arcl_retract(rp, LENGTH_MM)
    go(rp)
    rp.wait(lambda: rp.treal > 700.0)
    at, before = len(fake.commands), len(fake.path)
    fake.script((0, FakeRobot.meet), (3, FakeRobot.rest), (later, INTERVENTIONS[what]))
    assert told(rp) == (FaultCode.RUNAWAY if what == "a fault" else FaultCode.COLLISION)
    assert not any(command.clear_fault for command in fake.commands[at:])
    assert fake.mode is {"a fault": Mode.FAULT, "power off": Mode.OFF}.get(what, fake.mode)
    assert len(fake.path) == before or np.ptp(fake.path[before:], axis=0).max() < 1e-9


@pytest.mark.parametrize("wrong", [-1.0, 301.0, float("nan"), "far"])
def test_a_way_back_has_a_length_that_can_be(fake: FakeRobot, wrong: float) -> None:
    rp = arcl_open(ARCL_AMI, "bridge")
    with pytest.raises(MotionError, match="retract"):
        rp.retract(wrong)
    with pytest.raises(MotionError, match="arcl_retract: a robot is needed"):
        arcl_retract(None, LENGTH_MM)  # type: ignore[arg-type]


@pytest.mark.parametrize("layer", ["ceded", "loops", "stepper"])
def test_a_machine_that_cannot_take_an_arm_again_refuses(layer: str) -> None:
    rp = arcl_open(ARCL_AMI, layer)
    with pytest.raises(MotionError, match=f"machine layer '{layer}' cannot take an arm again"):
        arcl_retract(rp, LENGTH_MM)


def test_off_line_nothing_is_met() -> None:
    rp = arcl_open(ARCL_AMI, "offline")
    arcl_retract(rp, LENGTH_MM)
    motion = go(rp)
    rp.wait()
    assert motion.code is EVENT_DONE


@pytest.mark.realtime
def test_a_motion_waits_when_the_bridge_is_lost_on_the_way_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thread_driver, "AGAIN_S", 0.02)
    fake = FakeRobot(tuple(PARK), period_us=4_000, patience=PATIENCE)
    bridge = PassingBridge(fake)
    with rci.use(bridge.link):
        with bridge:
            rp = arcl_open(ARCL_AMI, "bridge", ARCL_PERIOD, 4.0)
            rp.keep_path()
            rp.retract(200.0)
            motion = go(rp)
            going_back(fake, rp)
        fake.halt(FaultCode.STREAM_LOST)
        rp.wait(lambda: "lost" in rp.kept or "closed" in rp.kept)
        with bridge:
            begin = fake.seq
            rp.wait(lambda: fake.seq > begin + 20)
            rp.resume()
            rp.wait()
            assert motion.code is EVENT_DONE
            rp.close()
