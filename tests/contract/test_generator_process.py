"""The trajectory generator in a process of its own, which shares the transforms of its program (D-20)."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl, rci
from qrobot.config import load_robot
from qrobot.errors import ConfigError, JointLimit, LinkBusy, LinkLost, MotionError
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.motion import Termination, motion_limits
from qrobot.rccl.offline import OfflineLink
from qrobot.rci import TcpLink
from qrobot.wire import AnalogOutputs, Collision, ErrorCode, Payload, Signals, WireError, WireEvent
from tests.support.fake_robot import FakeRobot, TcpRobot
from tests.support.patience import PATIENCE_S, wait_until

PUMA = load_robot("puma560")
PARK = tuple(PUMA.poses["park"].tolist())
PARK_DEG = np.degrees(PARK)
PATIENCE = 1_000_000  # periods without a command: what is tested is not this machine's speed
GATE = 60  # sample at which a robot waits until its program has asked for all its motions
LAST_CPU = max(os.sched_getaffinity(0))
HELD = Path(__file__).parents[1] / "support" / "held_interpreter.py"


class GatedRobot(FakeRobot):
    """One whose time stands still from the sample GATE on, until the gate is opened."""

    def __init__(self) -> None:
        super().__init__(PARK, period_us=4_000, patience=PATIENCE)
        self.gate = threading.Event()
        self.before_period = lambda seq: seq < GATE or self.gate.wait()

    def motion(self) -> np.ndarray:
        """What it followed from the gate on until it stood for good. Shape (samples, n)."""
        path = np.array(self.path)
        changed = np.flatnonzero(np.any(np.diff(path, axis=0) != 0.0, axis=1))
        return path[: changed[-1] + 2]


class NotingRobot(FakeRobot):
    """One that notes what it is told beside the setpoints, and refuses thresholds of a collision when it `refuses`.

    Its servo starts anew with each link, and stops the arm when one is lost, as one behind a bridge does.
    """

    def __init__(self) -> None:
        super().__init__(PARK, period_us=4_000, patience=PATIENCE)
        self.beside: list[WireEvent] = []
        self.refuses = False

    def _take(self, event: WireEvent) -> bytes:
        if isinstance(event, Collision) and self.refuses:
            return self._connection.send(WireError(ErrorCode.COLLISION_REFUSED, "not these", False))
        if isinstance(event, Signals | Collision | AnalogOutputs | Payload):
            self.beside.append(event)
        return super()._take(event)

    def forget_client(self) -> None:
        """See `FakeRobot.forget_client`."""
        self.payload_mass = 0.0
        if self.mode is Mode.TRACKING:
            self.halt(FaultCode.STREAM_LOST)
        super().forget_client()


def deg(name: str, *steps: float) -> rccl.Position:
    """Park with the first joints moved by degrees."""
    return rccl.jposition(name, PARK_DEG + np.pad(steps, (0, 6 - len(steps))))


def all_kinds_of_motion(arm: rccl.Channel) -> rccl.Transform:
    """Ask for motions through via points, in joints and Cartesian, to a frame that one of them finds; that frame."""
    start, grip = arm.measured_t6, rccl.gentr_trsl("GRIP", 0, 0, 100)
    here, tool = rccl.newtrans("HERE", "const"), rccl.gentr_trsl("TOOL", 0, 0, 100)
    here.set(start)
    seen, belt = rccl.newtrans("SEEN"), rccl.newtrans("BELT")
    rccl.trsl(belt, 0, 30, 0)
    on_belt = rccl.makeposition("ON BELT", rccl.t6, tool, rccl.EQ, here, belt, grip, rccl.TL, tool)
    found = rccl.makeposition("FOUND", rccl.t6, tool, rccl.EQ, here, seen, grip, rccl.TL, tool)
    arm.setime(80, 200)
    arm.move(deg("A", 5, 4))
    arm.setmode("cartesian")
    arm.setvel(400, 200)
    arm.move(on_belt)
    arm.update(seen, found)
    arm.setmode("joint")
    arm.setime(60, 150)
    arm.move(deg("B", -3, 2, 1))
    arm.distance("dz", -20)
    arm.setime(60, 150)
    arm.move(found)
    arm.move(arm.pose("park"))
    return seen


def move_in_all_ways(arm: rccl.Channel, robot: GatedRobot) -> tuple[np.ndarray, np.ndarray]:
    """The setpoints of these motions, and the frame that was found."""
    wait_until(lambda: robot.seq == GATE)
    try:
        seen = all_kinds_of_motion(arm)
    finally:
        robot.gate.set()
    arm.waitfor(arm.completed)
    last = robot.seq
    wait_until(lambda: robot.seq > last + 2)  # until it has followed the last setpoint
    return robot.motion(), seen.value


@dataclass(frozen=True)
class Apart:
    """An arm whose generator has a process of its own, what it followed at first, and a frame that was found then."""

    arm: rccl.Channel
    robot: GatedRobot
    motion: np.ndarray
    frame: np.ndarray

    @property
    def pid(self) -> int:
        """Of the generator's process."""
        return self.arm._session._link._process.pid


@pytest.fixture(scope="module")
def apart() -> Iterator[Apart]:
    robot = GatedRobot()
    with TcpRobot(robot) as server, rccl.use(lambda hello: TcpLink(hello, server.address)):
        arm = rccl.control(processor=f"cpu{LAST_CPU}")
        yield Apart(arm, robot, *move_in_all_ways(arm, robot))
        with suppress(LinkLost):  # one test kills the generator
            arm.release()


@pytest.mark.realtime
def test_a_generator_of_its_own_process_sends_the_setpoints_of_a_thread_to_the_last_bit(apart: Apart) -> None:
    robot = GatedRobot()
    with TcpRobot(robot) as server, rccl.use(lambda hello: TcpLink(hello, server.address)), rccl.control() as arm:
        motion, frame = move_in_all_ways(arm, robot)
    assert len(motion) > 200
    assert np.array_equal(apart.motion, motion)
    assert np.array_equal(apart.frame, frame)
    assert not np.array_equal(frame, np.eye(4))


@pytest.mark.realtime
def test_calls_of_a_program_reach_its_generator_and_their_errors_come_back(apart: Apart) -> None:
    arm, robot = apart.arm, apart.robot
    with pytest.raises(JointLimit, match="joint 1"):
        arm.move(deg("OUT", 1000.0))
    assert arm.nbrequest == 0
    p = deg("P", 3.0)
    arm.move(p)
    arm.waitfor(p.end)
    assert (p.code, p.scal) == (Termination.COMPLETED, 1.0)
    assert rci.rci_descriptor("puma560").how.q == pytest.approx(p.q, abs=1e-4)
    arm.signal(3)
    arm.OPEN()
    wait_until(lambda: robot.commands[-1].outputs == 4 and robot.commands[-1].hand == 1)
    arm.chg.outputs = 0  # the variable of RCCL itself
    wait_until(lambda: robot.commands[-1].outputs == 0)
    arm.move(arm.pose("park"))
    path = arm.plan()
    assert path.q[-1] == pytest.approx(PARK)
    arm.override(50.0)
    arm.sample(8.0)
    assert robot.period_us == 8_000
    arm.move(p)
    arm.waitfor(p.end)
    arm.override(100.0)
    arm.stop()
    arm.waitfor(arm.completed)


@pytest.mark.realtime
def test_an_arm_follows_a_transform_that_its_program_changes_in_shared_memory(apart: Apart) -> None:
    arm = apart.arm
    here, belt = rccl.newtrans("HERE", "const"), rccl.newtrans("BELT")
    here.set(arm.measured_t6)
    arm.move(on_belt := rccl.makeposition("ON", rccl.t6, rccl.EQ, belt, here, rccl.TL, here))
    arm.waitfor(on_belt.end)
    for step in range(1, 21):
        belt.p.y = 0.05 * step
        there = here.value[:3, 3] + [0.0, belt.p.y * 1e-3, 0.0]
        arm.waitas(lambda there=there: np.allclose(arm.measured_t6[:3, 3], there, rtol=0.0, atol=1e-9))
    with pytest.raises(ValueError, match="read-only"):
        belt.value[0, 3] = 1.0  # which would reach nobody


@pytest.mark.realtime
def test_a_processor_of_this_machine_has_one_generator_which_stays_on_it(apart: Apart) -> None:
    assert os.sched_getaffinity(apart.pid) == {LAST_CPU}
    with pytest.raises(LinkBusy, match=f"cpu{LAST_CPU} belongs to another program"):
        rccl.control(processor=f"cpu{LAST_CPU}")


@pytest.mark.realtime
def test_a_generator_that_is_killed_is_told_and_says_nothing_more_to_the_bridge(apart: Apart) -> None:
    """The last of those that share the arm. What a bridge does then is in `test_bridge_session`."""
    arm, robot = apart.arm, apart.robot
    before = robot.goodbyes
    arm.setime(100, 20_000)
    arm.move(deg("FAR", 60.0))
    arm.waitas(lambda: arm.how.q[0] != PARK[0])
    os.kill(apart.pid, signal.SIGKILL)
    with pytest.raises(LinkLost, match="process of the generator has died, exit status -9"):
        arm.waitfor(arm.completed)
    assert robot.goodbyes == before
    assert rci.arm_tasks.held("puma560") is None


@pytest.mark.realtime
def test_an_arm_moves_on_while_its_program_holds_the_interpreter_and_comes_to_rest_when_it_is_killed() -> None:
    """The program is in a call of C that keeps the interpreter until we say so, for ten samples and more."""
    robot = FakeRobot(PARK, period_us=4_000, patience=PATIENCE)
    with TcpRobot(robot, 0.001) as server:
        address = "{}:{}".format(*server.address)
        command = [sys.executable, str(HELD), "aux"]
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=os.environ | {"QROBOT_BRIDGE": address}
        ) as program:
            assert program.stdout.readline() == b"holding\n"
            before = robot.seq
            wait_until(lambda: robot.seq > before + 10)
            followed = np.array(robot.path[-10:])
            assert np.all(np.diff(followed[:, 0]) > 0.0)
            program.stdin.write(b"x")
            program.stdin.flush()
            assert program.stdout.readline() == b"let go\n"
            program.kill()
            assert program.wait(PATIENCE_S) == -signal.SIGKILL
            wait_until(lambda: robot.goodbyes == 1)
    path = np.array([*robot.path, robot.q, robot.q])[:, 0]  # where it is held from then on
    a = np.diff(path, 2) / 0.004**2
    assert np.abs(a).max() < 1.01 * motion_limits(PUMA).a_max[0]
    assert PARK[0] < path[-1] < PARK[0] + np.radians(59.0)


@pytest.mark.realtime
def test_a_bridge_that_is_greeted_anew_is_told_what_it_took_of_collisions_and_no_output_that_was_ended() -> None:
    robot, (low, lower) = NotingRobot(), (share * PUMA.guard.unexplained_torque_or_default for share in (0.5, 0.4))
    with (
        TcpRobot(robot) as server,
        rccl.use(lambda hello: TcpLink(hello, server.address)),
        rccl.control(processor="aux") as arm,
    ):
        arm.keep_path()
        arm.log_signal("depth", 0.3)
        arm.analog(1, 5.0)
        arm.collision("comply", low.tolist())
        robot.refuses = True
        with pytest.raises(MotionError, match="not these"):
            arm.collision("comply", lower.tolist())
        robot.refuses = False
        assert [type(packet) for packet in robot.beside] == [Signals, AnalogOutputs, Collision]
        taken = robot.beside[-1]
        arm.setload(2.0)
        robot.beside.clear()
        server.hang_up()
        arm.waitas(lambda: arm.kept)
        wait_until(lambda: len(robot.beside) == 3)
        assert [type(packet) for packet in robot.beside] == [Signals, Collision, Payload]
        assert robot.beside[1].thresholds == taken.thresholds
        assert robot.payload_mass == 2.0
        arm.resume()
        arm.waitas(lambda: not arm.off_path)  # a program that ends sooner is told what had stopped its arm


# --------------------------------------------------------------------------------------------------- on virtual time


@pytest.fixture
def offline() -> Iterator[rccl.Channel]:
    with rccl.use(OfflineLink), rccl.control(processor="aux") as arm:
        yield arm


def test_functions_that_another_process_cannot_call_are_refused_where_they_are_given(offline) -> None:
    spin = rccl.newtrans("SPIN", lambda t: rccl.trsl(t, 0, 0, 0))
    here = rccl.newtrans("HERE", "const")
    here.set(offline.measured_t6)
    with pytest.raises(MotionError, match="each_sample: the generator has a process of its own"):
        offline.each_sample(lambda: None)
    offline.evalfn(lambda: 0)
    with pytest.raises(MotionError, match="move to P, with `evalfn`: the generator has a process"):
        offline.move(deg("P", 1.0))
    with pytest.raises(MotionError, match="with the function of transform SPIN: the generator has a process"):
        offline.move(rccl.makeposition("S", rccl.t6, rccl.EQ, here, spin, rccl.TL, rccl.t6))
    offline.move(deg("P", 1.0))
    offline.waitfor(offline.completed)


@pytest.mark.parametrize("name", ["cpu4095", "compiled", "host:lab2", "unknown"])
def test_a_processor_that_no_generator_can_have_is_refused(name: str) -> None:
    with rccl.use(OfflineLink), pytest.raises(ConfigError, match="no processor"):
        rccl.control(processor=name)
