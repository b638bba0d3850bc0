"""The contract of a transport, kept by the one inside a process and by shared memory."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count

import numpy as np
import pytest

from qrobot.arrays import Words
from qrobot.errors import LinkLost
from qrobot.hwif.board_memory import attach_board_memory, create_board_memory
from qrobot.hwif.bus import BoardFacts
from qrobot.hwif.gateway import Gateway
from qrobot.hwif.image import IMAGE_ENC_COUNT, IMAGE_WORDS, make_image
from qrobot.hwif.memory_bus import MemoryBus
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import ENC_LOAD
from tests.contract.bus_contract import BusContract, Transport
from tests.support.bus import BenchEndpoint, DirectBus, nothing, rows_of
from tests.support.patience import MOMENT_S, PATIENCE_S, wait_until
from tests.support.virtual_clock import VirtualClock

STEP_S = 0.0005
ARMS = (f"contract{os.getpid()}n{number}" for number in count())


class DirectTransport:
    """Cut at the near end; garbage is an image with wild words, once."""

    def __init__(self, end: BenchEndpoint) -> None:
        self.bus = DirectBus(end)

    def hurry(self) -> None:
        """It waits for nothing."""

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
    def open_transport(self, end: BenchEndpoint) -> Iterator[Transport]:
        yield DirectTransport(end)


class MemoryTransport:
    """A board process in a thread: a gateway to the bench behind a shared segment, held between two of its steps."""

    def __init__(self, end: BenchEndpoint) -> None:
        self.arm = next(ARMS)
        self.segment = create_board_memory(self.arm)
        self.far = DirectBus(end)
        self.gateway = Gateway(self.far, self.segment.memory, 250_000)
        self.bus = MemoryBus(lambda: attach_board_memory(self.arm), "the bench", timeout_s=PATIENCE_S)
        self._held, self._stop = threading.Event(), threading.Event()
        self._stepping = threading.RLock()
        self.clock = VirtualClock(0)
        assert self.gateway.step(self.clock())
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(STEP_S):
            with self._stepping:
                if not self._held.is_set():
                    self.clock.pass_ms(STEP_S * 1e3)
                    self.gateway.step(self.clock())

    def hurry(self) -> None:
        self.bus.timeout_s = MOMENT_S

    def cut(self) -> None:
        with self._stepping:
            self._held.set()
            self.far.cut = True

    def restore(self) -> None:
        self.bus.timeout_s = PATIENCE_S
        with self._stepping:
            self.far.cut = False
            self._held.clear()
        wait_until(lambda: self.gateway.connected, "the gateway finds the board again")

    def garbage(self) -> None:
        with self._stepping:
            self._held.set()
            wild = np.random.default_rng(1).integers(2**17, 2**62, IMAGE_WORDS)
            self.segment.memory.shown.image[:] = wild

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.segment.close(unlink=True)


class TestMemoryBus(BusContract):
    """Shared memory."""

    @contextmanager
    def open_transport(self, end: BenchEndpoint) -> Iterator[Transport]:
        transport = MemoryTransport(end)
        try:
            yield transport
        finally:
            transport.close()


@pytest.mark.parametrize("lost_before", [False, True])
def test_operations_that_a_gateway_dropped_are_not_done_though_it_found_the_board_again_at_once(
    lost_before: bool,
) -> None:
    end = BenchEndpoint()
    transport = MemoryTransport(end)
    image = make_image()

    def lose_once() -> None:
        end.before = nothing
        raise LinkLost("for a moment")

    connect = transport.far.connect

    def found_once_something_was_dropped() -> BoardFacts:
        if not transport.gateway.dropped:
            raise LinkLost("not yet")
        return connect()

    try:
        transport.bus.connect()
        if lost_before:
            transport.far.connect = found_once_something_was_dropped  # type: ignore[method-assign]
            transport.far.cut = True
            wait_until(lambda: not transport.gateway.connected, "the board is lost")
            transport.far.cut = False
        else:
            end.before = lose_once
        with pytest.raises(LinkLost, match="ask again"):
            transport.bus.exchange(rows_of([(OP_WRITE, ENC_LOAD, 77)]), image)
        transport.bus.exchange(rows_of([(OP_WRITE, ENC_LOAD, 78)]), image)
        assert int(image[IMAGE_ENC_COUNT]) == 78
    finally:
        transport.bus.close()
        transport.close()
