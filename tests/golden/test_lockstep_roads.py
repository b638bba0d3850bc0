"""The lock-step rig with a bus in between: the same setpoints and the same arm as without one, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import LinkError
from qrobot.faultcodes import FaultCode
from qrobot.hwif.bus import Endpoint
from qrobot.hwif.port.card import serve_card, show_card
from qrobot.hwif.registers import DAC_ZERO
from qrobot.rig.lockstep import LockstepRig, run_blocks
from qrobot.rig.lockstep_road import RoadRig
from qrobot.servo.mailbox import POSITION_SETPOINT
from qrobot.servo.modes import Mode
from qrobot.servo.settings import ServoSettings
from qrobot.servo.telemetry import Rows
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.stepping import SteppingEndpoint
from tests.support.bus import DirectBus
from tests.support.fake_card import FakeCard

ROBOT = load_robot("puma560")
SETTINGS = ServoSettings(rate_hz=1000.0)
FRAME_NS, FRAMES = 28_000_000, 12
STEP = np.array([0.004, 0.006, -0.005, 0.003, 0.002, 0.01])  # rad a frame


def new_emulator() -> Emulator:
    return Emulator(ROBOT, physics="rigid")


def hold(rig: LockstepRig) -> None:
    rig.ticks(3)
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


def test_a_road_changes_no_setpoint_no_word_and_no_motion() -> None:
    direct = fly(LockstepRig(ROBOT, SETTINGS, new_emulator()))
    road = fly(RoadRig(ROBOT, SETTINGS, DirectBus, new_emulator()))
    for field in ("q_ref", "dac", "q", "mode"):
        np.testing.assert_array_equal(road[field], direct[field], field)


class PortRig(LockstepRig):
    """The servo's loop around a fake card, as `servo.loop.run` has it, on virtual time."""

    def __init__(self, emulator: Emulator) -> None:
        super().__init__(ROBOT, SETTINGS, emulator)
        self.end = SteppingEndpoint(emulator, self.substeps, self.now_ns)
        self.card = FakeCard(self.end)

    def ticks(self, n: int) -> None:
        for _ in range(n):
            show_card(self.card.words, self.board, self.now_ns)
            run_blocks(*self._blocks, self.now_ns, 1, 0)
            serve_card(self.card.words, self.board, self.now_ns)
            self.card.settle()
            self.now_ns += self.period_ns
            assert self._kept is not None
            self._kept.append(self._reader.read())


def test_a_card_on_the_bus_changes_no_setpoint_no_word_and_no_motion() -> None:
    direct = fly(LockstepRig(ROBOT, SETTINGS, new_emulator()))
    card = fly(PortRig(new_emulator()))
    for field in ("q_ref", "dac", "q", "mode"):
        np.testing.assert_array_equal(card[field], direct[field], field)


def test_a_card_pulled_in_a_move_faults_the_servo_and_its_return_moves_nothing() -> None:
    rig = PortRig(new_emulator())
    hold(rig)
    for frame in range(FRAMES // 2):
        push(rig, frame)
    rig.card.pulled = True
    rig.run_for(0.01)
    seen = rig.mailbox.snapshot()
    assert (seen.mode, seen.event) == (Mode.FAULT, FaultCode.BOARD_GONE)
    rig.card.pulled = False
    rig.run_for(0.1)
    assert rig.mailbox.snapshot().mode == Mode.FAULT
    assert not rig.emulator.powered
    assert rig.emulator.bundle.board.dac[: ROBOT.n].tolist() == [DAC_ZERO] * ROBOT.n


def test_a_road_cut_in_a_move_stops_the_servo_and_the_board_is_safe_when_it_is_found_again() -> None:
    buses: list[DirectBus] = []

    def build(end: Endpoint) -> DirectBus:
        buses.append(DirectBus(end))
        return buses[0]

    rig = RoadRig(ROBOT, SETTINGS, build, new_emulator())
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
        RoadRig(ROBOT, SETTINGS, cut, new_emulator())
