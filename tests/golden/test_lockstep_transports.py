"""The lock-step rig with a bus in between: the same setpoints and the same arm as without one, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import LinkError
from qrobot.faultcodes import FaultCode
from qrobot.hwif.bus import Endpoint
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.bus import DirectBus
from tests.support.transport_rig import TransportRig

ROBOT = load_robot("puma560")
SETTINGS = ServoSettings(rate_hz=1000.0)
FRAME_NS, FRAMES = 28_000_000, 12
STEP = np.array([0.004, 0.006, -0.005, 0.003, 0.002, 0.01])  # rad a frame


def new_emulator() -> Emulator:
    return Emulator(ROBOT, physics="rigid")


def hold(rig: LockstepRig) -> None:
    rig.run_for(1.0)  # the potentiometers are heard, which takes longer by a transport
    rig.mailbox.request_power(True)
    rig.run_for(0.3)
    assert rig.mailbox.snapshot().mode == Mode.HOLDING


def push(rig: LockstepRig, frame: int) -> None:
    q = ROBOT.poses["park"] + STEP * min(frame, FRAMES - 4)
    rig.mailbox.push_setpoint(1, frame, rig.now_ns, FRAME_NS, [POSITION_SETPOINT] * ROBOT.n, q.tolist())
    rig.run_for(FRAME_NS * 1e-9)


def fly(rig: LockstepRig) -> Rows:
    hold(rig)
    for frame in range(FRAMES):
        push(rig, frame)
    assert rig.mailbox.snapshot().event == 0
    return rig.rows()


def test_a_transport_changes_no_setpoint_no_word_and_no_motion() -> None:
    direct = fly(LockstepRig(ROBOT, SETTINGS, new_emulator()))
    transport = fly(TransportRig(ROBOT, SETTINGS, DirectBus, new_emulator()))
    for field in ("q_ref", "dac", "q", "mode"):
        np.testing.assert_array_equal(transport[field], direct[field], field)


def test_a_transport_cut_in_a_move_stops_the_servo_and_the_board_is_safe_when_it_is_found_again() -> None:
    buses: list[DirectBus] = []

    def build(end: Endpoint) -> DirectBus:
        buses.append(DirectBus(end))
        return buses[0]

    rig = TransportRig(ROBOT, SETTINGS, build, new_emulator())
    hold(rig)
    for frame in range(FRAMES // 2):
        push(rig, frame)
    buses[0].cut = True
    rig.run_for(0.3)
    seen = rig.mailbox.snapshot()
    assert (seen.mode, seen.event) == (Mode.FAULT, FaultCode.BOARD_GONE)
    assert rig.emulator.powered  # nobody could tell the board
    buses[0].cut = False
    rig.run_for(0.4)
    assert not rig.emulator.powered
    assert rig.gateway.losses == 1


def test_a_rig_without_a_board_at_the_far_end_says_why() -> None:
    def cut(end: Endpoint) -> DirectBus:
        bus = DirectBus(end)
        bus.cut = True
        return bus

    with pytest.raises(LinkError, match="the wire is cut"):
        TransportRig(ROBOT, SETTINGS, cut, new_emulator())
