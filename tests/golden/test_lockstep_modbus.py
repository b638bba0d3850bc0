"""Servo and emulated arm in lock-step with Modbus TCP in between: identical setpoints, and what a cut does."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest

from qrobot.faultcodes import FaultCode
from qrobot.hwif.bus import NO_OPERATIONS, Bus, Endpoint
from qrobot.hwif.modbus.client import ModbusBus, ModbusLine
from qrobot.hwif.modbus.device import ModbusDevice
from qrobot.hwif.modbus.server import ModbusServer
from qrobot.rig.lockstep import LockstepRig
from qrobot.rig.lockstep_road import RoadRig
from qrobot.servo.modes import Mode
from tests.golden.test_lockstep_roads import FRAMES, ROBOT, SETTINGS, fly, hold, new_emulator, push
from tests.support.relay import Relay

PATIENCE_S = 0.5
WATCHDOG_MS = 50.0
STOP_CYCLES = 10


class Far:
    """The far end of a rig: a server, and a connection to it that can be cut."""

    def __init__(self, stack: ExitStack, watchdog_ms: float) -> None:
        self._stack, self._watchdog_ms = stack, watchdog_ms

    def open_bus(self, end: Endpoint) -> Bus:
        end.apply(NO_OPERATIONS)  # compiles here, not while the near end waits for an answer
        self.device = ModbusDevice(end, watchdog_ms=self._watchdog_ms)
        server = self._stack.enter_context(ModbusServer(self.device))
        self.relay = self._stack.enter_context(Relay(server.address))
        bus = ModbusBus(ModbusLine("127.0.0.1", self.relay.port, timeout_s=PATIENCE_S))
        self._stack.callback(bus.close)
        return bus

    def until_safe(self) -> None:
        deadline = time.monotonic() + 5.0
        while not self.device.trips:
            assert time.monotonic() < deadline, "the watchdog of the far end does not act"
            time.sleep(0.005)


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


def test_modbus_changes_no_setpoint_no_word_and_no_motion(stack: ExitStack) -> None:
    direct = fly(LockstepRig(ROBOT, SETTINGS, new_emulator()))
    far = Far(stack, 0.0)
    road = fly(RoadRig(ROBOT, SETTINGS, far.open_bus, new_emulator()))
    for field in ("q_ref", "dac", "q", "mode"):
        np.testing.assert_array_equal(road[field], direct[field], field)
    assert (far.device.bad, far.device.dropped, far.device.refused) == (0, 0, 0)


def test_a_cut_in_a_move_stops_the_arm_from_both_ends_and_the_servo_goes_on_when_it_is_mended(stack: ExitStack) -> None:
    far = Far(stack, WATCHDOG_MS)
    rig = RoadRig(ROBOT, SETTINGS, far.open_bus, new_emulator())
    hold(rig)
    for frame in range(FRAMES // 2):
        push(rig, frame)
    far.relay.break_now()
    rig.ticks(STOP_CYCLES)
    seen = rig.mailbox.snapshot()
    assert (seen.mode, seen.event) == (Mode.FAULT, FaultCode.BOARD_GONE)
    assert "gave no answer" in rig.lines[-1]
    far.until_safe()
    assert not rig.emulator.powered
    far.relay.cut = False
    rig.run_for(0.4)
    assert rig.gateway.connected
    rig.mailbox.request_power(False)
    rig.mailbox.request_clear()
    rig.run_for(0.1)
    hold(rig)
    assert rig.gateway.losses == far.device.trips == 1
