"""The contract of every transport, over CAN."""

from __future__ import annotations

from contextlib import AbstractContextManager

from tests.contract.bus_contract import BusContract
from tests.support.bus import BenchEndpoint
from tests.support.can_transport import CanTransport, can_transport


class TestCan(BusContract):
    def open_transport(self, end: BenchEndpoint) -> AbstractContextManager[CanTransport]:
        return can_transport(end)
