"""A move with CAN between servo and board: the same setpoints, words and motion; and a wire cut in the middle of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.rig.lockstep import LockstepRig
from qrobot.rig.lockstep_road import RoadRig
from qrobot.servo.mailbox import POSITION_SETPOINT
from qrobot.servo.modes import Mode
from qrobot.servo.settings import ServoSettings
from qrobot.servo.telemetry import Rows
from qrobot.sim_board.emulator import Emulator
from tests.support.can_road import RoadStack

ROBOT = load_robot("puma560")
SETTINGS = ServoSettings(rate_hz=500.0)
FRAME_NS, FRAMES = 28_000_000, 10
FAST = np.array([0.02, 0.02, -0.02, 0.01, 0.01, 0.02])  # rad a frame: 0.7 rad/s


def fly(rig: LockstepRig, frames: int = FRAMES) -> Rows:
    rig.ticks(3)
    rig.mailbox.request_power(True)
    rig.run_for(0.3)
    assert rig.mailbox.snapshot().mode == Mode.HOLDING
    for frame in range(frames):
        q: NDArray[np.float64] = ROBOT.poses["park"] + FAST * min(frame, FRAMES - 4) ** 2 / FRAMES
        rig.mailbox.push_setpoint(1, frame, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * ROBOT.n, q.tolist())
        rig.run_for(FRAME_NS * 1e-9)
    return rig.rows()


def test_can_changes_no_setpoint_no_word_and_no_motion() -> None:
    direct = fly(LockstepRig(ROBOT, SETTINGS, Emulator(ROBOT, physics="rigid")))
    with RoadStack() as roads:
        over_can = fly(RoadRig(ROBOT, SETTINGS, roads.open, Emulator(ROBOT, physics="rigid")))
    for field in ("q_ref", "dac", "q", "mode"):
        np.testing.assert_array_equal(over_can[field], direct[field], field)


def test_a_wire_cut_in_a_fast_move_stops_servo_and_board_and_a_mended_one_needs_no_restart() -> None:
    with RoadStack(watchdog_ms=1500.0, timeout_s=0.5) as roads:
        rig = RoadRig(ROBOT, SETTINGS, roads.open, Emulator(ROBOT, physics="rigid"))
        fly(rig, FRAMES // 2)
        assert np.abs(rig.emulator.v).max() > 0.2
        road = roads.road
        road.cut()
        rig.run_for(0.1)
        seen = rig.mailbox.snapshot()
        assert (seen.mode, seen.event) == (Mode.FAULT, FaultCode.BOARD_GONE)
        roads.wait_until(lambda: road.node.expired == 1)  # by its own clock: nobody could tell the board
        assert not rig.emulator.powered
        road.restore()
        rig.run_for(0.3)
        assert rig.gateway.connected
        assert not rig.emulator.powered
        rig.mailbox.request_power(False)
        rig.mailbox.request_clear()
        rig.run_for(0.3)
        rig.mailbox.request_power(True)
        rig.run_for(0.3)
        assert rig.mailbox.snapshot().mode == Mode.HOLDING
        assert rig.emulator.powered
