"""The contract of a transport, kept by Modbus TCP over a loopback connection that can be cut and garbled."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from qrobot.hwif.modbus.client import ModbusBus, ModbusLine
from qrobot.hwif.modbus.device import ModbusDevice
from qrobot.hwif.modbus.server import ModbusServer
from tests.contract.bus_contract import BusContract, Transport
from tests.support.bus import BenchEndpoint, rows_of
from tests.support.modbus_transport import set_patience
from tests.support.patience import MOMENT_S, PATIENCE_S
from tests.support.relay import Relay, as_it_came
from tests.support.virtual_clock import VirtualClock

HEAD = 7


class ModbusTransport:
    """Cut in the middle; garbage is an answer whose length is right and whose meaning is not, once."""

    def __init__(self, relay: Relay) -> None:
        self._relay = relay
        self._line = ModbusLine("127.0.0.1", relay.port, timeout_s=PATIENCE_S)
        self.bus = ModbusBus(self._line)

    def hurry(self) -> None:
        set_patience(self._line, MOMENT_S)

    def cut(self) -> None:
        self._relay.break_now()

    def restore(self) -> None:
        set_patience(self._line, PATIENCE_S)
        self._relay.spoil = as_it_came
        self._relay.cut = False

    def garbage(self) -> None:
        def spoil(data: bytes) -> bytes:
            self._relay.spoil = as_it_came
            return data[:HEAD] + bytes(b ^ 0x5A for b in data[HEAD:])

        self._relay.spoil = spoil


class TestModbus(BusContract):
    """Modbus TCP."""

    @contextmanager
    def open_transport(self, end: BenchEndpoint) -> Iterator[Transport]:
        end.apply(rows_of(()))  # compiles here, not while the near end waits for an answer
        with (
            ModbusServer(ModbusDevice(end, watchdog_ms=0, now_ns=VirtualClock())) as server,
            Relay(server.address) as relay,
        ):
            yield ModbusTransport(relay)
