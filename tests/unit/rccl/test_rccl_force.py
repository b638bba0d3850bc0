"""comply, lock and limit as a program calls them, against a robot that answers but does not give way."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import MotionError, Singular, Unreachable
from qrobot.model.dynamics import dynamics_params, dynamics_work, gravity_torque
from qrobot.model.stiction_compensation import PUSH_SHARE, REST_SHARE
from qrobot.motion import TransformKind
from qrobot.motion.force import force_control as force
from qrobot.motion.force.joint_matching import JointIndices
from qrobot.rccl import EQ, TL, Transform, gentr_rot, gentr_trsl, makeposition, t6, yunit
from qrobot.rci import VirtualLink
from qrobot.wire import JointMode, RobotState
from tests.support.fake_robot import FakeRobot
from tests.support.puma import PARK, ROBOT, arm

E = gentr_trsl("E", 0, 0, 76.25)
P = makeposition("P", t6, E, EQ, gentr_rot("TABLE", 550, 0, -400, yunit, 180), TL, E)


class CarryingRobot(FakeRobot):
    """It commands the torques that carry it and press, and may be away from where its servo wants it."""

    away = np.zeros(ROBOT.n)
    pressing = np.zeros(ROBOT.n)

    def _state(self) -> RobotState:
        state, tau = super()._state(), np.empty(ROBOT.n)
        gravity_torque(np.array(state.q), dynamics_params(ROBOT), dynamics_work(ROBOT.n), tau)
        return replace(state, tau=tuple(tau + self.pressing), q_setpoint=tuple(state.q + self.away))


@pytest.fixture
def robot() -> Iterator[CarryingRobot]:
    fake = CarryingRobot(tuple(PARK))
    with rccl.use(lambda hello: VirtualLink(hello, fake.transfer)), rccl.control("puma560"):
        rccl.move(P)
        rccl.waitfor(rccl.completed)
        yield fake


def wait(ms: float) -> None:
    end = rccl.how.t_ns + ms * 1e6
    rccl.waitas(lambda: rccl.how.t_ns >= end)


def comply(dirs: str, *values: float) -> None:
    rccl.comply(dirs, *values)
    rccl.move(P)
    wait(800)


def test_one_joint_leaves_its_position_servo_for_a_compliant_direction_until_it_is_locked(robot) -> None:
    comply("fz", 0.0)
    assert robot.commands[-1].modes == (1, int(JointMode.TORQUE), 1, 1, 1, 1)
    rccl.lock("fz")
    rccl.move(P)
    wait(200)
    assert robot.commands[-1].modes == (int(JointMode.POSITION),) * 6


def test_the_torque_is_that_of_the_force_alone_friction_is_the_servos(robot) -> None:
    """tau = J' f: 20 N down, 0.55 m out and beside the shoulder by d2 + d3."""
    comply("fz", 20.0)
    wait(400)
    assert robot.commands[-1].setpoints[1] == pytest.approx(20.0 * np.sqrt(0.55**2 - 0.1501**2), abs=0.3)


def test_a_joint_that_pressed_harder_is_first_let_back_as_far_as_friction_holds_it(robot) -> None:
    """It exerts 40 N m when it begins to give way, and shall exert 10.6 N m: Coulomb friction up is 7.65 N m."""
    robot.pressing = np.array([0.0, 40.0, 0.0, 0.0, 0.0, 0.0])
    wait(200)
    begin = len(robot.commands)
    comply("fz", 20.0)
    wait(400)
    torques = np.array([c.setpoints[1] for c in robot.commands[begin:] if c.modes[1] == JointMode.TORQUE])
    level = 20.0 * np.sqrt(0.55**2 - 0.1501**2)
    least = level - REST_SHARE * 7.65
    assert torques.min() == pytest.approx(least * PUSH_SHARE / (PUSH_SHARE + REST_SHARE), abs=0.3)
    assert torques[-1] == pytest.approx(level, abs=0.3)


def test_no_torque_jumps_when_a_joint_begins_to_give_way(robot) -> None:
    begin = len(robot.commands)
    comply("fz", 20.0)
    torques = [command.setpoints[1] for command in robot.commands[begin:] if command.modes[1] == JointMode.TORQUE]
    steps = np.abs(np.diff([0.0, *torques]))
    assert steps.max() < 0.3 * max(torques)
    assert torques[0] == pytest.approx(0.0, abs=2.0)


def test_a_second_direction_takes_a_second_joint_and_lock_gives_only_its_own_back(robot) -> None:
    comply("fz", 5.0)
    comply("fx", 0.0)
    assert sum(mode == JointMode.TORQUE for mode in robot.commands[-1].modes) == 2
    rccl.lock("fx")
    rccl.move(P)
    wait(800)
    assert sum(mode == JointMode.TORQUE for mode in robot.commands[-1].modes) == 1


@pytest.mark.parametrize(
    ("dirs", "values"), [("dz", (0.0,)), ("fz fz", (0.0, 0.0)), ("fx fz", (0.0,)), ("", ()), ("fz", (np.nan,))]
)
def test_a_malformed_compliance_is_refused(robot, dirs, values) -> None:
    with pytest.raises(MotionError):
        rccl.comply(dirs, *values)


def test_what_does_not_comply_cannot_be_locked(robot) -> None:
    with pytest.raises(MotionError, match="complies along nothing"):
        rccl.lock("fz")
    rccl.comply("fx", 0.0)
    with pytest.raises(MotionError, match="complies along fx"):
        rccl.lock("fz")


def test_a_force_beyond_the_joints_is_refused_with_the_joint(robot) -> None:
    rccl.comply("fz", 400.0)
    with pytest.raises(MotionError, match=r"joint 2 \(shoulder\) would need .* allowed; ask for less"):
        rccl.move(P)


def test_to_comply_a_position_needs_an_equation(robot) -> None:
    rccl.comply("fz", 0.0)
    with pytest.raises(MotionError, match="needs an equation"):
        rccl.move(rccl.pose("park"))


def test_a_singular_or_unreachable_goal_is_refused(robot) -> None:
    straight = PARK * [1, 1, 1, 1, 0, 1]  # joint 5 at zero: 4 and 6 in line
    pose = arm().forward(straight)
    here = Transform("HERE", TransformKind.CONST, pose)
    rccl.comply("fz", 0.0)
    with pytest.raises(Singular):
        rccl.move(makeposition("STRAIGHT", t6, EQ, here, TL, t6))
    with pytest.raises(Unreachable):
        rccl.move(makeposition("FAR", t6, E, EQ, gentr_trsl("F", 5000, 0, 0), TL, E))


def test_an_absolute_stop_ends_the_compliance(robot) -> None:
    comply("fz", 0.0)
    rccl.stop()
    wait(400)
    assert robot.commands[-1].modes == (int(JointMode.POSITION),) * 6


def push(robot: CarryingRobot, joint: int, step_rad: float, until: float) -> None:
    """From now on somebody turns a joint a little in each sample, as long as the arm gives way."""

    def turn(seq: int) -> None:
        assert seq < 1000, "nothing ends this"
        q = np.array(robot.q)
        if JointMode.TORQUE in robot.commands[-1].modes:
            q[joint] += np.clip(until - q[joint], -abs(step_rad), abs(step_rad))
        robot.q = tuple(q)

    robot.before_period = turn


@pytest.mark.parametrize("under_way", [True, False])
@pytest.mark.parametrize("until", [-2.0, 1.0])
def test_an_arm_that_is_carried_to_the_end_of_its_reach_stops_giving_way_and_says_why(robot, until, under_way) -> None:
    comply("fz", 5.0)
    if under_way:
        rccl.setime(100, 9000)
        rccl.move(P)
        wait(300)
    push(robot, 1, 0.006, until)
    rccl.waitas(lambda: JointMode.TORQUE not in robot.commands[-1].modes)
    wait(1000)
    assert P.code in (rccl.Termination.UNREACHABLE, rccl.Termination.JOINT_LIMIT, rccl.Termination.SINGULAR)
    assert robot.commands[-1].modes == (int(JointMode.POSITION),) * 6
    assert np.abs(np.diff(robot.path[-30:], axis=0)).max() < 0.03  # it is brought to rest where it was carried to


def test_an_arm_that_only_holds_says_when_no_joint_serves_its_direction_any_more(robot, monkeypatch) -> None:
    comply("fz", 5.0)
    rccl.waitfor(rccl.completed)

    def none_serves(*_: object) -> JointIndices:
        raise Singular("no joints move the controlled frame")

    monkeypatch.setattr(force, "fitness", lambda *_: 0.0)
    monkeypatch.setattr(force, "match", none_serves)
    wait(600)
    assert P.code == rccl.Termination.SINGULAR
    assert robot.commands[-1].modes == (int(JointMode.POSITION),) * 6


@pytest.mark.parametrize(("before", "locked", "after"), [("fz", "", "fx"), ("fz fx", "fx", ""), ("fz", "fz", "fx")])
def test_a_change_of_directions_that_no_joint_serves_ends_the_motion_at_rest(
    robot, monkeypatch, before: str, locked: str, after: str
) -> None:
    comply(before, *(0.0 for _ in before.split()))
    if locked:
        rccl.lock(locked)
    if after:
        rccl.comply(after, 0.0)

    def none_serves(*_: object) -> JointIndices:
        raise Singular("no joints move the controlled frame")

    rccl.move(P)
    monkeypatch.setattr(force, "match", none_serves)
    robot.q = tuple(np.array(robot.q) + 1e-3)
    wait(800)
    assert P.code == rccl.Termination.SINGULAR
    assert robot.commands[-1].modes == (int(JointMode.POSITION),) * 6
    assert np.ptp([command.setpoints for command in robot.commands[-5:]], axis=0).max() < 1e-9


def test_joints_that_are_in_line_do_not_disturb_one_that_gives_way_elsewhere(robot) -> None:
    """Joint 5 is turned to zero, where 4 and 6 are in line; the shoulder moves the tool up and down as before."""
    comply("fz", 5.0)
    begin = len(robot.commands)
    push(robot, 4, 0.02, 0.0)
    rccl.waitas(lambda: robot.q[4] == 0.0)
    wait(500)
    told = robot.commands[begin:]
    torques = np.array([command.setpoints[1] for command in told])
    assert {command.modes for command in told} == {(1, int(JointMode.TORQUE), 1, 1, 1, 1)}
    assert np.abs(np.diff(torques)).max() < 5.0  # of 180 allowed
    assert np.ptp([command.setpoints for command in told[-10:]], axis=0).max() < 0.01


@pytest.mark.parametrize(("spec", "values"), [("fz", (0.0,)), ("fz", (-3.0,)), ("gz", (1.0,)), ("fz dz", (1.0,))])
def test_a_malformed_limit_is_refused(robot, spec, values) -> None:
    with pytest.raises(MotionError):
        rccl.limit(spec, *values)


def test_a_limit_of_displacement_ends_a_motion_the_robot_does_not_follow(robot) -> None:
    """The robot stays behind its reference by 0.02 rad: 11 mm at the tool."""
    robot.away = np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0])
    P.end = 0
    rccl.limit("dz", 5.0)
    rccl.distance("dz", -50.0)
    rccl.move(P)
    rccl.waitfor(P.end)
    assert P.code == rccl.Termination.MOTION_LIMIT


@pytest.mark.parametrize("mode", ["joint", "cartesian"])
def test_a_limit_ends_a_stop_that_takes_seconds(robot, mode) -> None:
    rccl.setmode(mode)
    rccl.setime(200, 2000)
    P.end = 0
    rccl.limit("dz", 5.0)
    rccl.distance("dz", -50.0)
    rccl.move(P)
    wait(500)
    rccl.stop(9000)
    wait(100)
    robot.away = np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0])
    begin_ns = rccl.how.t_ns
    rccl.waitfor(P.end)
    assert P.code == rccl.Termination.MOTION_LIMIT
    assert rccl.how.t_ns - begin_ns < 0.6e9


def test_a_limit_holds_until_its_motion_has_ended_in_the_middle_of_the_transition(robot) -> None:
    q = makeposition("Q", t6, E, EQ, gentr_rot("UP", 550, 0, -300, yunit, 180), TL, E)
    rccl.setmode("cartesian")
    rccl.setvel(100, 90)
    P.end = 0
    rccl.limit("dz", 5.0)
    rccl.distance("dz", -50.0)
    rccl.move(P)
    rccl.move(q)
    rccl.waitas(lambda: rccl.nbrequest == 1)
    rccl.waitas(lambda: rccl.nbrequest == 0)
    assert P.end.count == 0
    robot.away = np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0])
    rccl.waitfor(P.end)
    assert P.code == rccl.Termination.MOTION_LIMIT
    rccl.waitfor(rccl.completed)
    assert q.code == rccl.Termination.COMPLETED


def test_a_limit_holds_for_one_motion_alone(robot) -> None:
    rccl.limit("fz", 1000.0)
    rccl.move(P)
    rccl.waitfor(rccl.completed)
    assert P.code == rccl.Termination.COMPLETED
    assert rccl.program.arm()._next.limit is None


def test_what_the_arm_exerts_is_known_once_the_program_has_told_the_load_that_others_have_told_before() -> None:
    fake = FakeRobot(tuple(PARK))
    fake.payload_mass = 2.0
    with rccl.use(lambda hello: VirtualLink(hello, fake.transfer)), rccl.control("puma560") as arm:
        for asks in (lambda: arm.limit("fz", 15.0), lambda: arm.comply("fz", 0.0), lambda: arm.exerted):
            with pytest.raises(MotionError, match=r"carries 2 kg, and this program has told 0: .* by `setload`"):
                asks()
        arm.limit("dx", 5.0)  # a way needs no forces
        seen: list[int] = []
        arm.each_sample(lambda: seen.append(arm.exerted.torque.size))
        arm.setload(2.0, (0.0, 0.0, 50.0))
        arm.limit("fz", 15.0)
        fake.payload_mass = 0.5  # the servo goes over to it, or has started anew
        arm.setload(2.5)
        arm.setload(0.0)
        assert arm.exerted.torque.shape == PARK.shape
    assert set(seen) == {ROBOT.n}
