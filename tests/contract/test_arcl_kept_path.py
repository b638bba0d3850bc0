"""Motions of ARCL that outlive a stop of the servo, as those of RCCL do (tests/unit/rccl/test_kept_path.py)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest

from qrobot import rci
from qrobot.arcl import (
    ARCL_AMI,
    EQ,
    EVENT_DONE,
    EVENT_STOP,
    MOV_TIME,
    MOV_TRAJ,
    T6,
    TL,
    TRAJ_CART,
    Motion,
    arcl_close,
    arcl_keep_path,
    arcl_kept,
    arcl_open,
    arcl_pause,
    arcl_resume,
    arcl_wait,
    joint_pos,
    makeposition,
    move,
    stop,
)
from qrobot.arcl.robot import ArclRobot
from qrobot.errors import MotionError, ServoFault
from qrobot.rci import VirtualLink
from qrobot.wire import Mode
from tests.support.arcl import forget_programs
from tests.support.fake_robot import FakeRobot
from tests.support.kept_path import check_goes_on, fail
from tests.support.puma import PARK


@pytest.fixture
def fake() -> Iterator[FakeRobot]:
    robot = FakeRobot(tuple(PARK))
    forget_programs()
    with rci.use(lambda hello: VirtualLink(hello, robot.transfer)):
        yield robot
    forget_programs()


def motions(rp: ArclRobot) -> list[Motion]:
    """By its joints round a place, and on in a straight line."""
    via, end = (rp.joints + np.array(turn) for turn in ([40.0, -10, 5, 0, 0, 0], [20.0, 15, -10, 20, 0, 0]))
    goal = rp.fkine(end.tolist(), "END")
    straight = makeposition(T6, EQ, goal, TL, goal)
    return [
        move(rp, joint_pos(rp, "VIA", via.tolist()), MOV_TIME, 1500, 0),
        move(rp, straight, MOV_TRAJ, TRAJ_CART, MOV_TIME, 1500, 0),
    ]


def path_of(fake: FakeRobot, way: str | None, sample: int, who: str = "program") -> tuple[np.ndarray, int, set[str]]:
    """Setpoints of the two motions, the arm being stopped at one of their samples; how many came before, and `kept`."""
    rp = arcl_open(ARCL_AMI, "bridge")
    rp.keep_path()
    asked, begin, told = motions(rp), fake.seq, set()
    first = len(fake.path)
    before: list[int] = []

    def interfere(seq: int) -> None:
        told.add(rp.kept)
        if way is None or seq < begin + sample:
            return
        if seq == begin + sample:
            fail(fake, way)
            before.append(len(fake.path) - first)
        if who == "operator":
            fake.paused = begin + sample + 20 <= seq < begin + sample + 30
        elif seq == begin + sample + 30:
            rp.resume()

    fake.before_period = interfere
    arcl_wait(rp)
    fake.before_period = None
    assert [motion.code for motion in asked] == [EVENT_DONE, EVENT_DONE]
    arcl_close(rp)
    return np.array(fake.path[first:]), before[0] if before else 0, told


@pytest.mark.parametrize(
    ("way", "sample", "who"), [("stop", 30, "operator"), ("fault", 54, "program"), ("fault", 80, "operator")]
)
def test_the_path_goes_on_where_a_stop_of_the_servo_has_left_it(
    fake: FakeRobot, way: str, sample: int, who: str
) -> None:
    nominal, _, _ = path_of(fake, None, 0)
    fake.q = tuple(PARK)
    path, stopped, told = path_of(fake, way, sample, who)
    assert len(told) == 2  # why, and nothing
    check_goes_on(path[:stopped], path[stopped:], nominal, way)
    assert path[-1] == pytest.approx(nominal[-1], abs=1e-6)


def test_without_that_wish_a_stop_of_the_servo_ends_control_and_a_wish_is_checked(fake: FakeRobot) -> None:
    rp = arcl_open(ARCL_AMI, "bridge")
    for wrong in ({"way_back_mm": -1.0}, {"way_back_deg": float("nan")}, {"way_back_mm": "far"}):
        with pytest.raises(MotionError, match="keep_path"):
            rp.keep_path(**wrong)
    motions(rp)
    arcl_wait(rp, lambda: rp.treal > 500.0)
    fail(fake, "stop")
    with pytest.raises(ServoFault):
        arcl_wait(rp)


@pytest.mark.parametrize("end", ["arcl_wait", "arcl_close"])
@pytest.mark.parametrize("how", ["kept", "paused"])
def test_on_virtual_time_a_wait_for_an_arm_that_nobody_lets_go_on_ends_with_the_reason(
    fake: FakeRobot, monkeypatch: pytest.MonkeyPatch, how: str, end: str
) -> None:
    monkeypatch.setattr("qrobot.rci.standstill.HELD_S", 12.0)
    rp = arcl_open(ARCL_AMI, "bridge")
    rp.keep_path()
    motions(rp)
    if how == "paused":
        arcl_pause(rp)
    else:
        fake.before_period = lambda seq: fail(fake, "fault") if seq == 40 else None
    reason = "holds its motions itself" if how == "paused" else "FOLLOWING"
    with pytest.raises(MotionError, match=rf"12 s of virtual time.*resume.*{reason}"):
        (arcl_wait if end == "arcl_wait" else arcl_close)(rp)
    with suppress(ServoFault):
        rp.abandon()


def test_a_way_back_that_is_too_long_waits_until_more_is_allowed_and_a_stop_gives_the_path_up(fake: FakeRobot) -> None:
    rp = arcl_open(ARCL_AMI, "bridge")
    arcl_keep_path(rp, way_back_mm=5.0)
    asked = motions(rp)
    arcl_wait(rp, lambda: rp.treal > 500.0)
    fail(fake, "fault")
    arcl_wait(rp, lambda: rp.kept)
    rp.resume()
    arcl_wait(rp, lambda: "5 mm" in rp.kept)
    assert "way back to the path is too long" in arcl_kept(rp)
    arcl_keep_path(rp)
    arcl_resume(rp)
    arcl_wait(rp, lambda: not rp.kept)
    assert [motion.code for motion in asked] == [None, None]
    stop(rp, 0)
    with pytest.raises(ServoFault, match="FOLLOWING"):
        arcl_wait(rp)
    assert asked[1].code is EVENT_STOP


@pytest.mark.parametrize("when", ["paused", "resumed", "on the way back"])
def test_a_servo_that_starts_anew_has_nobody_s_word_that_the_arm_may_go_back(fake: FakeRobot, when: str) -> None:
    rp = arcl_open(ARCL_AMI, "bridge")
    rp.keep_path()
    rp.setload(2.0)
    asked, fake.told = motions(rp), []
    arcl_wait(rp, lambda begin=rp.treal: rp.treal > begin + 500.0)
    fail(fake, "fault")
    fake.paused = when == "paused"
    arcl_wait(rp, lambda: rp.kept)
    arcl_wait(rp, lambda begin=rp.treal: rp.treal > begin + 200.0)
    if when == "on the way back":
        arcl_resume(rp)
        arcl_wait(rp, lambda: fake.mode is Mode.TRACKING)
    fake.before_period = (lambda _: rp.resume()) if when == "resumed" else None
    fake.start_anew()
    arcl_wait(rp, lambda: fake.mode is Mode.OFF)
    fake.before_period = None
    said, followed = len(fake.commands), len(fake.path)
    arcl_wait(rp, lambda begin=rp.treal: rp.treal > begin + 3000.0)
    assert rp.kept
    assert not any(command.power or command.clear_fault for command in fake.commands[said + 1 :])
    assert (fake.mode, len(fake.path)) == (Mode.OFF, followed)
    assert [packet.mass for _, packet in fake.told] == [2.0]  # the load, which the servo has forgotten
    arcl_resume(rp)
    arcl_wait(rp)
    assert [motion.code for motion in asked] == [EVENT_DONE, EVENT_DONE]
    arcl_close(rp)


def test_a_pause_holds_the_arm_on_its_path_and_on_the_way_back_until_the_program_goes_on(fake: FakeRobot) -> None:
    def stands() -> bool:
        """For a second, once a pause has had one to take effect."""
        begin, q = rp.treal, []
        arcl_wait(rp, lambda: rp.treal > begin + 1000.0)
        arcl_wait(rp, lambda: q.append(rp.joints) or rp.treal > begin + 2000.0)
        return bool(np.ptp(q, axis=0).max() < 1e-9)

    rp = arcl_open(ARCL_AMI, "bridge")
    arcl_keep_path(rp)
    asked = motions(rp)
    arcl_wait(rp, lambda: rp.treal > 500.0)
    arcl_pause(rp)
    assert stands()
    assert (rp.off_path, rp.kept) == (False, "")
    fail(fake, "fault")
    arcl_wait(rp, lambda: rp.kept)
    arcl_resume(rp)
    arcl_wait(rp, lambda: fake.mode is Mode.TRACKING)
    arcl_pause(rp)
    assert stands()
    assert rp.off_path
    assert "paused" in arcl_kept(rp)
    arcl_resume(rp)
    arcl_wait(rp)
    assert [motion.code for motion in asked] == [EVENT_DONE, EVENT_DONE]


@pytest.mark.parametrize("layer", ["ceded", "loops", "stepper"])
def test_a_machine_that_cannot_take_an_arm_again_refuses_to_keep_a_path(layer: str) -> None:
    forget_programs()
    rp = arcl_open(ARCL_AMI, layer)
    with pytest.raises(MotionError, match=f"machine layer '{layer}' cannot take an arm again"):
        rp.keep_path()
    arcl_close(rp)
