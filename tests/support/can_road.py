"""The board's CAN node in a thread, on a bus of this process, and what may happen to its wire."""

from __future__ import annotations

import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

import can

from qrobot.hwif.bus import Endpoint
from qrobot.hwif.canbus.client import CanBus
from qrobot.hwif.canbus.node import BoardNode, run_node
from qrobot.hwif.gateway import NO_OPERATIONS

PATIENCE_S = 10.0
PATIENCE_MS = 5000.0  # no watchdog while a test waits for something else


class WeakWire:
    """A CAN interface that can be cut, or spoil the first process data that pass."""

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self.cut = self.garbage = False

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        if self.cut:
            return
        if self.garbage and message.arbitration_id & 0x780 == 0x180:
            self.garbage = False
            message = can.Message(arbitration_id=message.arbitration_id, data=b"\xff\xfe\xfd", is_extended_id=False)
        self.bus.send(message, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        message = self.bus.recv(timeout)
        return None if self.cut else message

    def shutdown(self) -> None:
        self.bus.shutdown()


class CanRoad:
    """Near end, far end and the wire between them."""

    def __init__(self, endpoint: Endpoint, watchdog_ms: float, timeout_s: float) -> None:
        self.channel = uuid.uuid4().hex
        self.wire = WeakWire(self.interface())
        self.lines: list[str] = []
        self.node = BoardNode(self.wire, endpoint, watchdog_ms=watchdog_ms, report=self.lines.append)  # type: ignore[arg-type]
        self.bus = CanBus("virtual", self.channel, timeout_s=timeout_s)

    def interface(self) -> can.BusABC:
        """Another place on the wire."""
        return can.Bus(interface="virtual", channel=self.channel)

    def cut(self) -> None:
        self.wire.cut = True

    def restore(self) -> None:
        self.wire.cut = False

    def garbage(self) -> None:
        self.wire.garbage = True


@contextmanager
def can_road(endpoint: Endpoint, watchdog_ms: float = PATIENCE_MS, timeout_s: float = 0.2) -> Iterator[CanRoad]:
    """A node that serves `endpoint` in a thread until the block ends; the near end is not connected."""
    endpoint.apply(NO_OPERATIONS)  # compile before somebody waits
    road = CanRoad(endpoint, watchdog_ms, timeout_s)
    stop = threading.Event()
    booted = road.interface()
    thread = threading.Thread(target=run_node, args=(road.node, stop), daemon=True)
    thread.start()
    assert booted.recv(60.0) is not None  # its boot-up message
    booted.shutdown()
    try:
        yield road
    finally:
        road.restore()
        road.bus.close()
        stop.set()
        thread.join(10.0)
        road.wire.shutdown()
        assert not thread.is_alive()


class RoadStack:
    """Opens a road to any endpoint, as `RoadRig` wants it, and tears it down with the block."""

    def __init__(self, watchdog_ms: float = 0.0, timeout_s: float = 5.0) -> None:
        self._options = watchdog_ms, timeout_s
        self._stack = ExitStack()
        self.road: CanRoad

    def open(self, endpoint: Endpoint) -> CanBus:
        self.road = self._stack.enter_context(can_road(endpoint, *self._options))
        return self.road.bus

    def wait_until(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline
            time.sleep(0.001)

    def __enter__(self) -> RoadStack:
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()
