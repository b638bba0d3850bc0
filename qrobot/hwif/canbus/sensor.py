"""A sensor on CAN as channels of the board's converter: the servo samples it as it samples any other channel.

`SensorBus` stands before the bus to the board and answers conversions of its channels (converter.py) with the newest
values that came; one that is too old is none. A sensor whose CAN interface fails has none either, and the board goes
on. Its interface is opened by a thread of its own, because that may take seconds for which neither an exchange can wait
nor a board that has just been found and is to be made safe.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Final

from qrobot.arrays import Words
from qrobot.config.can_sensor import CanSensor, CanSignal
from qrobot.errors import LinkError
from qrobot.hwif.bus import BoardFacts, Bus, Operations
from qrobot.hwif.canbus.interface import load_can
from qrobot.hwif.canbus.link import CanLink
from qrobot.hwif.converter import RemoteChannels, adc_word, require_signed_converter
from qrobot.report import Report
from qrobot.units import NS_PER_MS

RETRY_NS: Final = 200_000_000  # between two attempts to open the interface, as the gateway's to find a board [A]


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


def in_a_thread(work: Callable[[], None], begin: Callable[[], object] = lambda: None) -> None:
    """Do `begin` and `work` in a thread that keeps no process from its end."""

    def run() -> None:
        begin()
        work()

    threading.Thread(target=run, daemon=True).start()


class SensorBus:
    """A `Bus` to a board of revision F, with channels that a sensor on CAN serves.

    Args:
        bus: to the board.
        sensor: where it is and what it sends.
        now_ns: the clock by which a value is too old.
        report: takes a line when the sensor's interface fails, does not open at first, or opens after that.
        aside: does something in a thread of its own.

    Attributes:
        malformed: frames of the sensor that were too short.
        losses: times its interface has failed.
    """

    def __init__(
        self,
        bus: Bus,
        sensor: CanSensor,
        now_ns: Callable[[], int] = time.monotonic_ns,
        report: Report = lambda _line: None,
        aside: Callable[[Callable[[], None]], None] = in_a_thread,
    ) -> None:
        self._where = f"CAN {sensor.interface}:{sensor.channel}"
        self.name = f"{bus.name} with a sensor on {self._where}"
        self.malformed = self.losses = 0
        self._bus, self._sensor, self._now_ns, self._report, self._aside = bus, sensor, now_ns, report, aside
        self._link = CanLink(sensor.interface, sensor.channel, sensor.bitrate, ())
        self._channels = RemoteChannels({signal.channel for signal in sensor.signals}, self._maybe_word)
        self._newest: dict[int, tuple[int, int]] = {}  # by channel: word, time
        self._here = self._told = False
        self._wanted = self._opening = False  # one that opens when it is not wanted any more is let go of
        self._changes = threading.Lock()  # of the two, and of `_here`; nobody opens an interface with it
        self._retry_ns = 0

    def connect(self) -> BoardFacts:
        """Connect the board's bus; the sensor comes when it comes. Raises LinkError for a board of revision E."""
        facts = self._bus.connect()
        require_signed_converter(facts)
        self._newest.clear()
        self._channels.forget()
        self._wanted = True
        self._open_aside(self._now_ns())
        return facts

    def exchange(self, operations: Operations, image: Words) -> None:
        """See `Bus`."""
        self._bus.exchange(self._channels.for_board(operations), image)
        self._listen(self._now_ns())
        self._channels.answer(image, self._now_ns())

    def close(self) -> None:
        """Let go of both; an interface that is being opened is let go of when it is open."""
        self._bus.close()
        with self._changes:
            self._wanted = False
            if not self._opening:
                self._let_go()

    def _listen(self, now_ns: int) -> None:
        if not self._here:
            if now_ns >= self._retry_ns:
                self._open_aside(now_ns)
            return
        try:
            messages = self._link.waiting()
        except LinkError as error:
            self._lose(error, now_ns)
            return
        for message in messages:
            for signal in self._sensor.signals:
                if (message.arbitration_id, message.is_extended_id) == (signal.id, signal.is_extended):
                    self._take(signal, bytes(message.data), now_ns)

    def _open_aside(self, now_ns: int) -> None:
        """Open the interface, unless it is open or being opened."""
        with self._changes:
            if self._here or self._opening:
                return
            self._opening = True
        self._retry_ns = now_ns + RETRY_NS
        self._aside(self._open)

    def _open(self) -> None:
        opened = False
        try:
            opened = self._try_to_open()
        finally:
            self._settle(opened)

    def _settle(self, opened: bool) -> None:
        """Take the interface as open, or close it; until then it counts as being opened, and nobody waits."""
        while self._opening:
            if not (opened and self._wanted):
                self._link.close()
                opened = False
            with self._changes:
                if self._wanted or not opened:
                    self._opening, self._here = False, opened

    def _try_to_open(self) -> bool:
        """Whether the interface opens; one that does not is told of once."""
        try:
            self._link.open()
        except LinkError as error:
            if not self._told:
                self._report(f"no sensor at {self._where}: {error}")
            self._told = True
            return False
        if self._told:
            self._report(f"sensor at {self._where}: the interface is open")
        self._told = False
        return True

    def _lose(self, error: LinkError, now_ns: int) -> None:
        self.losses += 1
        self._newest.clear()
        self._let_go()
        self._told, self._retry_ns = True, now_ns + RETRY_NS
        self._report(f"sensor at {self._where} lost, its channels have no value: {error}")

    def _let_go(self) -> None:
        self._here = False
        self._link.close()

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


def with_sensor(
    bus: Bus, sensor: CanSensor, report: Report = lambda _line: None, begin: Callable[[], object] = lambda: None
) -> SensorBus:
    """`bus` with the sensor that a deployment file describes; `begin` is called first in the thread that opens it.

    Raises:
        ConfigError: python-can is not installed.
    """
    load_can()
    return SensorBus(bus, sensor, report=report, aside=partial(in_a_thread, begin=begin))
