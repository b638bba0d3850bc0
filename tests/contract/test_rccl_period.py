"""The sample period, changed by a program that goes on, with the bridge's session and with an ideal arm."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import LinkBusy, MotionError
from qrobot.motion import Termination
from qrobot.rccl import EQ, TL, gentr_trsl, makeposition, newtrans, t6
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.trace import Trace
from qrobot.rci import TcpLink, VirtualLink
from qrobot.wire import Mode
from tests.support.fake_robot import FakeRobot, SocketRobot
from tests.support.patience import wait_until
from tests.support.puma import PARK


@pytest.fixture
def robot() -> FakeRobot:
    return FakeRobot(tuple(PARK))


@pytest.fixture(params=["bridge", "ideal"])
def arm(request, robot: FakeRobot) -> Iterator[rccl.Channel]:
    link = OfflineLink if request.param == "ideal" else lambda hello: VirtualLink(hello, robot.transfer)
    with rccl.use(link), rccl.control() as arm:
        yield arm


def near_park(arm: rccl.Channel, name: str, turn: float) -> rccl.Position:
    return arm.jposition(name, np.degrees(PARK) + turn * np.eye(6)[0])


def steps_ms(arm: rccl.Channel) -> float:
    """From one sample to the next."""
    times: list[float] = []
    arm.waitas(lambda: times.append(arm.time) or len(times) > 3)
    return times[-1] - times[-2]


def test_motions_have_the_period_that_was_chosen_before_them(arm: rccl.Channel) -> None:
    there, back = near_park(arm, "there", 10.0), near_park(arm, "back", 0.0)
    arm.setjvel(share=0.4)
    completed = arm.completed
    for goal, period_ms in ((there, 28), (back, 8), (there, 40)):
        arm.sample(period_ms)
        arm.move(goal)
        assert steps_ms(arm) == pytest.approx(period_ms)
        arm.waitfor(goal.end)
        assert goal.code == Termination.COMPLETED
    assert arm.completed is completed
    arm.waitas(lambda: np.allclose(arm.how.q, there.q, rtol=0, atol=1e-9))


def test_the_motions_before_are_finished_first_and_no_setpoint_jumps(robot: FakeRobot) -> None:
    with rccl.use(lambda hello: VirtualLink(hello, robot.transfer)), rccl.control() as arm:
        there, back = near_park(arm, "there", 10.0), near_park(arm, "back", 0.0)
        arm.move(there)
        arm.sample(4)
        assert there.code == Termination.COMPLETED
        assert arm.time > 400
        arm.move(back)
        arm.waitfor(back.end)
    path = np.array(robot.path)
    assert path[:, 0].max() == pytest.approx(there.q[0])
    assert np.abs(np.diff(path, axis=0)).max() < 0.02
    assert all(command.power for command in robot.commands[5:])


def test_an_arm_that_followed_a_frame_stands_still_while_its_period_changes(arm: rccl.Channel) -> None:
    def drift(t: rccl.Transform) -> None:
        t.p.y += 0.5

    start = gentr_trsl("START", 0, 0, 0)
    arm.update(start, makeposition("HERE", t6, EQ, start, TL, start))
    arm.move(arm.there)
    arm.waitfor(arm.completed)
    moving = makeposition("P", t6, EQ, start, newtrans("BELT", drift), TL, start)
    arm.move(moving)
    arm.waitfor(moving.end)
    arm.sample(10)
    stood = arm.how.q
    arm.waitas(lambda begin=arm.time: arm.time > begin + 100)
    assert arm.how.q == pytest.approx(stood, abs=1e-9)


@pytest.mark.parametrize(("ms", "words"), [(0.5, "1 to 100 ms"), (101, "1 to 100 ms"), (float("nan"), "finite")])
def test_an_impossible_period_is_refused_before_anything_is_let_go(robot: FakeRobot, ms: float, words: str) -> None:
    with rccl.use(lambda hello: VirtualLink(hello, robot.transfer)), rccl.control() as arm:
        with pytest.raises(MotionError, match=words):
            arm.sample(ms)
        assert not robot.goodbyes
        assert robot.mode is Mode.TRACKING
    with pytest.raises(MotionError, match=words):
        rccl.control(period_ms=ms)


def test_somebody_who_takes_the_arm_meanwhile_is_named_and_ends_the_hold(robot: FakeRobot) -> None:
    class Snatched(VirtualLink):
        def open(self):
            if robot.goodbyes:
                raise LinkBusy("the bridge refused: puma560 is commanded by somebody else")
            return super().open()

    with rccl.use(lambda hello: Snatched(hello, robot.transfer)), rccl.control() as arm:
        with pytest.raises(LinkBusy, match="somebody else"):
            arm.sample(10)
        with pytest.raises(LinkBusy):
            arm.move(arm.pose("park"))


def test_a_trace_has_one_period(robot: FakeRobot) -> None:
    traces: list[Trace] = []
    with rccl.use(OfflineLink, traces), rccl.control() as arm:
        for period_ms in (28, 10):
            arm.sample(period_ms)
            arm.move(near_park(arm, f"at {period_ms}", float(period_ms)))
            arm.waitfor(arm.completed)
    assert [trace.setpoints.period_us for trace in traces] == [28_000, 10_000]
    assert [[request.name for request in trace.requests] for trace in traces] == [["at 28"], ["at 10"]]


def test_in_real_time_the_connection_is_made_anew() -> None:
    robot = FakeRobot(tuple(PARK), patience=100_000)  # what is tested is not this machine's speed
    with ExitStack() as servers:
        made: list[SocketRobot] = []

        def connect(_address: object) -> socket.socket:
            if made:  # one robot speaks to one socket
                wait_until(lambda: robot.goodbyes)
                servers.close()
            made.append(servers.enter_context(SocketRobot(robot)))
            return made[-1].socket

        with rccl.use(lambda hello: TcpLink(hello, ("test", 0), connect)), rccl.control() as arm:
            arm.sample(4)
            begin = arm.time
            arm.waitas(lambda: arm.time > begin + 40)
            assert robot.mode is Mode.TRACKING
        assert len(made) == 2
    assert robot.period_us == 4_000
