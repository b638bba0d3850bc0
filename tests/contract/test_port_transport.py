"""The contract of a transport, kept by the ISA port in front of a fake card."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from qrobot.hwif.isa.card import CARD_ILLEGAL, FAKE_WINDOW
from qrobot.hwif.registers import N_INPUT_WORDS
from tests.contract.bus_contract import BusContract, Transport, Traveller
from tests.support.bus import BenchEndpoint
from tests.support.fake_card import FakeCard, FakeCardBus


class PortTransport:
    """A card that can be pulled out of its slot."""

    def __init__(self, end: BenchEndpoint) -> None:
        self.card = FakeCard(end)
        self.bus = FakeCardBus(self.card)

    def hurry(self) -> None:
        """It waits for nothing."""

    def cut(self) -> None:
        self.card.pulled = True

    def restore(self) -> None:
        self.card.pulled = False
        self.card.settle()

    def garbage(self) -> None:
        settle = self.card.settle

        def once() -> object:
            self.card.words[FAKE_WINDOW : FAKE_WINDOW + N_INPUT_WORDS] = 0
            self.card.settle = settle  # type: ignore[method-assign]
            return []

        self.card.settle = once  # type: ignore[method-assign,assignment]


class TestPortBus(BusContract):
    """A read of a card is a read of the board: it has no count of its own and cannot be old."""

    board_counts = False

    @contextmanager
    def open_transport(self, end: BenchEndpoint) -> Iterator[Transport]:
        yield PortTransport(end)

    def illegal(self, there: Traveller) -> int:
        assert isinstance(there.bus, FakeCardBus)
        return int(there.bus.card[CARD_ILLEGAL])
