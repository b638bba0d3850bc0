"""The board's Modbus server for a rig in lock-step, behind a connection that can be cut."""

from __future__ import annotations

import time
from contextlib import ExitStack

from qrobot.hwif.bus import NO_OPERATIONS, Bus, Endpoint
from qrobot.hwif.modbus.client import ModbusBus, ModbusLine
from qrobot.hwif.modbus.device import ModbusDevice
from qrobot.hwif.modbus.server import ModbusServer
from tests.support.relay import Relay

PATIENCE_S = 0.5


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
