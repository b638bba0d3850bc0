"""The card as a `Bus`: for the walk through a new board, and whoever else is not the servo.

The servo uses the card from inside its cycle (card.py). Two processes that use one card at the same time disturb each
other's sequences: take the servo away first.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import LinkLost
from qrobot.hwif.bus import BoardFacts, Operations
from qrobot.hwif.image import IMAGE_INPUTS, make_image
from qrobot.hwif.isa.card import CARD_BASE, CARD_KIND, CARD_REVISION, REAL_CARD, apply_all, read_card
from qrobot.hwif.isa.permission import require_ports
from qrobot.hwif.registers import ADC_START, ADC_VALUE, N_ENCODERS, STATUS

_EMPTY_BUS = 0xFFFF
_NO_WHOLE_WORDS = np.array([STATUS + 2, ADC_START, ADC_VALUE]) // 2  # not read, or a byte of revision E


class PortBus:
    """Near end at the card itself.

    Args:
        card: its words, see `card.make_card`.
        joints: encoder channels in use.
        now_ns: stamps the images: a card has no clock of its own.
    """

    def __init__(self, card: Words, joints: int = N_ENCODERS, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.card, self._joints, self._now_ns = card, joints, now_ns
        self._newest = make_image()

    @property
    def name(self) -> str:
        """The card's base."""
        return f"ISA port {int(self.card[CARD_BASE]):#x}"

    def connect(self) -> BoardFacts:
        """Ask for the ports of this thread. Raises ConfigError when refused, LinkLost when no card answers."""
        if self.card[CARD_KIND] == REAL_CARD:
            require_ports(int(self.card[CARD_BASE]))
        self._read()
        return BoardFacts(chr(int(self.card[CARD_REVISION])), self._joints)

    def exchange(self, operations: Operations, image: Words) -> None:
        """Exchange as `Bus.exchange` does. Raises LinkLost when no card answers."""
        apply: Any = apply_all
        apply(self.card, operations)
        self.settle()
        self._read()
        image[:] = self._newest

    def settle(self) -> None:
        """Do what happens between writing and reading: nothing on a card that is there."""

    def _read(self) -> None:
        read: Any = read_card
        read(self.card, self._newest, self._now_ns())
        words = np.delete(self._newest[IMAGE_INPUTS:], _NO_WHOLE_WORDS)
        if np.all(words == words[0]) and words[0] in (0, _EMPTY_BUS):
            raise LinkLost(f"no card answers at {self.name}: every register reads {int(words[0]):#06x}; base, cable?")

    def close(self) -> None:
        """Do nothing: this bus holds no resource."""
