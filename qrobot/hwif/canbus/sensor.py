"""A sensor on CAN as channels of the board's converter: the servo samples it as it samples any other channel.

`SensorBus` stands before the bus to the board and answers conversions of its channels (converter.py) with the newest
values that came; one that is too old is none.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from qrobot.arrays import Words
from qrobot.config.can_sensor import CanSensor, CanSignal
from qrobot.errors import LinkError
from qrobot.hwif.bus import BoardFacts, Bus, Operations
from qrobot.hwif.canbus.interface import load_can
from qrobot.hwif.canbus.link import CanLink
from qrobot.hwif.converter import RemoteChannels, adc_word, require_signed_converter
from qrobot.units import NS_PER_MS


def decode_signal(signal: CanSignal, data: bytes) -> int:
    """The value as an ADC_VALUE word of revision F: 12 bits of +-10 V, left-justified, two's complement.

    Raises:
        LinkError: the frame is too short.
    """
    field = data[signal.first : signal.first + signal.size]
    if len(field) < signal.size:
        raise LinkError(f"frame {signal.id:#x} has {len(data)} bytes: none for channel {signal.channel}")
    count = int.from_bytes(field, "big" if signal.big_endian else "little", signed=signal.signed)
    return adc_word(count * signal.volt_per_count - signal.zero_v)


class SensorBus:
    """A `Bus` to a board of revision F, with channels that a sensor on CAN serves.

    Args:
        bus: to the board.
        sensor: where it is and what it sends.
        now_ns: the clock by which a value is too old.

    Attributes:
        malformed: frames of the sensor that were too short.
    """

    def __init__(self, bus: Bus, sensor: CanSensor, now_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self.name = f"{bus.name} with a sensor on CAN {sensor.interface}:{sensor.channel}"
        self.malformed = 0
        self._bus, self._sensor, self._now_ns = bus, sensor, now_ns
        self._link = CanLink(sensor.interface, sensor.channel, sensor.bitrate, ())
        self._channels = RemoteChannels({signal.channel for signal in sensor.signals}, self._maybe_word)
        self._newest: dict[int, tuple[int, int]] = {}  # by channel: word, time

    def connect(self) -> BoardFacts:
        """Connect the board's bus and the sensor. Raises LinkError for a board of revision E."""
        facts = self._bus.connect()
        require_signed_converter(facts)
        self._link.open()
        self._newest.clear()
        self._channels.forget()
        return facts

    def exchange(self, operations: Operations, image: Words) -> None:
        """See `Bus`."""
        self._bus.exchange(self._channels.for_board(operations), image)
        self._listen(self._now_ns())
        self._channels.answer(image, self._now_ns())

    def close(self) -> None:
        """Let go of both."""
        self._bus.close()
        self._link.close()

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

    def _maybe_word(self, channel: int, now_ns: int) -> int | None:
        if (heard := self._newest.get(channel)) is None:
            return None
        word, t_ns = heard
        return word if now_ns - t_ns <= self._sensor.timeout_ms * NS_PER_MS else None


def with_sensor(bus: Bus, sensor: CanSensor) -> SensorBus:
    """`bus` with the sensor that a deployment file describes. Raises ConfigError when python-can is not installed."""
    load_can()
    return SensorBus(bus, sensor)
