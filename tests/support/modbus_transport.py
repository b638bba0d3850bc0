"""The board's Modbus server for a rig in lock-step, behind a connection that can be cut."""

from __future__ import annotations

from contextlib import ExitStack

from qrobot.hwif.bus import NO_OPERATIONS, Bus, Endpoint
from qrobot.hwif.modbus.client import ModbusBus, ModbusLine
from qrobot.hwif.modbus.device import ModbusDevice
from qrobot.hwif.modbus.server import ModbusServer
from tests.support.patience import MOMENT_S, PATIENCE_S, wait_until
from tests.support.relay import Relay


def set_patience(line: ModbusLine, seconds: float) -> None:
    """Wait so long for an answer from now on."""
    line.timeout_s = line.client.comm_params.timeout_connect = seconds


class Far:
    """The far end of a rig: a server whose clock stands still, and a connection to it that can be cut."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack, self._now_ns = stack, 0

    def open_bus(self, end: Endpoint) -> Bus:
        end.apply(NO_OPERATIONS)  # compiles here, not while the near end waits for an answer
        self.device = ModbusDevice(end, now_ns=lambda: self._now_ns)
        server = self._stack.enter_context(ModbusServer(self.device))
        self.relay = self._stack.enter_context(Relay(server.address))
        self._line = ModbusLine("127.0.0.1", self.relay.port, timeout_s=PATIENCE_S)
        self._stack.callback(self._line.close)
        return ModbusBus(self._line)

    def cut(self) -> None:
        """Break the connection."""
        set_patience(self._line, MOMENT_S)
        self.relay.break_now()

    def mend(self) -> None:
        """Let it through again."""
        set_patience(self._line, PATIENCE_S)
        self.relay.cut = False

    def until_safe(self) -> None:
        """Let the watchdog's time pass."""
        self._now_ns += self.device.watchdog_ns + 1
        wait_until(lambda: self.device.trips, "the watchdog of the far end acts")
