"""A PUMA 560 whose six drives close their own loop (CiA 402, cyclic synchronous position) under the same servo."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.hwif.bus import Endpoint
from qrobot.hwif.canbus.drives import DrivesBus
from qrobot.hwif.canbus.ds402 import DriveState
from qrobot.hwif.registers import DAC_ZERO
from qrobot.modecodes import Mode
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT, TORQUE_SETPOINT
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.drives import Drives, loops_for, served, torque_for
from tests.support.transport_rig import TransportRig

ROBOT = load_robot("puma560")
SETTINGS = ServoSettings(rate_hz=500.0, position_drives=True)
PERIOD_S = SETTINGS.period_ns * 1e-9
FRAME_NS = 28_000_000
STEP = np.array([0.006, 0.006, -0.006, 0.004, 0.004, 0.006])  # rad a frame once under way: 0.2 rad/s
RISE = np.array([0.1, 0.3, 0.6, 0.9, 1.0, 1.0, 1.0, 1.0, 0.9, 0.6, 0.3, 0.1, 0.0])
FAST_RAD_S = 0.15
OVERCURRENT = 0x2310


class Arm:
    """The arm, powered and held by its drives."""

    def __init__(self, rig: TransportRig, drives: Drives) -> None:
        self.rig, self.drives = rig, drives
        rig.ticks(3)
        rig.mailbox.request_power(True)
        rig.run_for(0.3)
        assert self.mode == Mode.HOLDING

    @property
    def mode(self) -> int:
        return self.rig.mailbox.snapshot().mode

    @property
    def event(self) -> int:
        return self.rig.mailbox.snapshot().event

    @property
    def states(self) -> set[DriveState]:
        return {drive.state for drive in self.drives.far.drives}

    def send(self, shares: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
        """Setpoints from the park position on, a share of STEP further in each frame."""
        q = ROBOT.poses["park"].copy()
        for frame, share in enumerate(shares):
            q += share * STEP
            modes = [POSITION_SETPOINT] * ROBOT.n
            self.rig.mailbox.push_setpoint(1, frame, self.rig.now_ns, FRAME_NS, modes, q.tolist())
            self.rig.run_for(FRAME_NS * 1e-9)

    def get_going(self) -> None:
        self.send(RISE[:7])
        assert np.abs(self.rig.emulator.v).max() > FAST_RAD_S


@contextmanager
def powered() -> Iterator[Arm]:
    with ExitStack() as stack:
        opened: list[Drives] = []

        def open_bus(end: Endpoint) -> DrivesBus:
            opened.append(stack.enter_context(served(end, torque=torque_for(ROBOT), loops=loops_for(ROBOT, PERIOD_S))))
            return opened[0].bus

        rig = TransportRig(ROBOT, SETTINGS, open_bus, Emulator(ROBOT, physics="rigid"))
        yield Arm(rig, opened[0])


@pytest.fixture
def arm() -> Iterator[Arm]:
    with powered() as arm:
        yield arm


def test_the_arm_follows_a_motion_by_the_loops_of_its_drives_and_no_watch_mistakes_them(arm: Arm) -> None:
    arm.send(RISE)
    arm.rig.mailbox.request_stop()
    arm.rig.run_for(0.1)
    assert (arm.event, arm.mode) == (FaultCode.NONE, Mode.HOLDING)
    np.testing.assert_allclose(arm.rig.emulator.q, ROBOT.poses["park"] + RISE.sum() * STEP, atol=2e-3)
    rows = arm.rig.rows()
    moving = rows[rows["mode"] == Mode.TRACKING]
    assert np.abs(moving["q_ref"] - moving["q"]).max() < 0.01
    assert (rows["dac"] == DAC_ZERO).all()
    assert not rows["tau"].any()
    assert arm.rig.board.facts.illegal_ops == 0


def test_a_stop_ends_on_the_path_with_the_drives_in_operation(arm: Arm) -> None:
    arm.get_going()
    arm.rig.mailbox.request_stop()
    arm.rig.run_for(0.3)
    assert arm.mode == Mode.HOLDING
    assert arm.states == {DriveState.ENABLED}
    way = (arm.rig.emulator.q - ROBOT.poses["park"]) / STEP
    np.testing.assert_allclose(way, way.mean(), atol=0.25)  # joints at rest in proportion: on the straight line
    assert np.abs(arm.rig.emulator.v).max() < 0.02


@pytest.mark.parametrize(
    "fail", [lambda drives: drives.far.fail(2, OVERCURRENT), lambda drives: drives.far.lose_sync()]
)
def test_a_drive_that_fails_in_a_move_or_misses_the_sync_takes_the_power_from_all(
    arm: Arm, fail: Callable[[Drives], object]
) -> None:
    arm.get_going()
    fail(arm.drives)
    arm.rig.run_for(0.1)
    assert (arm.event, arm.mode) == (FaultCode.POWER_LOST, Mode.FAULT)
    assert not arm.rig.emulator.powered
    assert DriveState.ENABLED not in arm.states


def test_a_servo_that_falls_silent_leaves_the_drives_to_a_quick_stop(arm: Arm) -> None:
    arm.get_going()
    before = arm.rig.emulator.q.copy()
    for _ in range(60):
        arm.rig.gateway.step(arm.rig.now_ns)
    assert arm.states == {DriveState.QUICK_STOPPED}
    assert arm.rig.emulator.powered  # and the brakes open: the drives have slowed the arm down
    assert np.abs(arm.rig.emulator.v).max() < 0.02
    assert np.abs(arm.rig.emulator.q - before).max() < 0.01
    arm.rig.now_ns = arm.rig.end.now_ns
    arm.rig.run_for(0.1)
    assert arm.mode == Mode.FAULT
    assert not arm.rig.emulator.powered


def test_a_drive_that_does_not_follow_is_a_following_error(arm: Arm) -> None:
    loop = arm.drives.far.drives[0].loop
    assert loop is not None
    loop.gain = loop.damping = 0.0
    arm.send(np.concatenate([RISE[:4], np.ones(12)]))
    assert arm.event == FaultCode.FOLLOWING


def test_a_torque_setpoint_is_refused_however_small(arm: Arm) -> None:
    modes = [TORQUE_SETPOINT, *[POSITION_SETPOINT] * (ROBOT.n - 1)]
    q = [0.0, *ROBOT.poses["park"].tolist()[1:]]
    for frame in range(4):
        arm.rig.mailbox.push_setpoint(1, frame, arm.rig.now_ns, FRAME_NS, modes, q)
        arm.rig.run_for(FRAME_NS * 1e-9)
    assert arm.event == FaultCode.SP_LIMIT
