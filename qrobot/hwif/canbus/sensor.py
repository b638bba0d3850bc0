"""A sensor on CAN as channels of the board's converter: the servo samples it as it samples any other channel.

`SensorBus` stands before the bus to the board. It keeps a conversion of one of its channels to itself and answers it,
in the image, with the newest value that came; a value that is too old leaves the conversion undone, so that its channel
reads NaN and a law that needs it stops the arm.
"""

from __future__ import annotations

import time
from typing import Final

import numpy as np

from qrobot.config.can_sensor import CanSensor, CanSignal
from qrobot.errors import LinkError
from qrobot.hwif.bus import BoardFacts, Bus, Operations
from qrobot.hwif.canbus.interface import load_can
from qrobot.hwif.canbus.link import CanLink
from qrobot.hwif.memory import IMAGE_INPUTS, OP_WRITE
from qrobot.hwif.registers import (
    ADC_F_CHANNEL_SHIFT,
    ADC_F_MASK,
    ADC_F_VOLT_PER_COUNT,
    ADC_MUX,
    ADC_VALUE,
    STATUS,
    STATUS_ADC_BUSY,
)
from qrobot.realtime.segment import Words

_HALF_SCALE: Final = 0x8000
NS_PER_MS: Final = 1_000_000


def decode_signal(signal: CanSignal, data: bytes) -> int:
    """The value as an ADC_VALUE word of revision F: 12 bits of +-10 V, left-justified, two's complement.

    Raises:
        LinkError: the frame is too short.
    """
    field = data[signal.first : signal.first + signal.size]
    if len(field) < signal.size:
        raise LinkError(f"frame {signal.id:#x} has {len(data)} bytes: none for channel {signal.channel}")
    count = int.from_bytes(field, "big" if signal.big_endian else "little", signed=signal.signed)
    word = round((count * signal.volt_per_count - signal.zero_v) / ADC_F_VOLT_PER_COUNT)
    return min(max(word, -_HALF_SCALE), _HALF_SCALE - 1) & ADC_F_MASK


class SensorBus:
    """A `Bus` to a board of revision F, with channels that a sensor on CAN serves.

    Attributes:
        malformed: frames of the sensor that were too short.
    """

    def __init__(self, bus: Bus, sensor: CanSensor) -> None:
        self.name = f"{bus.name} with a sensor on CAN {sensor.interface}:{sensor.channel}"
        self.malformed = 0
        self._bus, self._sensor = bus, sensor
        self._link = CanLink(sensor.interface, sensor.channel, sensor.bitrate, ())
        self._channels = {signal.channel for signal in sensor.signals}
        self._newest: dict[int, tuple[int, int]] = {}  # by channel: word, time
        self._converting: int | None = None

    def connect(self) -> BoardFacts:
        """As that of the board's bus. Raises LinkError for a board of revision E, whose converter has no sign."""
        facts = self._bus.connect()
        if facts.revision != "F":
            raise LinkError("a sensor on CAN needs a board of revision F: that of E converts 0 to 5 V with 8 bits")
        self._link.open()
        self._newest.clear()
        self._converting = None
        return facts

    def exchange(self, operations: Operations, image: Words) -> None:
        """See `Bus`."""
        keep = [self._passes(*row) for row in operations.tolist()]
        self._bus.exchange(operations[np.array(keep, bool)], image)
        self._listen(time.monotonic_ns())
        if self._converting is not None:
            self._answer(image, time.monotonic_ns())

    def close(self) -> None:
        """Let go of both."""
        self._bus.close()
        self._link.close()

    def _passes(self, kind: int, offset: int, value: int) -> bool:
        """The operation is for the board; a conversion of a channel of the sensor begins here instead."""
        if kind != OP_WRITE or offset != ADC_MUX:
            return True
        channel = value >> ADC_F_CHANNEL_SHIFT
        self._converting = channel if channel in self._channels else None
        return self._converting is None

    def _listen(self, now_ns: int) -> None:
        for message in self._link.waiting():
            for signal in self._sensor.signals:
                if message.arbitration_id == signal.id:
                    self._take(signal, bytes(message.data), now_ns)

    def _take(self, signal: CanSignal, data: bytes, now_ns: int) -> None:
        try:
            self._newest[signal.channel] = decode_signal(signal, data), now_ns
        except LinkError:
            self.malformed += 1

    def _answer(self, image: Words, now_ns: int) -> None:
        word, t_ns = self._newest.get(self._converting or 0, (0, 0))
        status = IMAGE_INPUTS + STATUS // 2
        if now_ns - t_ns > self._sensor.timeout_ms * NS_PER_MS:
            image[status] |= STATUS_ADC_BUSY
            return
        image[status] &= ~STATUS_ADC_BUSY
        image[IMAGE_INPUTS + ADC_VALUE // 2] = word


def with_sensor(bus: Bus, sensor: CanSensor) -> SensorBus:
    """`bus` with the sensor that a deployment file describes. Raises ConfigError when python-can is not installed."""
    load_can()
    return SensorBus(bus, sensor)
