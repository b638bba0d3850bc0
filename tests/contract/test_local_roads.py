"""The contract of a road, kept by the one inside a process and by shared memory."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

import numpy as np
import pytest

from qrobot.hwif.bus import make_image
from qrobot.hwif.gateway import Gateway
from qrobot.hwif.memory import IMAGE_START, IMAGE_WORDS, OP_WRITE, attach_board_memory, create_board_memory
from qrobot.hwif.memory_bus import MemoryBus
from qrobot.hwif.registers import DISCRETE
from qrobot.realtime.segment import Words
from tests.contract.bus_contract import BusContract, Road
from tests.support.bus import BenchEndpoint, DirectBus, rows_of

STEP_S = 0.0005
ARMS = (f"contract{number}" for number in count())


class DirectRoad:
    """Cut at the near end; garbage is an image with wild words, once."""

    def __init__(self, end: BenchEndpoint) -> None:
        self.bus = DirectBus(end)

    def cut(self) -> None:
        self.bus.cut = True

    def restore(self) -> None:
        self.bus.cut = False

    def garbage(self) -> None:
        def spoil(image: Words) -> None:
            image[:] = np.random.default_rng(1).integers(-(2**62), 2**62, image.size)
            self.bus.spoil = lambda _image: None

        self.bus.spoil = spoil


class TestDirectBus(BusContract):
    """Inside one process."""

    @contextmanager
    def open_road(self, end: BenchEndpoint) -> Iterator[Road]:
        yield DirectRoad(end)


class MemoryRoad:
    """A board process in a thread: a gateway to the bench behind a shared segment."""

    def __init__(self, end: BenchEndpoint, timeout_s: float = 0.25) -> None:
        self.arm = next(ARMS)
        self.segment = create_board_memory(self.arm)
        self.far = DirectBus(end)
        self.gateway = Gateway(self.far, self.segment.words, 250_000)
        self.bus = MemoryBus(lambda: attach_board_memory(self.arm), "the bench", timeout_s=timeout_s)
        self._held, self._stop = threading.Event(), threading.Event()
        assert self.gateway.step(0)
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(STEP_S):
            if not self._held.is_set():
                self.gateway.step(time.monotonic_ns())

    def cut(self) -> None:
        self._held.set()
        self.far.cut = True

    def restore(self) -> None:
        self.far.cut = False
        self._held.clear()
        while not self.gateway.connected:
            time.sleep(STEP_S)

    def garbage(self) -> None:
        self._held.set()
        wild = np.random.default_rng(1).integers(2**17, 2**62, IMAGE_WORDS)
        self.segment.words[IMAGE_START : IMAGE_START + IMAGE_WORDS] = wild

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.segment.close(unlink=True)


@pytest.fixture(scope="module")
def compiled() -> None:
    """What an exchange calls: to compile it takes longer than any patience."""
    road = MemoryRoad(BenchEndpoint(), timeout_s=300.0)
    road.bus.connect()
    road.bus.exchange(rows_of([(OP_WRITE, DISCRETE, 0)]), make_image())
    road.bus.close()
    road.close()


@pytest.mark.usefixtures("compiled")
class TestMemoryBus(BusContract):
    """Shared memory."""

    @contextmanager
    def open_road(self, end: BenchEndpoint) -> Iterator[Road]:
        road = MemoryRoad(end)
        try:
            yield road
        finally:
            road.close()
