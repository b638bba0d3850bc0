"""Motions that outlive a stop of the servo: on the way back the arm is slow, and the path goes on where it was left."""

from __future__ import annotations

import re
from collections.abc import Iterator
from random import Random

import numpy as np
import pytest

from qrobot import rccl
from qrobot.config.fences import Fence
from qrobot.errors import FenceCrossed, MotionError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.in_force import use_fences
from qrobot.motion import Termination
from qrobot.rci import VirtualLink
from qrobot.rci.standstill import HELD_S
from qrobot.wire import Mode, Payload, Signals
from tests.support.fake_robot import FakeRobot
from tests.support.kept_path import check_goes_on, fail
from tests.support.puma import PARK, PERIOD_S, ROBOT
from tests.support.puma import arm as puma

VIA, END = (np.degrees(PARK) + np.array(turn) for turn in ([40.0, -10, 5, 0, 0, 0], [20.0, 15, -10, 20, 0, 0]))
ROUNDING = 1e-9
SOON_S = 20.0


@pytest.fixture
def fake() -> Iterator[FakeRobot]:
    robot = FakeRobot(tuple(PARK))
    with rccl.use(lambda hello: VirtualLink(hello, robot.transfer)):
        yield robot


def motions(arm: rccl.Channel) -> tuple[rccl.Position, rccl.Position]:
    """To a via point as joints go, and on in a straight line."""
    goal = rccl.newtrans("GOAL", "const")
    goal.set(puma().forward(np.radians(END)))
    via, end = arm.jposition("VIA", VIA.tolist()), rccl.makeposition("END", rccl.t6, rccl.EQ, goal, rccl.TL, goal)
    arm.move(via)
    arm.setmode("cartesian")
    arm.move(end)
    return via, end


def confirm(robot: FakeRobot, arm: rccl.Channel, who: str, begin: int) -> None:
    """What somebody does from sample `begin` on."""
    if who == "program":
        if robot.seq == begin:
            arm.resume()
    else:
        robot.paused = begin - 10 <= robot.seq < begin


@pytest.mark.parametrize("seed", range(8))
def test_the_path_goes_on_where_a_stop_of_the_servo_has_left_it(fake: FakeRobot, seed: int) -> None:
    random = Random(seed)
    way, who = random.choice(("stop", "fault")), random.choice(("program", "operator"))
    with rccl.control("puma560") as arm:
        arm.keep_path()
        via, end = motions(arm)
        plan = arm.plan()
        at = fake.seq + random.randint(3, int(plan.duration_s / PERIOD_S) - 3)

        def interfere(seq: int) -> None:
            if seq == at:
                fail(fake, way)
            if seq > at:
                confirm(fake, arm, who, at + 40)
                followed.append(len(fake.path))
            told.add(arm.kept)

        told: set[str] = set()
        followed: list[int] = []
        fake.before_period = interfere
        arm.waitfor(arm.completed)
        fake.before_period = None
        assert {via.code, end.code} == {Termination.COMPLETED}
        path = np.array(fake.path)
    assert len(told) == 2  # why, and nothing
    nominal = plan.table(np.linspace(0.0, plan.duration_s, 1_000))[:, 0]
    check_goes_on(path[: followed[0]], path[followed[0] :], nominal, way, same=1e-12)
    assert path[-1] == pytest.approx(np.radians(END), abs=1e-4)  # the last one is still to be followed


def test_without_that_wish_a_stop_of_the_servo_ends_the_program_s_hold(fake: FakeRobot) -> None:
    with rccl.control("puma560") as arm:
        motions(arm)
        arm.waitas(lambda: arm.time > 500)
        fake.halt(FaultCode.STREAM_LOST)
        with pytest.raises(ServoFault):
            arm.waitfor(arm.completed)


@pytest.mark.parametrize("when", ["kept", "on the way back"])
def test_a_program_that_stops_gives_the_path_up_and_is_told_why_the_servo_has_stopped_the_arm(
    fake: FakeRobot, when: str
) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path(way_back_mm=1000)
        motions(arm)
        arm.waitas(lambda: arm.time > 700)
        fail(fake, "fault")
        arm.waitas(lambda: arm.kept)
        if when == "on the way back":
            fake.q = tuple(np.array(fake.q) + 0.2)
            arm.resume()
            arm.waitas(lambda: fake.mode is Mode.TRACKING)
        arm.stop()
        with pytest.raises(ServoFault, match="FOLLOWING"):
            arm.waitfor(arm.completed)


def test_a_second_fault_on_the_way_back_waits_again_and_a_cause_that_stays_does_not_end_the_waiting(
    fake: FakeRobot,
) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        _, end = motions(arm)
        arm.waitas(lambda: arm.time > 700)
        fail(fake, "fault")
        arm.waitas(lambda: arm.kept)
        fake.refuse_power = True
        arm.resume()
        arm.waitas(lambda: "power" in arm.kept)
        fake.refuse_power = False
        for _ in range(2):
            begin = arm.time
            arm.resume()
            arm.waitas(lambda: fake.mode is Mode.TRACKING)
            fake.halt(FaultCode.STREAM_LOST)
            arm.waitas(lambda begin=begin: arm.time > begin + 1000)
            assert arm.kept
            assert end.code == Termination.NONE
        arm.resume()
        arm.waitfor(arm.completed)
        assert end.code == Termination.COMPLETED
        assert arm.kept == ""
        arm.setmode("joint")
        arm.move(arm.pose("park"))


@pytest.mark.parametrize("when", ["paused", "resumed", "powering", "on the way back"])
def test_a_servo_that_starts_anew_has_nobody_s_word_that_the_arm_may_go_back(fake: FakeRobot, when: str) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        _, end = motions(arm)
        arm.waitas(lambda: arm.time > 700)
        fail(fake, "stop" if when == "paused" else "fault")
        fake.paused = when == "paused"
        arm.waitas(lambda: arm.kept)
        if when == "powering":
            arm.resume()
            arm.waitas(lambda: fake.mode is Mode.POWERING)
        elif when == "on the way back":
            arm.resume()
            arm.waitas(lambda: fake.mode is Mode.TRACKING)
        else:
            arm.waitas(lambda begin=arm.time: arm.time > begin + 200)
        if when == "resumed":
            fake.before_period = lambda _: arm.resume()
        fake.start_anew()
        arm.waitas(lambda: fake.mode is Mode.OFF)
        fake.before_period = None
        stands_without_power(fake, arm)
        arm.resume()
        arm.waitfor(arm.completed)
        assert end.code == Termination.COMPLETED


def ended_on_the_way(fake: FakeRobot, arm: rccl.Channel, way: str) -> None:
    """Motions that the servo has ended in their midst; their path is kept."""
    motions(arm)
    arm.waitas(lambda: arm.time > 3000)
    fail(fake, way)
    arm.waitas(lambda: arm.kept)


def stands_without_power(fake: FakeRobot, arm: rccl.Channel) -> None:
    """For some seconds, while the arm waits for somebody's word."""
    said, followed = len(fake.commands), len(fake.path)
    arm.waitas(lambda begin=arm.time: arm.time > begin + 3000)
    assert arm.kept
    assert not any(command.power or command.clear_fault for command in fake.commands[said + 1 :])
    assert (fake.mode, len(fake.path)) == (Mode.OFF, followed)


@pytest.mark.parametrize("carries", [0.0, 1.0, 2.0])
def test_a_servo_that_starts_anew_is_told_what_the_program_carries_before_it_has_power(
    fake: FakeRobot, carries: float
) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        arm.setload(2.0, (0.0, 0.0, 40.0))
        arm.collision("comply")
        arm.log_signal("depth", 0.3)
        arm.waitas(lambda: any(isinstance(packet, Signals) for _, packet in fake.told))
        before, fake.told = fake.told, []
        ended_on_the_way(fake, arm, "fault")
        said = len(fake.commands)
        fake.start_anew()
        fake.payload_mass = carries  # which somebody else may have told it first
        arm.waitas(lambda begin=arm.time: arm.time > begin + 200)
        arm.resume()
        arm.waitfor(arm.completed)
    powered = next(n for n, command in enumerate(fake.commands) if n > said + 1 and command.power)
    assert all(said <= n < powered for n, _ in fake.told)
    told = [packet for _, packet in fake.told]
    assert [isinstance(packet, Payload) for packet in told].count(True) == (carries == 0.0)
    assert all(packet in [each for _, each in before] for packet in told)
    assert len(told) == 2 + (carries == 0.0)


@pytest.mark.parametrize("reached", [0.0, 1.3])
def test_a_load_is_told_until_a_servo_has_had_time_to_carry_it(fake: FakeRobot, reached: float) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        arm.setload(2.0)
        ended_on_the_way(fake, arm, "fault")
        fake.told = []
        for times in range(1, 4):  # each servo is away again before it carries the load
            fake.start_anew()
            arm.waitas(lambda begin=fake.seq: fake.seq > begin)
            fake.before_period = lambda _: setattr(fake, "payload_mass", reached)
            arm.waitas(lambda begin=arm.time: arm.time > begin + 200)
            assert [packet.mass for _, packet in fake.told] == [2.0] * times
            fake.before_period = None
        fake.payload_mass = 2.0
        arm.waitas(lambda begin=arm.time: arm.time > begin + 2000)
        fake.told, fake.payload_mass = [], 0.0  # by somebody else
        arm.waitas(lambda begin=arm.time: arm.time > begin + 200)
        fake.start_anew()
        arm.waitas(lambda begin=arm.time: arm.time > begin + 200)
        assert not fake.told
        arm.resume()
        arm.waitfor(arm.completed)


@pytest.mark.parametrize("way", ["stop", "fault", "power off by hand"])
def test_a_servo_that_was_away_for_a_moment_keeps_how_somebody_has_a_collision_told_since(
    fake: FakeRobot, way: str
) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        arm.collision("comply")
        ended_on_the_way(fake, arm, "fault" if way == "fault" else "stop")
        if way == "power off by hand":  # no fault is told of that
            fake.mode, fake.event = Mode.OFF, 0
        fake.told = []
        fake.be_away()
        arm.waitas(lambda begin=arm.time: arm.time > begin + 200)
        assert not fake.told
        arm.resume()
        arm.waitfor(arm.completed)


def test_a_load_that_somebody_takes_away_while_the_servo_is_away_for_a_moment_stays_away(fake: FakeRobot) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        arm.setload(2.0)
        ended_on_the_way(fake, arm, "fault")
        fake.told = []
        fake.be_away()
        fake.payload_mass = 0.0
        arm.waitas(lambda begin=arm.time: arm.time > begin + 200)
        assert not fake.told
        arm.resume()
        arm.waitfor(arm.completed)


def test_a_load_that_somebody_has_taken_away_is_not_told_to_the_next_servo(fake: FakeRobot) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        arm.setload(2.0)
        motions(arm)
        arm.waitas(lambda: arm.time > 3000)
        fail(fake, "fault")
        fake.payload_mass, fake.told = 0.0, []
        arm.waitas(lambda: arm.kept)
        fake.start_anew()
        arm.waitas(lambda begin=arm.time: arm.time > begin + 200)
        assert not fake.told
        arm.resume()
        arm.waitfor(arm.completed)


def test_a_pause_that_ends_on_the_way_back_lets_no_arm_go_that_is_stopped_there(fake: FakeRobot) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        motions(arm)
        arm.waitas(lambda: arm.time > 700)
        fail(fake, "fault")
        fake.paused = True
        arm.waitas(lambda begin=arm.time: arm.time > begin + 200)
        arm.resume()
        arm.waitas(lambda: fake.mode is Mode.TRACKING)
        fake.paused = False
        arm.waitas(lambda begin=arm.time: arm.time > begin + 200)
        assert arm.off_path
        fake.halt(FaultCode.STREAM_LOST)
        followed = len(fake.path)
        arm.waitas(lambda begin=arm.time: arm.time > begin + 3000)
        assert arm.kept
        assert len(fake.path) == followed
        arm.stop()
        with pytest.raises(ServoFault):
            arm.waitfor(arm.completed)


def test_a_way_back_through_a_fence_is_an_error_that_moves_nothing(fake: FakeRobot) -> None:
    turned = PARK + np.radians([40.0, 0, 0, 0, 0, 0])
    post = Fence(name="post", shape="box", size_m=(0.1, 0.1, 0.1), position_m=tuple(puma().forward(turned)[:3, 3]))
    with use_fences(FenceSet(ROBOT, [post])), rccl.control("puma560") as arm:
        arm.keep_path(way_back_mm=2000, way_back_deg=120)
        arm.move(arm.jposition("LIFTED", (np.degrees(PARK) + np.array([0, 0, -20, 0, 0, 0])).tolist()))
        arm.waitas(lambda: arm.time > 400)
        fake.halt(FaultCode.STREAM_LOST)
        arm.waitas(lambda: arm.kept)
        fake.q = tuple(PARK + np.radians([80.0, 0, 0, 0, 0, 0]))
        followed = len(fake.path)
        arm.resume()
        with pytest.raises(FenceCrossed, match=r"the way back to the path.*post"):
            arm.waitfor(arm.completed)
        assert len(fake.path) == followed


@pytest.mark.parametrize(
    ("moved", "told"),
    [
        ([0, 0, 0, 0, 0, 90.0], r"\d mm at the flange and 90 deg of flange, 300 mm and 45 deg are allowed"),
        ([0, 30.0, 0, 0, 0, 0], r"[34]\d\d mm at the flange and 30 deg of shoulder, 300 mm and 45 deg are allowed"),
    ],
)
def test_a_way_back_that_is_too_long_is_refused_before_power_and_waits_until_more_is_allowed(
    fake: FakeRobot, moved: list[float], told: str
) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        end = arm.jposition("LIFTED", (np.degrees(PARK) + np.array([0, 0, -20, 0, 0, 0])).tolist())
        arm.move(end)
        arm.waitas(lambda: arm.time > 400)
        fail(fake, "fault")
        arm.waitas(lambda: arm.kept)
        fake.q = tuple(np.array(fake.q) + np.radians(moved) - 0.02)
        followed, powered = len(fake.path), fake.seq
        arm.resume()
        arm.waitas(lambda: "too long" in arm.kept)
        assert re.search(told, arm.kept)
        assert (fake.mode, len(fake.path)) == (Mode.FAULT, followed)  # nothing was cleared, nothing moved
        assert all(command.path_waits for command in fake.commands if powered < command.ack <= fake.seq - 3)
        arm.keep_path(way_back_mm=1000, way_back_deg=100)
        arm.resume()
        arm.waitfor(arm.completed)
        assert (end.code, arm.kept) == (Termination.COMPLETED, "")
        assert not fake.commands[-1].path_waits


@pytest.mark.parametrize("waits", ["completed", "a predicate", "the end"])
def test_on_virtual_time_a_wait_for_an_arm_that_nobody_lets_go_back_ends_with_what_has_stopped_it(
    fake: FakeRobot, waits: str
) -> None:
    fake.before_period = lambda seq: fail(fake, "fault") if seq == 30 else None

    def program() -> None:
        with rccl.control("puma560") as arm:
            arm.keep_path()
            motions(arm)
            if waits == "completed":
                arm.waitfor(arm.completed)
            elif waits == "a predicate":
                arm.waitas(lambda: arm.completed.count)

    with pytest.raises(MotionError, match=r"120 s of virtual time.*resume.*FOLLOWING"):
        program()
    assert HELD_S / PERIOD_S < fake.seq < HELD_S / PERIOD_S + 60


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Waits end after `SOON_S`, where what is looked at is not how long they last."""
    monkeypatch.setattr("qrobot.rci.standstill.HELD_S", SOON_S)


@pytest.mark.usefixtures("impatient")
def test_a_wait_that_is_shorter_or_a_motion_that_goes_on_ends_nothing(fake: FakeRobot) -> None:
    with rccl.control("puma560") as arm:
        arm.keep_path()
        _, end = motions(arm)
        arm.waitas(lambda: arm.time > 500)
        fail(fake, "fault")
        for _ in range(2):  # each wait has a time of its own
            begin = arm.time
            arm.waitas(lambda begin=begin: arm.time > begin + 1e3 * (SOON_S - 1.0))
        arm.resume()
        arm.waitfor(arm.completed)
        assert end.code == Termination.COMPLETED
        arm.setmode("joint")
        arm.setime(300, 1e3 * (SOON_S + 5.0))
        arm.move(arm.pose("park"))
        arm.waitfor(arm.completed)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("how", ["pause", "override"])
def test_a_program_that_holds_its_own_motions_and_waits_for_them_is_told_on_virtual_time(
    fake: FakeRobot, how: str
) -> None:
    def program() -> None:
        with rccl.control("puma560") as arm:
            motions(arm)
            if how == "pause":
                arm.pause()
            else:
                arm.override(0)

    with pytest.raises(MotionError, match="holds its motions itself"):
        program()
    assert fake.goodbyes == 1


@pytest.mark.parametrize("wrong", [{"way_back_mm": -1.0}, {"way_back_deg": float("nan")}])
def test_a_way_back_has_a_length_that_can_be(fake: FakeRobot, wrong: dict[str, float]) -> None:
    with rccl.control("puma560") as arm, pytest.raises(MotionError, match="keep_path"):
        arm.keep_path(**wrong)
