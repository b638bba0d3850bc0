"""The same programs in lock-step and in real time, against a robot that follows perfectly."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import numpy as np
import pytest

from qrobot import rccl
from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.errors import LinkError, LinkLost, MotionError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.motion import Termination
from qrobot.rci import TcpLink, VirtualLink, thread_driver
from qrobot.wire import JointMode, Mode
from tests.support.fake_robot import FakeRobot, PassingBridge, SocketRobot
from tests.support.patience import PATIENCE_S, wait_until

PARK = tuple(load_robot("puma560").poses["park"].tolist())
PARK_DEG = np.degrees(PARK)
DONE = Termination.COMPLETED
QUICK = 60.0, 120.0  # ms of transition and segment
MAX = 4
SAMPLE_MS = 4.0
PATIENCE = 100_000  # periods without a command: what is tested is not this machine's speed


@contextmanager
def in_lockstep(robot: FakeRobot) -> Iterator[None]:
    with rccl.use(lambda hello: VirtualLink(hello, robot.transfer)):
        yield


@contextmanager
def in_real_time(robot: FakeRobot) -> Iterator[None]:
    with SocketRobot(robot) as server, rccl.use(lambda hello: TcpLink(hello, ("test", 0), lambda _: server.socket)):
        yield


@pytest.fixture(params=[in_lockstep, pytest.param(in_real_time, marks=pytest.mark.realtime)])
def robot(request) -> Iterator[FakeRobot]:
    fake = FakeRobot(PARK, period_us=4_000, patience=PATIENCE)
    with request.param(fake):
        yield fake
        rccl.release()


@pytest.fixture
def quiet_robot() -> Iterator[FakeRobot]:
    """In lock-step only."""
    fake = FakeRobot(PARK)
    with in_lockstep(fake):
        yield fake


def near_park(name: str, *steps: float) -> rccl.Position:
    """Park with the first joints moved by degrees."""
    return rccl.jposition(name, PARK_DEG + np.pad(steps, (0, 6 - len(steps))))


def wait_until_at(position: rccl.Position) -> None:
    """The robot takes a setpoint one sample after the generator made it."""
    rccl.waitas(lambda: np.allclose(rccl.how.q, position.q, rtol=0, atol=1e-12))


def no_sample(arm: rccl.Channel) -> AbstractContextManager[object]:
    """None passes within the block, however long its calls take."""
    return arm._session.task()


def quick(position: rccl.Position) -> None:
    rccl.setime(*QUICK)
    rccl.move(position)


def test_control_powers_the_arm_and_streams_from_where_it_stands(robot) -> None:
    rccl.control("puma560")
    assert robot.mode is Mode.TRACKING
    wait_until_sample(3)
    assert np.allclose(robot.path, PARK)
    assert robot.commands[0].power is False
    rccl.release()
    wait_until(lambda: robot.goodbyes)
    assert robot.mode is Mode.HOLDING


def wait_until_sample(count: int) -> None:
    start = rccl.how.t_ns
    rccl.waitas(lambda: rccl.how.t_ns >= start + count * 4_000_000)


def wait_until_heard(count: int) -> None:
    """So many samples more, however many went by unheard."""
    for _ in range(count):
        newest = rccl.how
        rccl.waitas(lambda newest=newest: rccl.how is not newest)


def test_a_motion_ends_at_its_position_and_tells_how(robot) -> None:
    rccl.control()
    p = near_park("p", 1.0, -1.0)
    quick(p)
    assert p.code == Termination.NONE
    rccl.waitfor(p.end)
    assert (p.code, p.scal, p.end.count) == (DONE, 1.0, 0)
    rccl.waitfor(rccl.completed)
    rccl.waitfor(rccl.completed)  # still true
    wait_until_at(p)


def test_four_corners_with_synchronous_processing_s01(robot) -> None:
    """S-01 of Hayward & Paul 1986: each corner's event counts its visits."""
    arm = rccl.control()
    corners = [near_park(f"p{i}", x, y) for i, (x, y) in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)])]
    with no_sample(arm):
        for _ in range(4):
            for corner in corners:
                quick(corner)
        assert rccl.nbrequest == 16
    rccl.waitfor(corners[0].end)
    rccl.waitfor(corners[0].end)
    assert rccl.nbrequest <= 11
    rccl.waitfor(rccl.completed)
    assert rccl.nbrequest == 0
    assert [corner.end.count for corner in corners] == [2, 4, 4, 4]
    assert {corner.code for corner in corners} == {DONE}


def test_a_dwell_closes_the_hand_half_way_s02(robot) -> None:
    """The end of S-02: the arm stays at p for 400 ms, the hand closes in the middle."""
    arm, seen = rccl.control(), list[tuple[float, int, float]]()
    p = near_park("p", 1.0)
    p.end = 7
    p.end = 0
    quick(p)
    quick(p)
    rccl.setime(0, 400)
    rccl.move(p)
    arm.each_sample(lambda: seen.append((rccl.how.t_ns / 1e6, rccl.nbrequest, p.scal)))
    rccl.waitfor(p.end)
    rccl.waitfor(p.end)
    rccl.waitas(lambda: p.scal > 0.5)
    rccl.CLOSE()
    rccl.waitas(lambda: rccl.how.hand == 2)
    rccl.OPEN()
    rccl.waitas(lambda: rccl.how.hand == 1)
    rccl.waitfor(rccl.completed)
    rccl.waitfor(p.end)
    assert_it_dwells(400.0, *np.array(seen).T)


def assert_it_dwells(dwell_ms: float, t_ms: Floats, waiting: Floats, scal: Floats) -> None:
    """The last motion goes on by time, as each sample tells that was heard: it begins and ends between two of them."""
    last = (waiting == 0) & (scal <= np.minimum.accumulate(scal[::-1])[::-1])  # it never falls behind these
    over = scal == 1.0
    begun_ms = (t_ms - dwell_ms * scal)[last & ~over]
    assert np.ptp(begun_ms) <= SAMPLE_MS
    assert begun_ms.min() > t_ms[~last].max(initial=0.0) - SAMPLE_MS
    assert t_ms[last & over].min() > begun_ms.max() + dwell_ms - SAMPLE_MS


def test_waiting_for_room_in_the_queue_loses_no_goal_s03(robot) -> None:
    """The loop of S-03: `waitas(nbrequest < MAX)` before each move."""
    rccl.control()
    goals = [near_park(f"g{i}", 0.3 * (i % 3), 0.1 * i) for i in range(3 * MAX)]
    for goal in goals:
        rccl.waitas(lambda: rccl.nbrequest < MAX)
        quick(goal)
    rccl.waitfor(rccl.completed)
    assert [goal.end.count for goal in goals] == [1] * len(goals)
    wait_until_at(goals[-1])


def test_stop_on_keyboard_s04(robot) -> None:
    """S-04: nextmove ends the motion with its code, the arm stops on the path, completed follows."""
    rccl.control()
    p = near_park("p", 20.0)
    rccl.move(p)
    rccl.waitas(lambda: p.scal > 0.3)
    rccl.nextmove(rccl.YES)
    rccl.waitfor(rccl.completed)
    assert p.code == rccl.YES
    assert PARK[0] + 0.05 < robot.path[-1][0] < p.q[0] - 0.05
    assert p.scal < 1.0


def test_nextmove_goes_on_to_the_next_motion(robot) -> None:
    rccl.control()
    far, home = near_park("far", 20.0), rccl.park
    rccl.move(far)
    rccl.move(home)
    rccl.waitas(lambda: far.scal > 0.2)
    rccl.nextmove(17)
    rccl.waitfor(home.end)
    assert (far.code, home.code) == (17, DONE)
    wait_until_at(rccl.park)


def test_a_motion_that_has_not_begun_yet_is_interrupted_as_well(robot) -> None:
    arm = rccl.control()
    p = near_park("p", 20.0)
    with no_sample(arm):
        rccl.move(p)
        rccl.nextmove(17)
    rccl.waitfor(rccl.completed)
    assert (p.code, p.end.count) == (17, 1)
    assert abs(robot.path[-1][0] - PARK[0]) < 0.01


def test_stop_forgets_what_waits(robot) -> None:
    rccl.control()
    a, b = near_park("a", 20.0), near_park("b", -20.0)
    rccl.move(a)
    rccl.move(b)
    rccl.waitas(lambda: a.scal > 0.2)
    rccl.stop(100)
    rccl.waitfor(rccl.completed)
    assert {a.code, b.code} == {Termination.STOPPED}
    assert (a.end.count, b.end.count) == (1, 1)
    quick(rccl.jposition("here", np.degrees(robot.path[-1])))
    rccl.waitfor(rccl.completed)


def test_release_brings_a_moving_arm_to_rest_first(robot) -> None:
    rccl.control()
    rccl.move(near_park("p", 20.0))
    wait_until_sample(120)
    rccl.release()
    wait_until(lambda: robot.goodbyes)
    steps = np.abs(np.diff(np.array(robot.path)[:, 0]))
    assert steps.max() > 1e-4
    assert steps[-1] < 1e-5


def test_release_may_leave_the_arm_without_power(robot) -> None:
    rccl.control()
    rccl.release(power_off=True)
    wait_until(lambda: robot.goodbyes)
    assert robot.mode is Mode.OFF


def test_a_second_program_takes_over_an_arm_that_holds_without_switching_it_off(quiet_robot) -> None:
    with rccl.control():
        pass
    assert quiet_robot.mode is Mode.HOLDING
    quiet_robot.commands.clear()
    with rccl.control():
        assert quiet_robot.mode is Mode.TRACKING
    assert all(command.power for command in quiet_robot.commands)


@pytest.mark.parametrize(
    ("harm", "code"),
    [
        (lambda robot: robot.break_down(FaultCode.FOLLOWING), FaultCode.FOLLOWING),
        (lambda robot: robot.halt(FaultCode.STREAM_LOST), FaultCode.STREAM_LOST),
    ],
)
def test_a_servo_that_stops_the_arm_raises_where_the_program_waits(robot, harm, code) -> None:
    rccl.control()
    p = near_park("p", 20.0)
    rccl.move(p)
    wait_until_heard(20)
    robot.before_period = once(lambda: harm(robot))
    with pytest.raises(ServoFault, match=f"the servo stopped the arm: {code.name}") as fault:
        rccl.waitfor(p.end)
    assert fault.value.code == code
    assert len(fault.value.trace) > 20
    assert fault.value.trace[-1] is rccl.how
    with pytest.raises(ServoFault):
        rccl.move(p)


def test_a_stop_by_hand_is_told_as_one(robot) -> None:
    rccl.control()
    p = near_park("p", 20.0)
    rccl.move(p)
    wait_until_sample(20)
    robot.before_period = once(lambda: robot.halt(0))
    with pytest.raises(ServoFault, match="the servo stopped the arm: no fault; somebody told it to, or took its power"):
        rccl.waitfor(p.end)


def once(deed: Callable[[], object]) -> Callable[[int], None]:
    todo = [deed]

    def before_period(_seq: int) -> None:
        if todo:
            todo.pop()()

    return before_period


def test_an_error_nobody_waited_for_is_told_at_release() -> None:
    fake = FakeRobot(PARK, period_us=4_000, patience=PATIENCE)
    with in_real_time(fake):
        arm = rccl.control()
        fake.before_period = once(lambda: fake.break_down(FaultCode.ESTOP))
        wait_until(lambda: arm._session._driver.error is not None)
        with pytest.raises(ServoFault, match="ESTOP"):
            rccl.release()
        arm.release()


def test_a_fault_of_our_own_in_the_generator_thread_reaches_the_program(monkeypatch) -> None:
    fake = FakeRobot(PARK, period_us=4_000, patience=PATIENCE)
    with in_real_time(fake):
        arm = rccl.control()
        monkeypatch.setattr(arm._task, "_generate", lambda: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            arm.waitas(lambda: False)
        wait_until(lambda: fake.goodbyes)
        rccl.release()


def test_a_release_that_is_interrupted_still_ends_the_thread(monkeypatch) -> None:
    fake = FakeRobot(PARK, period_us=4_000, patience=PATIENCE)
    with in_real_time(fake):
        arm = rccl.control()

        def interrupted(_power_off: bool) -> None:
            raise KeyboardInterrupt

        monkeypatch.setattr(arm._session, "_leave", interrupted)
        with pytest.raises(KeyboardInterrupt):
            arm.release()
        assert not arm._session._driver._thread.is_alive()
        wait_until(lambda: fake.goodbyes)


def test_a_lost_link_raises_where_the_program_waits() -> None:
    fake = FakeRobot(PARK, period_us=4_000, patience=PATIENCE)
    with SocketRobot(fake) as server:
        with rccl.use(lambda hello: TcpLink(hello, ("test", 0), lambda _: server.socket)):
            arm = rccl.control()
        server.hang_up()
        with pytest.raises(LinkLost):
            arm.waitas(lambda: False)
        arm.release()


@pytest.mark.realtime
def test_a_program_that_keeps_its_path_greets_a_bridge_that_comes_back_and_goes_on_when_that_is_confirmed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(thread_driver, "AGAIN_S", 0.02)
    fake = FakeRobot(PARK, period_us=4_000, patience=PATIENCE)
    bridge = PassingBridge(fake)
    with rccl.use(bridge.link):
        with bridge:
            arm = rccl.control()
            arm.keep_path()
            arm.log_signal("depth", 0.3)
            p = near_park("p", 20.0)
            rccl.setime(200, 1000)
            rccl.move(p)
            arm.waitas(lambda: p.scal > 0.3)
        fake.halt(FaultCode.STREAM_LOST)
        arm.waitas(lambda: "lost" in arm.kept or "closed" in arm.kept)
        with bridge:
            begin = fake.seq
            arm.waitas(lambda: fake.seq > begin + 20)
            arm.resume()
            arm.waitfor(arm.completed)
            assert p.code == DONE
            assert arm.kept == ""
            arm.release()
            assert fake.q == pytest.approx(PARK + np.radians([20.0, 0, 0, 0, 0, 0]))


@pytest.mark.realtime
def test_a_pause_that_went_with_its_servo_powers_no_arm_behind_the_next_bridge(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(thread_driver, "AGAIN_S", 0.02)
    fake = FakeRobot(PARK, period_us=4_000, patience=PATIENCE)
    bridge = PassingBridge(fake)

    def samples(count: int) -> None:
        begin = fake.seq
        arm.waitas(lambda: fake.seq > begin + count)

    with rccl.use(bridge.link):
        with bridge:
            arm = rccl.control()
            arm.keep_path()
            p = near_park("p", 20.0)
            rccl.setime(200, 1000)
            rccl.move(p)
            arm.waitas(lambda: p.scal > 0.3)
            fake.paused = True
            fake.halt(FaultCode.STREAM_LOST)
            samples(20)
        arm.waitas(lambda: "lost" in arm.kept or "closed" in arm.kept)
        arm.resume()  # which nobody hears
        fake.mode, fake.paused = Mode.OFF, False
        said = len(fake.commands)
        with bridge:
            arm.waitas(lambda: len(fake.commands) > said)
            samples(50)
            assert arm.kept
            assert not any(command.power or command.clear_fault for command in fake.commands[said:])
            arm.resume()
            arm.waitfor(arm.completed)
            assert p.code == DONE
            arm.release()


def test_a_function_that_is_called_at_each_sample_must_not_wait(robot) -> None:
    arm = rccl.control()
    arm.each_sample(lambda: arm.waitfor(arm.completed))
    with pytest.raises(MotionError, match="must not wait: let it signal an event"):
        arm.waitas(lambda: False)
    wait_until(lambda: robot.goodbyes)


@pytest.mark.realtime
def test_a_program_that_computes_without_a_pause_does_not_disturb_its_motion() -> None:
    """A-02. Robot and generator are threads of the interpreter that the program keeps busy."""
    fake = FakeRobot(PARK, period_us=28_000, patience=10)  # ten times a servo's, for a machine that is busy besides
    with in_real_time(fake):
        arm = rccl.control()
        p = near_park("p", 20.0)
        rccl.setime(200, 1000)
        rccl.move(p)
        assert sys.getswitchinterval() < 0.001  # s that the program may keep the interpreter, a tenth of the usual
        end = time.monotonic() + PATIENCE_S
        while p.code == Termination.NONE and time.monotonic() < end:
            sum(range(1000))
        assert p.code == DONE
        arm.release()


# ------------------------------------------------------------------------------------------ power-up, in lock-step


def test_refused_power_names_the_reason(quiet_robot) -> None:
    quiet_robot.refuse_power = True
    with pytest.raises(ServoFault, match="no arm power: POWER_NO_ACK: arm power did not come on") as fault:
        rccl.control()
    assert fault.value.code == FaultCode.POWER_NO_ACK
    assert quiet_robot.goodbyes


def test_a_latched_fault_is_raised_and_nothing_moves(quiet_robot) -> None:
    quiet_robot.break_down(FaultCode.GUARD_TRIP)
    with pytest.raises(ServoFault, match="the servo is in a fault: GUARD_TRIP"):
        rccl.control()
    assert not any(command.power or command.clear_fault for command in quiet_robot.commands)


def test_a_latched_fault_is_cleared_when_asked_for(quiet_robot) -> None:
    quiet_robot.break_down(FaultCode.GUARD_TRIP)
    with rccl.control(clear_fault=True):
        assert quiet_robot.mode is Mode.TRACKING
    assert sum(command.clear_fault for command in quiet_robot.commands) == 1


def test_a_fault_that_stays_is_given_up(quiet_robot) -> None:
    quiet_robot.break_down(FaultCode.ESTOP)
    quiet_robot.before_period = lambda _: quiet_robot.break_down(FaultCode.ESTOP)
    with pytest.raises(ServoFault, match="the servo is in a fault: ESTOP"):
        rccl.control(clear_fault=True)


def test_power_that_never_comes_is_given_up(quiet_robot) -> None:
    def stay_off(_seq: int) -> None:
        quiet_robot.mode = Mode.OFF

    quiet_robot.before_period = stay_off
    with pytest.raises(ServoFault, match="did not come to hold within 6 s: the servo is in mode OFF"):
        rccl.control()


def test_an_uncalibrated_arm_is_not_moved(quiet_robot) -> None:
    quiet_robot.calibrated = False
    with pytest.raises(MotionError, match="not calibrated"):
        rccl.control()
    assert not quiet_robot.path


def test_a_stream_that_is_not_followed_is_given_up(quiet_robot) -> None:
    def pull_away(_seq: int) -> None:
        if quiet_robot.mode is Mode.TRACKING:
            quiet_robot.halt(FaultCode.START_POSE)

    quiet_robot.before_period = pull_away
    with pytest.raises(ServoFault, match="does not follow the setpoints: START_POSE"):
        rccl.control()


@pytest.mark.parametrize(("name", "n"), [("stanford", 6), ("puma560", 5)])
def test_another_robot_than_the_program_was_written_for_is_refused(name, n) -> None:
    fake = FakeRobot(PARK[:n], name=name)
    with in_lockstep(fake), pytest.raises(LinkError, match=r"puma560"):
        rccl.control("puma560")
    assert not fake.path


# ----------------------------------------------------------------------------------------------------- small things


def test_the_wanted_period_is_asked_for(quiet_robot) -> None:
    with rccl.control(period_ms=10) as arm:
        start = arm.time
        arm.waitas(lambda: arm.time >= start + 50)
        assert arm.time == start + 50
    assert quiet_robot.period_us == 10_000


def test_all_joints_follow_positions_while_the_arm_is_under_control(quiet_robot) -> None:
    with rccl.control() as arm:
        arm.move(near_park("p", 5.0))
        arm.waitfor(arm.completed)
        seq = quiet_robot.commands[-1].seq
    streamed = [command for command in quiet_robot.commands if command.seq <= seq and command.stream]
    assert {command.modes for command in streamed} == {(JointMode.POSITION,) * 6}
    assert np.diff([command.seq for command in streamed]).tolist() == [1] * (len(streamed) - 1)


def test_another_arm_with_a_sliding_joint_is_moved_in_degrees_and_millimetres() -> None:
    stanford = load_robot("stanford")
    slide = int(stanford.prismatic.argmax())
    fake = FakeRobot(tuple(stanford.poses["park"]), name="stanford")
    with in_lockstep(fake), rccl.control("stanford") as arm:
        goal = arm.joints
        goal[slide] += 40.0
        p = arm.jposition("p", goal)
        arm.move(p)
        arm.waitfor(p.end)
        wait_until_at(p)
        assert arm.how.q[slide] == pytest.approx(stanford.poses["park"][slide] + 0.04)


def test_the_sequence_number_may_wrap(quiet_robot) -> None:
    quiet_robot.seq = (1 << 32) - 40
    with rccl.control() as arm:
        p = near_park("p", 5.0)
        arm.move(p)
        arm.waitfor(p.end)
        assert p.code == DONE


def test_a_pose_is_always_the_same_descriptor(quiet_robot) -> None:
    with rccl.control() as arm:
        assert rccl.park is arm.pose("park")
        assert arm.joints == pytest.approx(PARK_DEG)


def test_without_control_every_call_says_so() -> None:
    with pytest.raises(LinkError, match="call control"):
        rccl.move(rccl.Position("p", np.array(PARK)))
    with pytest.raises(LinkError, match="call control"):
        _ = rccl.nbrequest
    with pytest.raises(AttributeError, match="no attribute 'hypnotise'"):
        _ = rccl.hypnotise


def test_lockstep_runs_are_the_same_every_time() -> None:
    def path() -> list[tuple[float, ...]]:
        fake = FakeRobot(PARK)
        with in_lockstep(fake), rccl.control() as arm:
            arm.setjvel(share=0.8)
            arm.move(near_park("p", 15.0, -10.0))
            arm.move(arm.pose("park"))
            arm.waitas(lambda: arm.pose("park").scal > 0.5)
            arm.stop()
            arm.waitfor(arm.completed)
        return fake.path

    assert path() == path()
