"""Channels of the board's converter that something else serves: the servo samples them as it samples any other.

Whoever stands before the bus to a board keeps a conversion of such a channel to itself and answers it, in the image,
with the newest value there is. Without one the conversion stays undone, so that the channel reads NaN and a law that
needs it stops the arm.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Final

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import LinkError
from qrobot.hwif.bus import BoardFacts, Operations
from qrobot.hwif.image import IMAGE_ADC_VALUE, IMAGE_STATUS
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import (
    ADC_F_CHANNEL_SHIFT,
    ADC_F_MASK,
    ADC_F_VOLT_PER_COUNT,
    ADC_MUX,
    STATUS_ADC_BUSY,
)

_HALF_SCALE: Final = 0x8000


def adc_word(volt: float) -> int:
    """A voltage as an ADC_VALUE word of revision F: 12 bits of +-10 V, left-justified, two's complement."""
    word = round(volt / ADC_F_VOLT_PER_COUNT)
    return min(max(word, -_HALF_SCALE), _HALF_SCALE - 1) & ADC_F_MASK


def require_signed_converter(facts: BoardFacts) -> None:
    """Raises LinkError for a board of revision E: words of its converter have no sign, and 8 bits."""
    if facts.revision != "F":
        raise LinkError("remote analogue values need a board of revision F: that of E converts 0 to 5 V with 8 bits")


class RemoteChannels:
    """Conversions of channels that are not the board's.

    Args:
        channels: which ones.
        maybe_word: the newest ADC_VALUE word of a channel at a time, None when there is none that may be believed.
    """

    def __init__(self, channels: Collection[int], maybe_word: Callable[[int, int], int | None]) -> None:
        self._channels, self._maybe_word = frozenset(channels), maybe_word
        self._converting: int | None = None

    def forget(self) -> None:
        """No conversion is going on."""
        self._converting = None

    def for_board(self, operations: Operations) -> Operations:
        """Filter the operations for the board: all but the conversions that begin here."""
        keep = [self._passes(*row) for row in operations.tolist()]
        kept: Operations = operations[np.array(keep, bool)]
        return kept

    def _passes(self, kind: int, offset: int, value: int) -> bool:
        if kind != OP_WRITE or offset != ADC_MUX:
            return True
        channel = value >> ADC_F_CHANNEL_SHIFT
        self._converting = channel if channel in self._channels else None
        return self._converting is None

    def answer(self, image: Words, now_ns: int) -> None:
        """Put the result of the conversion that is going on here, if any, into an image."""
        if self._converting is None:
            return
        word, status = self._maybe_word(self._converting, now_ns), IMAGE_STATUS
        if word is None:
            image[status] |= STATUS_ADC_BUSY
            return
        image[status] &= ~STATUS_ADC_BUSY
        image[IMAGE_ADC_VALUE] = word
