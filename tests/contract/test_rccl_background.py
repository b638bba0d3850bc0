"""What runs at every sample besides the motions: slow functions are named, `chg` is written; and two arms at a time."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Event, Thread
from types import SimpleNamespace

import numpy as np
import pytest

from qrobot import rccl
from qrobot.config import load_robot
from qrobot.errors import JointLimit, MotionError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.rccl import EQ, TL, gentr_trsl, makeposition, newtrans, t6
from qrobot.rccl.offline import OfflineLink
from qrobot.rci import TcpLink, VirtualLink
from qrobot.wire import Hello, JointMode
from qrobot.wire.vocabulary import Hand
from tests.support.fake_robot import FakeRobot, SocketRobot
from tests.support.patience import PATIENCE_S, wait_until

PARK = tuple(load_robot("puma560").poses["park"].tolist())
PERIOD_US = 2_000
TURN = (0.1, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def robot() -> Iterator[FakeRobot]:
    fake = FakeRobot(PARK, period_us=PERIOD_US, patience=100)
    with rccl.use(lambda hello: VirtualLink(hello, fake.transfer)):
        yield fake


def over(arm: rccl.Channel, *functions: rccl.Transform) -> rccl.Position:
    """Where the arm is, by transforms that do not move."""
    start = gentr_trsl("START", 0, 0, 0)
    arm.update(start, makeposition("HERE", t6, EQ, start, TL, start))
    arm.move(arm.there)
    arm.waitfor(arm.completed)
    return makeposition("OVER", t6, EQ, start, *functions, TL, start)


def idle(t: rccl.Transform) -> None:
    """A function in time."""
    t.p.z = 0.0


def test_functions_that_take_longer_than_a_sample_are_named(robot, monkeypatch) -> None:
    clock_ns = [0]
    monkeypatch.setattr("qrobot.rccl.transforms.time", SimpleNamespace(perf_counter_ns=lambda: clock_ns[0]))

    def dawdle(t: rccl.Transform) -> None:
        clock_ns[0] += 1500 * PERIOD_US
        t.p.z = 0.0

    with rccl.control() as arm:
        arm.move(over(arm, newtrans("BELT", idle), newtrans("SLOW", dawdle)))
        arm.waitas(lambda: arm.time > 100)
        assert list(arm.overruns) == ["SLOW"]
        assert arm.overruns["SLOW"] == 3.0
        robot.halt(FaultCode.STREAM_LOST)
        with pytest.raises(ServoFault, match=r"period is 2 ms, and the function of SLOW took 3 ms: STREAM_LOST"):
            arm.waitas(lambda: False)


def test_without_slow_functions_nothing_is_blamed_on_them(robot) -> None:
    with rccl.control() as arm:
        arm.waitas(lambda: arm.time > 20)
        assert arm.overruns == {}
        robot.halt(FaultCode.STREAM_LOST)
        with pytest.raises(ServoFault, match="the servo stopped the arm: STREAM_LOST"):
            arm.waitas(lambda: False)


def test_what_the_hand_holds_stays_held_when_a_program_takes_the_arm(robot) -> None:
    robot.hand = Hand.CLOSED
    with rccl.control() as arm:
        arm.waitas(lambda: arm.time > 200)
    assert {command.hand for command in robot.commands} == {Hand.CLOSED}


def test_a_program_reads_how_and_writes_chg_at_every_sample(robot) -> None:
    seen: list[int] = []

    def weave() -> None:
        seen.append(arm.how.t_ns)
        q = np.array(arm.chg.setpoints)
        q[5] += 0.01 * np.sin(0.05 * len(seen)) if len(seen) < 126 else 0.0
        arm.chg.go_to(tuple(q.tolist()))

    with rccl.control() as arm:
        rccl.chg.outputs = 0b101
        arm.each_sample(weave)
        arm.waitas(lambda: len(seen) >= 150)
        arm.each_sample(None)
        told = len(seen)
        arm.waitas(lambda: arm.time > 600)
    assert len(seen) == told
    assert np.diff(seen).tolist() == [PERIOD_US * 1000] * (told - 1)
    path = np.array(robot.path)
    assert np.ptp(path[:, 5]) == pytest.approx(0.02, abs=1e-3)
    assert np.ptp(path[:, :5]) == pytest.approx(np.ptp(PARK[:5]))
    assert robot.commands[-1].outputs == 0b101


def test_a_joint_can_be_given_a_torque_by_the_program(robot) -> None:
    with rccl.control() as arm:
        arm.each_sample(lambda: arm.chg.drive((*PARK[:5], 0.25), (False,) * 5 + (True,)))
        arm.waitas(lambda: arm.time > 20)
        arm.each_sample(None)
        arm.waitas(lambda: arm.time > 40)
    told = [command for command in robot.commands if command.modes[5] == JointMode.TORQUE]
    assert len(told) > 5
    assert {command.setpoints[5] for command in told} == {0.25}


def test_what_a_function_of_every_sample_raises_reaches_the_program(robot) -> None:
    def fail() -> None:
        raise LookupError("no sensor")

    with rccl.control() as arm:
        arm.each_sample(fail)
        with pytest.raises(LookupError, match="no sensor"):
            arm.waitas(lambda: False)
    assert robot.goodbyes


def test_a_function_of_every_sample_that_would_let_go_of_its_arm_is_told_that_it_must_not_wait(robot) -> None:
    with rccl.control() as arm:
        arm.each_sample(arm.release)
        with pytest.raises(MotionError, match="must not wait"):
            arm.waitas(lambda: False)
    assert robot.goodbyes == 1


def test_a_thread_that_answers_samples_lets_go_of_no_arm() -> None:
    """It would wait for itself."""
    told: list[MotionError] = []

    def let_go() -> None:
        with pytest.raises(MotionError, match="must not wait") as refusal:
            arm.release()
        told.append(refusal.value)

    fake = FakeRobot(PARK, name="puma560", period_us=4_000, patience=100_000)
    with SocketRobot(fake) as server:
        with rccl.use(lambda hello: TcpLink(hello, ("test", 0), lambda _: server.socket)), rccl.control() as arm:
            arm.each_sample(let_go)
            arm.waitas(lambda: len(told) > 2)  # the arm goes on
            assert not fake.goodbyes
        wait_until(lambda: fake.goodbyes)


def test_what_a_function_asks_of_joints_is_judged_before_it_goes_out(robot) -> None:
    """As what a control function of RCI asks for; a function that leaves the joints to the motions is not judged."""
    with rccl.control() as arm:
        arm.each_sample(lambda: arm.chg.go_to(tuple(np.add(PARK, (0.0005, 0.0, 0.0, 0.0, 0.0, 0.0)))))
        arm.waitas(lambda: arm.how.q[0] > PARK[0] + 0.0004)
        arm.each_sample(lambda: arm.chg.go_to((9.0, *PARK[1:])))
        with pytest.raises(JointLimit, match="task puma560"):
            arm.waitas(lambda: False)
    assert max(command.setpoints[0] for command in robot.commands) < PARK[0] + 0.001


def test_a_function_that_ends_without_bringing_joints_back_is_refused_the_way_back(robot) -> None:
    away = iter(np.linspace(0.0, 0.1, 200))
    with rccl.control() as arm:
        arm.each_sample(lambda: arm.chg.go_to((PARK[0] + next(away, 0.1), *PARK[1:])))
        arm.waitas(lambda: next(away, None) is None)
        arm.each_sample(None)
        with pytest.raises(MotionError, match=r"task puma560.*make smaller steps"):
            arm.waitas(lambda: False)
    assert robot.commands[-1].setpoints[0] > PARK[0] + 0.09


def test_no_sample_passes_while_update_calls_functions() -> None:
    """Whoever calls functions in two orders, or beside each other, may wait for ever."""
    alone, others, begun = list[bool](), list[Thread](), Event()

    def ask() -> None:
        begun.set()
        assert arm.nbrequest >= 0  # needs what a sample needs

    def look(_: rccl.Transform) -> None:
        others.append(Thread(target=ask, daemon=True))
        others[-1].start()
        assert begun.wait(PATIENCE_S)
        others[-1].join(0.02)
        alone.append(others[-1].is_alive())

    fake = FakeRobot(PARK, name="puma560", period_us=4_000, patience=100_000)
    with SocketRobot(fake) as server:
        with rccl.use(lambda hello: TcpLink(hello, ("test", 0), lambda _: server.socket)), rccl.control() as arm:
            start = gentr_trsl("START", 0, 0, 0)
            arm.update(start, makeposition("HERE", t6, EQ, start, newtrans("LOOKS", look), TL, start))
            for other in others:
                other.join()  # while there is an arm
        wait_until(lambda: fake.goodbyes)
    assert alone == [True]


def test_one_program_moves_two_arms_at_the_same_time_in_step_by_events() -> None:
    """The right arm begins when the left one is half way; both stream all the time."""
    robots = [FakeRobot(PARK, name="puma560", period_us=4_000, patience=100_000) for _ in range(2)]
    with SocketRobot(robots[0]) as left_server, SocketRobot(robots[1]) as right_server:
        servers = iter((left_server, right_server))

        def link(hello: Hello) -> TcpLink:
            return TcpLink(hello, ("test", 0), lambda _: next(servers).socket)

        with rccl.use(link), rccl.control() as left, rccl.control() as right:
            goals = [arm.jposition("goal", np.degrees(np.add(PARK, TURN))) for arm in (left, right)]
            left.setime(60, 400)
            left.move(goals[0])
            left.waitas(lambda: goals[0].scal > 0.5)
            assert right.completed.count == 1
            right.setime(80, 160)
            right.move(goals[1])
            right.waitfor(goals[1].end)
            left.waitfor(goals[0].end)
        wait_until(lambda: all(robot.goodbyes for robot in robots))
    for robot in robots:
        assert robot.q == pytest.approx(np.add(PARK, TURN))


def test_two_arms_of_different_kinds_are_two_channels() -> None:
    with rccl.use(OfflineLink), rccl.control("puma560") as puma, rccl.control("stanford") as stanford:
        for arm in (puma, stanford):
            arm.move(arm.pose("park"))
            arm.waitfor(arm.completed)
            np.testing.assert_allclose(arm.how.q, arm.robot.poses["park"], atol=1e-9)
