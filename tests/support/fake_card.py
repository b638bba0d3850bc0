"""A fake ISA card (`qrobot/hwif/isa/card.py`), answered by any endpoint in lock-step."""

from __future__ import annotations

import numpy as np

from qrobot.errors import LinkError
from qrobot.hwif.bus import Endpoint
from qrobot.hwif.image import IMAGE_INPUTS, IMAGE_T_NS, make_image
from qrobot.hwif.isa.bus import PortBus
from qrobot.hwif.isa.card import (
    CARD_READ_ONLY,
    FAKE_CARD,
    FAKE_HEAD,
    FAKE_RECORD,
    FAKE_WINDOW,
    RECORD_CAPACITY,
    RECORD_FIELDS,
    make_card,
)
from qrobot.hwif.operations import OP_FIELDS, OP_READ, OP_WRITE
from qrobot.hwif.registers import ADC_START, N_INPUT_WORDS

PortAccess = tuple[int, int, int, int]  # OP_READ or OP_WRITE, offset, bits, value


class FakeCard:
    """A window and a record in front of an endpoint.

    Args:
        end: the board; it moves on at each `settle`.
        read_only: nothing is written.

    Attributes:
        words: the card, for compiled code.
        pulled: the card is out of its slot.
        t_ns: time of what the window shows, by the board's clock.
    """

    def __init__(self, end: Endpoint, read_only: bool = False) -> None:
        self.end = end
        self.words = make_card(FAKE_CARD, revision=end.facts().revision)
        self.words[CARD_READ_ONLY] = read_only
        self.pulled = False
        self.t_ns = 0
        self._seen = 0
        self._show()

    def taken(self) -> list[PortAccess]:
        """Every access since the last call, of those the newest RECORD_CAPACITY."""
        head = int(self.words[FAKE_HEAD])
        self._seen = max(self._seen, head - RECORD_CAPACITY)
        slots = [FAKE_RECORD + i % RECORD_CAPACITY * RECORD_FIELDS for i in range(self._seen, head)]
        self._seen = head
        return [tuple(int(word) for word in self.words[slot : slot + RECORD_FIELDS]) for slot in slots]  # type: ignore[misc]

    def settle(self) -> list[PortAccess]:
        """Let the board see what was done, and show what it says; returns every access."""
        accesses = self.taken()
        acting = [a for a in accesses if a[0] == OP_WRITE or a[1] == ADC_START]
        if not self.pulled:
            rows = [(kind, offset, 0 if kind == OP_READ else value) for kind, offset, _, value in acting]
            self.end.apply(np.array(rows, np.int64).reshape(-1, OP_FIELDS))
        self._show()
        return accesses

    def _show(self) -> None:
        window = self.words[FAKE_WINDOW : FAKE_WINDOW + N_INPUT_WORDS]
        if self.pulled:
            window[:] = 0xFFFF
            return
        image = make_image()
        self.end.read_image(image)
        window[:] = image[IMAGE_INPUTS:]
        self.t_ns = int(image[IMAGE_T_NS])


class FakeCardBus(PortBus):
    """The bus of the card, with the board answering between writing and reading; its clock is the board's."""

    def __init__(self, fake: FakeCard) -> None:
        super().__init__(fake.words, now_ns=lambda: fake.t_ns)
        self.fake = fake

    def settle(self) -> None:
        """What was written reaches the board, and what it says stands in the window."""
        try:
            self.fake.settle()
        except LinkError:  # the board is gone: an empty bus
            self.fake.words[FAKE_WINDOW : FAKE_WINDOW + N_INPUT_WORDS] = 0xFFFF
