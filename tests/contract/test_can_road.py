"""The contract of every road, over CAN."""

from __future__ import annotations

from contextlib import AbstractContextManager

from tests.contract.bus_contract import BusContract
from tests.support.bus import BenchEndpoint
from tests.support.can_road import CanRoad, can_road


class TestCan(BusContract):
    def open_road(self, end: BenchEndpoint) -> AbstractContextManager[CanRoad]:
        return can_road(end)
