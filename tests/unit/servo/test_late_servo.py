"""A servo that alone was kept from running for tens of milliseconds: the arm has gone on, and nothing else is wrong.

The machine of an emulated arm may do that to it, whose late cycles are counted only.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.motion import Generator, JointSpeed, MoveRequest, motion_limits
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.settings import COUNTED_ONLY, ServoSettings
from qrobot.sim_board.emulator import Emulator, emulator_run
from tests.campaigns.held_up import told_as

PUMA = load_robot("puma560")
PERIOD_S = 0.1
MOVING_AFTER = 12  # setpoints
BEFORE_S = 0.02  # of the frame in which the servo stops
STRAYED = 0.01  # [A] rad, under a torque that is too old; 0.05 is the limit of FOLLOWING for the wrist


def setpoints(period_s: float = PERIOD_S) -> list[list[float]]:
    """A move of all joints that takes some seconds, one for each sample period."""
    generator = Generator(motion_limits(PUMA), period_s, PUMA.poses["park"])
    generator.push(MoveRequest("there", PUMA.poses["end"], JointSpeed(1.05)))
    found, moving = [], True
    while moving:
        output = generator.update(len(found) + 1)
        found.append(output.q.tolist())
        moving = output.moving
    return found


def moving_arm(
    period_s: float = PERIOD_S, frames: int = MOVING_AFTER
) -> tuple[LockstepRig, Callable[[int, int], None]]:
    """An arm that has begun a move by so many setpoints, and what sends one of them, at a time."""
    rig = LockstepRig(PUMA, ServoSettings(overrun=COUNTED_ONLY), Emulator(PUMA, start="park"))
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.1)
    path = setpoints(period_s)

    def send(seq: int, t_ns: int) -> None:
        modes = [POSITION_SETPOINT] * PUMA.n
        assert rig.mailbox.push_setpoint(1, seq, t_ns, round(period_s * 1e9), modes, path[seq])

    for seq in range(frames):
        send(seq, rig.now_ns)
        rig.run_for(period_s)
    return rig, send


def sleep_through(rig: LockstepRig, late_ms: int) -> None:
    """Keep the servo from running; its board goes on."""
    bundle = rig.emulator.bundle
    rig.now_ns = emulator_run(bundle, rig.board, rig.now_ns, late_ms * 1_000_000 // bundle.period_ns)


@pytest.mark.parametrize("late_ms", [20, 45, 70])
@pytest.mark.parametrize("frame", [4, 7, 10])
def test_an_arm_that_went_on_while_its_servo_was_kept_from_running_is_on_its_path(late_ms: int, frame: int) -> None:
    """Its reference and its place are compared as they are after the stall; before, they were `late_ms` apart."""
    rig, send = moving_arm(frames=frame)
    send(frame, rig.now_ns)
    rig.run_for(BEFORE_S)
    sleep_through(rig, late_ms)
    rig.run_for(PERIOD_S - BEFORE_S - late_ms * 1e-3)
    for seq in range(frame + 1, len(setpoints())):
        send(seq, rig.now_ns)
        rig.run_for(PERIOD_S)
    rows = rig.rows()
    assert np.diff(rows["t_ns"]).max() >= late_ms * 1e6
    assert np.abs(rows["v_ref"][np.argmax(np.diff(rows["t_ns"]))]).max() > 0.3  # it was on its way
    assert np.abs(rows["q_ref"] - rows["q"]).max() < STRAYED
    assert set(rows["fault"].tolist()) == {FaultCode.NONE}
    assert rows["mode"][-1] == Mode.TRACKING


@pytest.mark.parametrize("late_ms", [20, 50])
@pytest.mark.parametrize("after_ms", [10, 40, 80, 120])
def test_a_stop_that_its_servo_sleeps_through_goes_on_where_it_would_have_been(late_ms: int, after_ms: int) -> None:
    """A long cycle would stop short with the speed of its end for all of it, and take the joint for one far ahead."""
    rig, _ = moving_arm()
    rig.mailbox.request_stop()
    rig.run_for(after_ms * 1e-3)
    assert rig.rows()["mode"][-1] == Mode.STOPPING
    sleep_through(rig, late_ms)
    rig.run_for(0.5)
    rows = rig.rows()
    assert np.abs(rows["q_ref"] - rows["q"]).max() < 1.5 * STRAYED  # it brakes meanwhile
    assert rows["mode"][-1] == Mode.HOLDING
    other, _ = moving_arm()
    other.mailbox.request_stop()
    other.run_for(0.5 + 1e-3 * (after_ms + late_ms))
    np.testing.assert_allclose(rows["q_ref"][-1], other.rows()["q_ref"][-1], atol=1e-6)


@pytest.mark.parametrize("late_ms", [70, 80, 90])
def test_frames_that_came_while_their_servo_slept_are_no_lost_stream(late_ms: int) -> None:
    period_s = 0.028
    rig, send = moving_arm(period_s)
    seq, due_ns = MOVING_AFTER, rig.now_ns
    for _ in range(40):
        slept = seq == MOVING_AFTER + 5
        until_ns = rig.now_ns + (late_ms * 1_000_000 if slept else round(period_s * 1e9))
        while due_ns < until_ns:
            send(seq, due_ns)
            seq, due_ns = seq + 1, due_ns + round(period_s * 1e9)
        if slept:
            sleep_through(rig, late_ms)
        else:
            rig.run_for((until_ns - rig.now_ns) * 1e-9)
    rows = rig.rows()
    assert set(rows["fault"].tolist()) == {FaultCode.NONE}
    assert rows["mode"][-1] == Mode.TRACKING


@pytest.mark.parametrize(("late_ms", "draw"), [(20, 5), (30, 18), (40, 3), (40, 4), (60, 14)])
def test_a_joint_that_is_brought_back_to_its_path_is_no_broken_encoder(late_ms: int, draw: int) -> None:
    """Stretches of the campaign `held_up`: the wrist stood under the torque that its late servo made up for."""
    assert told_as(late_ms, draw) in {FaultCode.NONE, FaultCode.STREAM_LOST}
