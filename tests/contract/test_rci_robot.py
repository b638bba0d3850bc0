"""A task of RCI that has a robot, around which its control functions stand as in Figure 4 of the paper."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
import pytest

from qrobot import rci
from qrobot.config.fences import Fence
from qrobot.errors import ConfigError, FenceCrossed, JointLimit, LinkError, MotionError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.in_force import use_fences
from qrobot.motion import motion_limits
from qrobot.rci import TaskDescriptor, TaskState, VirtualLink
from qrobot.rci.robot_cycle import MOST_STARTS
from qrobot.wire import JointMode, Mode
from tests.support.fake_robot import HALT_TOLD_PERIODS, FakeRobot
from tests.support.late_robot import LATE, hear_power_late, lose_power, lose_streams, stop_power_up
from tests.support.puma import PARK, ROBOT

START = tuple(float(x) for x in PARK)
PERIOD_S = 0.028
SAMPLE_TICKS = 28  # at 1000 Hz


@pytest.fixture
def robot() -> Iterator[FakeRobot]:
    """A robot that a program on virtual time finds, with a clock of 1000 Hz."""
    fake = FakeRobot(START)
    with rci.use(lambda hello: VirtualLink(hello, fake.transfer)):
        rci.rci_clock(1000)
        yield fake
        rci.rci_close()


def task(control1: Callable[[TaskDescriptor], object], control2=None, name: str = "puma560") -> TaskDescriptor:
    td = rci.rci_create(name)
    rci.rci_control(td, control1, control2)
    return td


def started(control: Callable[[TaskDescriptor], object]) -> TaskDescriptor:
    td = task(control)
    rci.rci_start(td.bit)
    return td


def wait_runs(td: TaskDescriptor, n: int) -> None:
    end = td.runs + n
    rci.rci_wait(lambda: td.runs >= end)


def turn(joint: int, step: float) -> Callable[[TaskDescriptor], None]:
    """A control function that moves one joint by the same step in every sample."""

    def control(td: TaskDescriptor) -> None:
        q = np.array(td.how.q_setpoint)
        q[joint] += step
        td.chg.go_to(tuple(q.tolist()))

    return control


def test_the_cycle_reads_posts_how_calls_control1_sends_and_calls_control2(robot: FakeRobot) -> None:
    seen = []

    def control1(td: TaskDescriptor) -> None:
        seen.append(("control1", td.how.t_ns, len(robot.commands)))
        td.chg.go_to(START)

    def control2(td: TaskDescriptor) -> None:
        seen.append(("control2", td.how.t_ns, len(robot.commands)))

    td = task(control1, control2)
    rci.rci_start(td.bit)
    seen.clear()
    wait_runs(td, 3)
    times = [t for _, t, _ in seen]
    assert [what for what, _, _ in seen] == ["control1", "control2"] * 3
    assert np.diff(times).tolist() == [0, 28_000_000, 0, 28_000_000, 0]
    assert [n - seen[0][2] for _, _, n in seen] == [0, 0, 1, 1, 2, 2]  # what control1 asks for answers its own sample
    assert [command.seq for command in robot.commands] == sorted({command.seq for command in robot.commands})


def test_a_start_powers_the_arm_and_its_functions_run_once_the_servo_follows(robot: FakeRobot) -> None:
    modes = []
    td = task(lambda td: modes.append(td.how.mode))
    assert td.robot is not None
    assert robot.mode is Mode.OFF
    rci.rci_start(td.bit)
    assert (td.state, robot.mode) == (TaskState.ACTIVE, Mode.TRACKING)
    wait_runs(td, 5)
    assert set(modes) == {Mode.TRACKING}
    assert robot.q == START
    rci.rci_release(td.bit)
    assert (td.state, robot.mode, robot.goodbyes) == (TaskState.RELEASED, Mode.HOLDING, 1)


def test_the_arm_follows_what_the_control_function_asks_for(robot: FakeRobot) -> None:
    td = task(turn(0, 0.01))
    rci.rci_start(td.bit)
    wait_runs(td, 20)
    steps = np.diff(np.array(robot.path)[:, 0])
    assert steps[steps > 1e-9] == pytest.approx(0.01)
    assert robot.q[0] == pytest.approx(START[0] + 0.19)
    assert robot.q[1:] == START[1:]


def test_a_released_task_is_started_again_where_the_arm_stands(robot: FakeRobot) -> None:
    td = task(turn(1, -0.01))
    for _ in range(2):
        rci.rci_start(td.bit)
        wait_runs(td, 5)
        rci.rci_release(td.bit)
    assert robot.goodbyes == 2
    assert np.abs(np.diff(np.array(robot.path)[:, 1])).max() == pytest.approx(0.01)


def test_a_stop_under_way_ends_without_power_when_that_is_asked_for(robot: FakeRobot) -> None:
    td = task(lambda td: td.chg.go_to(START) if td.runs < 5 else 1 / 0)
    rci.rci_start(td.bit)
    with pytest.raises(ZeroDivisionError):
        wait_runs(td, 10)
    assert td.state is TaskState.RELEASING
    rci.rci_release(td.bit, power_off=True)
    assert (td.state, robot.mode) == (TaskState.ENDED, Mode.OFF)


@pytest.mark.parametrize("fails", [True, False])
def test_an_arm_that_its_task_has_left_holding_loses_power_when_that_is_asked_for(robot: FakeRobot, fails) -> None:
    td = task(lambda td: td.chg.go_to(START) if td.runs < 5 else 1 / (not fails))
    rci.rci_start(td.bit)
    if fails:
        with pytest.raises(ZeroDivisionError):
            wait_runs(td, 10)
        rci.rci_wait(lambda: td.state is TaskState.ENDED)
    else:
        rci.rci_release(td.bit)
    assert robot.mode is Mode.HOLDING
    for _ in range(2):
        rci.rci_release(td.bit, power_off=True)
        assert (td.state, robot.mode) == (TaskState.ENDED if fails else TaskState.RELEASED, Mode.OFF)
        assert robot.goodbyes == 2  # and nobody greets an arm that is off


def test_an_interval_on_the_clock_is_the_robots_sample_period(robot: FakeRobot) -> None:
    at = []
    td = task(lambda _: at.append(rci.rci_ticks()))
    rci.rci_onclock(td, 12, 5)
    rci.rci_start(td.bit)
    wait_runs(td, 10)
    assert robot.period_us == 12_000
    assert {(tick - 5) % 12 for tick in at} == {0}
    assert set(np.diff(at)) == {12}
    with pytest.raises(ConfigError, match="release it first"):
        rci.rci_onclock(td, 20)
    rci.rci_release(td.bit)
    rci.rci_onclock(td, 101)
    with pytest.raises(ConfigError, match="1 to 100 ms, not 101 ms"):
        rci.rci_start(td.bit)


def test_tasks_with_and_without_a_robot_keep_their_own_rates_on_one_clock(robot: FakeRobot) -> None:
    ran = []
    arm = task(lambda _: ran.append((rci.rci_ticks(), "arm")))
    rci.rci_onclock(arm, SAMPLE_TICKS)
    fast = task(lambda _: ran.append((rci.rci_ticks(), "filter")), name="filter")
    rci.rci_onclock(fast, 4, 2)
    rci.rci_start(arm.bit | fast.bit)
    begin = rci.rci_ticks()
    rci.rci_wait(lambda: rci.rci_ticks() >= begin + 280)
    expected = [(t, name) for t in range(begin + 1, begin + 281) for name, due in
                (("arm", t % 28 == 0), ("filter", (t - 2) % 4 == 0)) if due]  # fmt: skip
    assert sorted(ran) == sorted(expected)


@pytest.mark.parametrize(
    ("control", "kind", "text"),
    [
        (turn(0, 0.5), MotionError, "task puma560: joint 1 .* would need 17.86 rad/s"),
        (lambda td: td.chg.go_to((9.0, *START[1:])), JointLimit, "task puma560: joint 1 .* is outside"),
        (lambda td: td.chg.go_to((np.nan, *START[1:])), MotionError, "finite joint positions"),
        (lambda td: td.chg.go_to(START[:5]), MotionError, "a mode and a setpoint for each of 6 joints"),
        (lambda td: setattr(td.chg, "modes", (7,) * 6), MotionError, "a mode and a setpoint"),
        (lambda td: td.chg.drive((500.0, *START[1:]), (True, *[False] * 5)), MotionError, "500 on joint 1, at most"),
        (lambda _: 1 / 0, ZeroDivisionError, "division"),
        (lambda td: setattr(td.chg, "hand", 1.0), MotionError, "hand 1.0"),
        (lambda td: setattr(td.chg, "outputs", 1.5), MotionError, "outputs 1.5"),
        (lambda td: setattr(td.chg, "modes", (1.0,) * 6), MotionError, "a mode and a setpoint"),
        (lambda td: held_at(td, float("nan")), MotionError, "no finite numbers"),
        (lambda td: setattr(td.chg, "hand", 7), MotionError, "hand 7"),
        (lambda td: setattr(td.chg, "outputs", 1 << 40), MotionError, "16 bits exist"),
        (lambda td: setattr(td.chg, "outputs", -1), MotionError, "16 bits exist"),
    ],
)
def test_what_must_not_be_asked_for_is_never_sent_and_the_arm_comes_to_a_stop(robot, control, kind, text) -> None:
    td = task(lambda td: td.chg.go_to(START))
    rci.rci_start(td.bit)
    wait_runs(td, 2)
    sent = len(robot.commands)
    rci.rci_control(td, control)
    with pytest.raises(kind, match=text):
        wait_runs(td, 2)
    rci.rci_wait(lambda: td.state is TaskState.ENDED)
    assert [command.stop for command in robot.commands[sent:]].count(True) == 1
    assert all(set(c.modes) == {JointMode.HOLD} for c in robot.commands if c.stop)
    moved = [c for c in robot.commands[sent:] if JointMode.TORQUE in c.modes]
    assert (moved, robot.mode, robot.q, robot.goodbyes) == ([], Mode.HOLDING, START, 1)


def held_at(td: TaskDescriptor, setpoint: float) -> None:
    """Hold all joints, with a setpoint that does not matter."""
    td.chg.hold()
    td.chg.setpoints = (setpoint,) * 6


@pytest.mark.parametrize("kind", [list, np.array])
@pytest.mark.parametrize("where", ["control1", "control2"])
def test_a_setpoint_that_is_changed_in_place_is_judged_by_what_went_out_before(robot: FakeRobot, kind, where) -> None:
    q = kind(START)

    def jump(td: TaskDescriptor) -> None:
        if td.runs > 5:
            q[0] += 0.5

    def control1(td: TaskDescriptor) -> None:
        if where == "control1":
            jump(td)
        td.chg.go_to(q)

    td = task(control1, jump if where == "control2" else None)
    rci.rci_start(td.bit)
    with pytest.raises(MotionError, match=r"would need 17\.86 rad/s"):
        wait_runs(td, 10)
    assert np.ptp(np.array(robot.path), axis=0).max() == 0.0


def test_the_largest_step_that_is_allowed_is_followed(robot: FakeRobot) -> None:
    step = float(ROBOT.limits.v_max[0]) * PERIOD_S
    td = task(turn(0, step))
    rci.rci_start(td.bit)
    wait_runs(td, 3)
    assert robot.q[0] == pytest.approx(START[0] + 2 * step)


def test_a_fault_of_the_servo_ends_the_task_with_its_name_and_its_last_samples(robot: FakeRobot) -> None:
    td, other = task(turn(0, 0.001)), task(lambda _: None, name="filter")
    rci.rci_onclock(other, 1)
    rci.rci_start(td.bit | other.bit)
    wait_runs(td, 2)
    robot.break_down(FaultCode.ESTOP)
    with pytest.raises(ServoFault) as caught:
        wait_runs(td, 5)
    assert (caught.value.code, caught.value.trace[-1].fault) == (FaultCode.ESTOP, FaultCode.ESTOP)
    wait_runs(other, 50)
    assert (td.state, other.state) == (TaskState.ENDED, TaskState.ACTIVE)


def test_what_the_servo_told_before_power_was_asked_for_is_no_answer_to_that(robot: FakeRobot) -> None:
    hear_power_late(robot)
    td = task(turn(0, 0.001))
    rci.rci_start(td.bit)
    assert robot.seq > LATE
    wait_runs(td, 3)


@pytest.mark.parametrize("before", [FaultCode.NONE, FaultCode.STREAM_LOST])
def test_an_arm_that_brakes_and_loses_its_power_is_asked_for_it_when_it_is_off(robot: FakeRobot, before) -> None:
    robot.event = before
    lose_power(robot)
    td = task(turn(0, 0.001))
    rci.rci_start(td.bit)
    assert robot.seq > LATE
    wait_runs(td, 3)


def test_power_that_another_program_had_asked_for_and_somebody_stopped_is_not_asked_for_anew(robot: FakeRobot) -> None:
    stop_power_up(robot)
    with pytest.raises(ServoFault, match="no arm power: POWER_STOPPED"):
        rci.rci_start(task(turn(0, 0.001)).bit)
    assert robot.mode is Mode.OFF


@pytest.mark.parametrize("before", [FaultCode.NONE, FaultCode.STREAM_LOST, FaultCode.POWER_NO_ACK])
def test_power_that_is_refused_ends_the_task_also_for_the_reason_of_last_time(robot: FakeRobot, before) -> None:
    robot.event, robot.refuse_power = before, True
    with pytest.raises(ServoFault, match="no arm power: POWER_NO_ACK"):
        rci.rci_start(task(turn(0, 0.001)).bit)
    assert robot.seq < 2.0 / PERIOD_S


@pytest.mark.parametrize("stops", [False, True])
def test_a_stream_that_is_lost_before_it_moves_the_arm_begins_again(robot: FakeRobot, stops: bool) -> None:
    lose_streams(robot, MOST_STARTS - 1, stops)
    td = task(turn(0, 0.001))
    rci.rci_start(td.bit)
    assert len({command.stream for command in robot.commands if any(command.modes)}) == MOST_STARTS
    wait_runs(td, 10)
    assert robot.q[0] == pytest.approx(START[0] + 0.009)


@pytest.mark.parametrize(("streams", "move"), [(MOST_STARTS, 0.0), (1, 1e-5)])
def test_it_ends_the_task_when_that_happens_too_often_or_has_moved_the_arm(robot: FakeRobot, streams, move) -> None:
    lose_streams(robot, streams, move=move)
    with pytest.raises(ServoFault, match="does not follow the setpoints: STREAM_LOST"):
        rci.rci_start(task(turn(0, 0.001)).bit)


def test_no_stream_begins_again_where_somebody_has_taken_power_away_meanwhile(robot: FakeRobot) -> None:
    robot.mode = Mode.HOLDING
    robot.lose_stream_and(FakeRobot.lose_power_by_hand)
    with pytest.raises(ServoFault, match="let go of the arm before it followed"):
        rci.rci_start(task(turn(0, 0.001)).bit)
    assert robot.mode is Mode.OFF
    assert len(robot.streams) == 1


def test_no_stream_begins_again_where_somebody_has_asked_for_a_stop_meanwhile(robot: FakeRobot) -> None:
    robot.lose_stream_and(FakeRobot.stop_by_hand)
    with pytest.raises(ServoFault, match="somebody has stopped the arm before it moved"):
        rci.rci_start(task(turn(0, 0.001)).bit)
    assert robot.mode is Mode.HOLDING
    assert len(robot.streams) == 1
    assert robot.q == START


def test_a_stop_that_comes_before_the_first_setpoints_of_a_task_is_heeded(robot: FakeRobot) -> None:
    """The servo follows a stream of which it hears after the stop, and tells for a while that there was one."""
    robot.mode = Mode.HOLDING
    robot.script((2, FakeRobot.tell_stop_before_stream))
    with pytest.raises(ServoFault, match="somebody has stopped the arm before it moved"):
        wait_runs(started(turn(0, 0.001)), 1)
    assert robot.q == START


@pytest.mark.parametrize("told_after", [0, 1])
def test_a_stop_that_somebody_asked_for_before_a_task_began_stops_it_not(robot: FakeRobot, told_after: int) -> None:
    """The first state may be older than that stop, as when the program before has just let go."""
    robot.mode = Mode.HOLDING
    robot.script((told_after, FakeRobot.tell_stop_before_stream))
    wait_runs(started(turn(0, 0.001)), 2 * HALT_TOLD_PERIODS)
    assert robot.q[0] > START[0]


def test_a_task_that_waits_for_others_outlives_the_loss_of_its_stream() -> None:
    """Its arm stands, and its functions are called once it follows again."""
    left, right = FakeRobot(START), FakeRobot(START)
    lose_streams(left, 1, since=LATE - 5)
    hear_power_late(right)
    ways = {"puma560": left, "right": right}
    with rci.use({name: partial(VirtualLink, transfer=fake.transfer) for name, fake in ways.items()}):
        rci.rci_robot("right", "puma560")
        modes: list[int] = []
        moved, late = task(lambda td: modes.append(td.how.mode)), task(turn(0, 0.001), name="right")
        rci.rci_start(moved.bit | late.bit)
        wait_runs(moved, 5)
        rci.rci_close()
    assert len({command.stream for command in left.commands if any(command.modes)}) == 2
    assert set(modes) == {Mode.TRACKING}
    assert len(modes) == 5


def test_an_arm_that_cannot_be_had_leaves_nothing_started(robot: FakeRobot) -> None:
    other = task(lambda _: None, name="filter")
    rci.rci_onclock(other, 1)
    td = task(turn(0, 0.001))
    robot.calibrated = False
    with pytest.raises(MotionError, match="not calibrated"):
        rci.rci_start(other.bit | td.bit)
    assert (td.active, other.active, other.runs) == (False, False, 0)


def test_a_robot_of_another_name_is_known_once_it_was_added() -> None:
    left = FakeRobot(START)
    with rci.use({"left": lambda hello: VirtualLink(hello, left.transfer)}):
        rci.rci_robot("left", "puma560")
        rci.rci_robot("right", "puma560")
        tds = [task(turn(0, 0.001), name=name) for name in ("left", "right")]
        rci.rci_start(tds[0].bit)
        wait_runs(tds[0], 3)
        with pytest.raises(ConfigError, match="no way to robot 'right'"):
            rci.rci_start(tds[1].bit)
        assert tds[0].active
        rci.rci_close()


def test_the_bridge_of_another_arm_is_refused() -> None:
    fake = FakeRobot(tuple(ROBOT.poses["park"]), name="puma560")
    fake.name = "stanford"
    with rci.use(lambda hello: VirtualLink(hello, fake.transfer)):
        td = task(turn(0, 0.0))
        with pytest.raises(LinkError):
            rci.rci_start(td.bit)
        rci.rci_close()


def test_limits_conversions_and_calibration_of_the_robot_stand_in_its_parameters(robot: FakeRobot) -> None:
    """Counts and DAC words by the formulas of the board's driver, not by the code under test."""
    td = task(turn(0, 0.0))
    data = td.robot
    assert data is not None
    t = ROBOT.transmission
    q = np.array([0.3, -1.1, 2.0, 0.7, -0.4, 1.3])
    motor = t.coupling @ (q - t.q_offset)
    assert data.counts(q) == pytest.approx(motor / t.rad_per_count + t.count_offset, abs=0.5)
    assert data.joints(data.counts(q)) == pytest.approx(q, abs=3e-4)
    tau = np.array([10.0, -20.0, 5.0, 1.0, -2.0, 0.5])
    volts = np.linalg.inv(t.coupling).T @ tau * t.dac_per_Nm
    assert data.dac(tau).tolist() == (np.trunc(volts).astype(int) + 0x800).tolist()
    assert data.dac(np.zeros(6)).tolist() == [0x800] * 6
    assert data.torques(data.dac(tau)) == pytest.approx(tau, abs=0.2)
    assert data.limits.q_max.tolist() == ROBOT.limits.q_max.tolist()
    assert data.tau_max.tolist() == ROBOT.guard.tau_max.tolist()
    assert data.calibration.index_phase.tolist() == t.index_phase.tolist()
    for junk in (q[:5], np.zeros((6, 6))):
        with pytest.raises(ConfigError, match="has 6 joints"):
            data.counts(junk)
    with pytest.raises(ConfigError, match="whole numbers"):
        data.joints(q)


@pytest.mark.parametrize("step", [0.001, 0.02])
def test_a_task_is_ended_where_a_stop_would_just_end_before_a_fence(step: float) -> None:
    _, start, end, radius = FenceSet(ROBOT, []).capsules_at(PARK)[-1]
    place = (0.0, max(start[1], end[1]) + radius + 0.1, 0.0)
    wall = Fence(name="wall", shape="plane", bodies="tool", position_m=place, rpy_deg=(0.0, 0.0, 90.0))
    fences, fake = FenceSet(ROBOT, [wall]), FakeRobot(START)
    with rci.use(lambda hello: VirtualLink(hello, fake.transfer)), use_fences(fences):
        rci.rci_clock(1000)
        td = task(turn(0, step))
        rci.rci_start(td.bit)
        with pytest.raises(FenceCrossed, match=r"task puma560: flange would be .* fence 'wall'"):
            wait_runs(td, 400)
        rci.rci_close()
    stop_s = 0.5 * 1.875 * (step / PERIOD_S) / motion_limits(ROBOT).a_stop[0]
    rests = np.array(fake.path[-1]) + np.eye(6)[0] * (step / PERIOD_S) * stop_s
    assert fences.distances(rests)[0] >= 0.0199  # its margin
    assert fences.distances(rests + 3.0 * np.eye(6)[0] * step)[0] < 0.0201
