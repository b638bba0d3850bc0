"""The machines of the paper that are emulated: the same program moves each of them (Corke & Kirkham, section 3.2)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from qrobot.arcl import (
    ARCL_AMI,
    ARCL_PERIOD,
    ARCL_START,
    ARCL_STREAM,
    EVENT_FAULT,
    GRIP_CLOSE,
    IOD_OUT,
    MOV_CONFIG,
    MOV_SHARE,
    MOV_TIME,
    MOV_TRAJ,
    TRAJ_CART,
    ami_treal,
    arcl_close,
    arcl_errproc,
    arcl_open,
    arcl_wait,
    gripper,
    iod_read,
    iod_write,
    joint_pos,
    move,
    new_iod,
)
from qrobot.arcl.machine import MachineSettings, machine
from qrobot.arcl.machine.arm_owner import dismiss_owners, owner_of
from qrobot.arcl.machine.step_motors import SHORTEST_S, StepMotors
from qrobot.arcl.machine.stepper import MOST_PER_S, PLAY, STEPS_PER_TURN
from qrobot.arcl.robot import ArclRobot
from qrobot.arcl.stream import RecordKind, read_stream
from qrobot.config import load_robot
from qrobot.errors import LinkBusy, LinkLost, MotionError, ServoFault
from tests.support.arcl import at, forget_programs

PUMA = load_robot("puma560")
AWAY = (20.0, 120.0, -10.0, 10.0, 60.0, -160.0)
GEAR = PUMA.transmission.gear
RESOLVED = {  # degrees of a joint: how finely each machine can place it
    "offline": np.full(6, 1e-6),
    "ceded": np.full(6, 1e-6),
    "loops": np.degrees(3.0 * np.abs(PUMA.transmission.rad_per_count)),
    "stepper": 360.0 / (GEAR * STEPS_PER_TURN) * (0.5 + PLAY),
}


@pytest.fixture(autouse=True)
def _alone() -> Iterator[None]:
    forget_programs()
    dismiss_owners()
    yield
    forget_programs()
    dismiss_owners()


def passes(ms: float) -> None:
    """Let time pass for the robot that was opened last."""
    end = ami_treal() + ms
    arcl_wait(_opened[-1], lambda: ami_treal() >= end)


_opened: list[ArclRobot] = []


def opened(name: str, *attributes: object) -> ArclRobot:
    _opened[:] = [arcl_open(ARCL_AMI, name, ARCL_PERIOD, 28, *attributes)]
    return _opened[0]


def program(rp: ArclRobot) -> tuple[np.ndarray, ...]:
    """Joints, a via point, a straight line, hand and lines; where the joints are at the three stops, degrees."""
    move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 1500, 0)
    arcl_wait(rp)
    passes(800)
    stops = [rp.joints]
    gripper(rp, GRIP_CLOSE)
    move(rp, joint_pos(rp, "via", (-20.0, *AWAY[1:])), MOV_SHARE, 40, 0)
    move(rp, at(450, -100, 250), MOV_CONFIG, "run", MOV_TIME, 1000, 0)
    arcl_wait(rp)
    passes(800)
    stops.append(rp.joints)
    lines = new_iod(rp, IOD_OUT, 3, 2)
    iod_write(lines, 2)
    move(rp, at(450, 100, 250), MOV_TRAJ, TRAJ_CART, MOV_TIME, 1500, 0)
    arcl_wait(rp)
    passes(800)
    assert iod_read(lines) == 2
    return (*stops, rp.joints)


@pytest.fixture(scope="module")
def ideal() -> tuple[np.ndarray, ...]:
    """Where the program ends on the machine without an arm."""
    forget_programs()
    stops = program(opened("offline"))
    forget_programs()
    return stops


@pytest.mark.parametrize("name", ["ceded", "loops", "stepper"])
def test_the_same_program_ends_at_the_same_joints_on_every_machine(
    name: str, ideal: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    rp = opened(name, ARCL_STREAM, str(tmp_path / "run.arcl"))
    stops = program(rp)
    arcl_close(rp)
    for reached, wanted in zip(stops, ideal, strict=True):
        assert (np.abs(reached - wanted) <= RESOLVED[name]).all()
    stream = read_stream(tmp_path / "run.arcl")
    assert (stream.start.machine, stream.damage) == (name, "")
    assert len(stream.of(RecordKind.GRIPPER)) == len(stream.of(RecordKind.OUTPUT)) == 1
    if name != "stepper":  # which has no encoders
        (_, asked), (_, measured) = (stream.table(kind, 6) for kind in (RecordKind.JOINTS, RecordKind.MEASURED))
        assert 0.0 <= np.abs(asked - measured).max() < 0.06  # it follows on the way too


def test_axes_without_their_loops_drift_and_one_that_is_held_stops_the_arm() -> None:
    rp, told = opened("loops"), []
    arcl_errproc(lambda event, _, error: told.append((event, type(error))))
    axes = rp.ami.arm.axes
    for _ in range(1000):
        axes.run(np.zeros(6, dtype=np.int64), 1e-3)
    assert (axes.joint_errors(axes.counters - axes.counts_at(np.array(PUMA.poses["park"]))) > 1e-3).all()
    passes(2000)
    assert np.allclose(np.radians(rp.joints) + rp.aki.zero, PUMA.poses["park"], atol=1e-3)
    axes.blocked[2] = True
    move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 1500, 0)
    with pytest.raises(ServoFault, match=r"FOLLOWING: joint 3 \(elbow\) is .* deg from its setpoint, 3.4 allowed"):
        arcl_wait(rp)
    assert told == [(EVENT_FAULT, ServoFault)]
    assert axes.blocked.all()


def test_a_stepper_takes_the_time_its_motors_need_and_loses_no_step() -> None:
    rp = opened("stepper")
    motors, begun = rp.ami.arm.motors, ami_treal()
    far = (0.0, 90.0, -90.0, 90.0, 0.0, 0.0)
    move(rp, joint_pos(rp, "far", far), MOV_TIME, 200, 0)  # the joints could do that in a third of a second
    arcl_wait(rp)
    most = (0.5 * GEAR[5] * STEPS_PER_TURN) / MOST_PER_S  # of joint 6, which turns by half a turn
    assert 1.0 < (ami_treal() - begun) / (1e3 * most) < 1.2
    assert not motors.lost.any()
    wanted = np.radians(far) * rp.ami.arm.steps_per_unit
    assert (np.abs(motors.steps - wanted) <= 0.5 + PLAY).all()


def test_a_motor_is_never_sent_faster_than_it_can_turn_and_loses_what_comes_too_fast() -> None:
    settings = MachineSettings(PUMA, np.zeros(6), 20.0)
    ami = machine("stepper", settings)
    stands = ami.open()
    ami.start(lambda _: stands + np.array([0.0, 0.0, 0.0, 0.1, 0.0, 0.0]))
    with pytest.raises(ServoFault, match=r"SP_STEP: joint 4 \(wrist_roll\) would need \d+ steps/s, .* takes 4000"):
        ami.wait(lambda: ami.treal() > 100.0)
    motors = StepMotors(np.zeros(1, dtype=np.int64))
    motors.pulse(0, 1, SHORTEST_S * np.array([1.0, 2.0, 2.5, 3.6]))
    motors.pulse(0, -1, SHORTEST_S * np.array([3.61, 5.0]))
    assert (motors.steps[0], motors.lost[0]) == (2, 2)


def test_an_arm_is_ceded_to_one_program_at_a_time_and_stays_where_it_was_left() -> None:
    rp = opened("ceded")
    with pytest.raises(LinkBusy, match="puma560 is ceded to"):
        arcl_open(ARCL_AMI, "ceded", 0)
    move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 1500, 0)
    arcl_close(rp)
    with pytest.raises(MotionError, match="leave ARCL_START out"):
        opened("ceded", ARCL_START, (0.0, 90.0, -90.0, 0.0, 45.0, 0.0))
    again = opened("ceded")
    passes(100)
    assert np.allclose(again.joints, AWAY)


def test_an_owner_takes_an_arm_back_and_a_program_that_goes_wrong_loses_it() -> None:
    rp = opened("ceded")
    owner = owner_of(PUMA, np.zeros(6))
    move(rp, joint_pos(rp, "away", AWAY), MOV_TIME, 1500, 0)
    passes(700)
    before, speed = owner.q.copy(), owner.v.copy()
    owner.take_back("the operator asked for it")
    with pytest.raises(LinkLost, match="puma560 was taken back: the operator asked for it"):
        arcl_wait(rp)
    assert (np.sign(owner.q - before) == np.sign(speed)).all()  # braked, not stopped dead
    assert not owner.v.any()
    ami = machine("ceded", MachineSettings(PUMA, np.zeros(6), 20.0))
    stands = ami.open()
    ami.start(lambda _: stands + np.array([0.0, 0.0, 0.3, 0.0, 0.0, 0.0]))
    with pytest.raises(LinkLost, match=r"joint 3 \(elbow\) was sent too far within one sample"):
        ami.wait(lambda: ami.treal() > 100.0)
    assert (owner.holder, owner.q.tolist()) == ("", stands.tolist())
