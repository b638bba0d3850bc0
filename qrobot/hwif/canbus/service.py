"""Meaning of SDO reads and writes of the board's node: registers as they are, and as CiA 401 scales them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from canopen.sdo.exceptions import SdoAbortedError

from qrobot.errors import LinkError
from qrobot.hwif.bus import Endpoint, Operations
from qrobot.hwif.canbus.objects import (
    ANALOG_IN,
    ANALOG_OUT,
    DIGITAL_IN,
    DIGITAL_OUT,
    FACTS_OBJECT,
    REGISTER_OBJECT,
)
from qrobot.hwif.image import input_at, make_image
from qrobot.hwif.operations import OP_READ, OP_WRITE
from qrobot.hwif.registers import (
    ADC_E_VOLT_PER_COUNT,
    ADC_F_MASK,
    ADC_START,
    ADC_VALUE,
    DAC,
    DAC_MASK,
    DAC_ZERO,
    DISCRETE,
    STATUS,
    WINDOW_BYTES,
    Access,
    register_at,
)

NOT_NOW: Final = 0x08000022  # "because of the present device state" (CiA 301, table 22)
HARDWARE: Final = 0x06060000  # "access failed due to a hardware error"
ANALOG_PER_VOLT: Final = 3276.8  # left-justified 16 bits over +-10 V (CiA 401, 6.4.6)
_DAC_SHIFT: Final = 4  # twelve of those bits


def dac_word(value: int) -> int:
    """DAC word of an analogue output of CiA 401: 0x800 - value / 16, as far as twelve bits go."""
    return min(max(DAC_ZERO - (value >> _DAC_SHIFT), 0), DAC_MASK)


def analog_value(word: int, revision: str) -> int:
    """Analogue input of CiA 401, signed, from an ADC_VALUE word of a board of `revision`."""
    if revision == "E":
        return round((word & 0xFF) * ADC_E_VOLT_PER_COUNT * ANALOG_PER_VOLT)
    left = word & ADC_F_MASK
    return left - ((left & 0x8000) << 1)


class RegisterService:
    """Answers reads and writes of objects; for `LocalNode.add_read_callback` and `add_write_callback` of canopen.

    Args:
        endpoint: the board.
        apply: takes operations to the board.
        operates: the node is OPERATIONAL, and may write.
    """

    def __init__(self, endpoint: Endpoint, apply: Callable[[Operations], None], operates: Callable[[], bool]) -> None:
        self._endpoint, self._apply, self._operates = endpoint, apply, operates
        self._image = make_image()

    def read(self, *, index: int, subindex: int, **_rest: Any) -> int | None:
        """Value of an object of the board; None for another object. Raises SdoAbortedError when the board fails."""
        if not subindex:
            return None
        try:
            return self._read(index, subindex)
        except LinkError:
            raise SdoAbortedError(HARDWARE) from None

    def write(self, *, index: int, subindex: int, data: bytes, **_rest: Any) -> None:
        """Write a register. Raises SdoAbortedError when the node does not operate or the board fails."""
        target = self._target(index, subindex, int.from_bytes(data[:2], "little", signed=index == ANALOG_OUT))
        if target is None:
            return
        try:
            self._act(OP_WRITE, *target)
        except LinkError:
            raise SdoAbortedError(HARDWARE) from None

    def _read(self, index: int, subindex: int) -> int | None:
        if index == FACTS_OBJECT:
            facts = self._endpoint.facts()
            return (ord(facts.revision), facts.joints, facts.period_ns)[subindex - 1]
        if index == DIGITAL_IN:
            return self._word(STATUS)
        if index == ANALOG_IN:
            return analog_value(self._word(ADC_VALUE), self._endpoint.facts().revision)
        if index - REGISTER_OBJECT == ADC_START:
            self._act(OP_READ, ADC_START, 0)
        if 0 <= index - REGISTER_OBJECT < WINDOW_BYTES // 2:
            return self._word(index - REGISTER_OBJECT + 2 * (subindex - 1))
        return None

    def _word(self, offset: int) -> int:
        self._endpoint.read_image(self._image)
        return int(self._image[input_at(offset)]) & 0xFFFF

    def _target(self, index: int, subindex: int, value: int) -> tuple[int, int] | None:
        """Register and word that a written object means; None when it is no output."""
        offset = index - REGISTER_OBJECT
        if index == DIGITAL_OUT:
            return DISCRETE, value
        if index == ANALOG_OUT:
            return DAC + 2 * (subindex - 1), dac_word(value)
        if 0 <= offset < WINDOW_BYTES and register_at(offset).access is Access.WRITE:
            return offset + 2 * (subindex - 1), value
        return None

    def _act(self, kind: int, offset: int, value: int) -> None:
        if not self._operates():
            raise SdoAbortedError(NOT_NOW)
        self._apply(np.array([[kind, offset, value]], np.int64))
