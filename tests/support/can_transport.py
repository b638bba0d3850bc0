"""The board's CAN node in a thread, on a bus of this process, and what may happen to its wire."""

from __future__ import annotations

import threading
import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Final

import can

from qrobot.hwif.bus import Endpoint
from qrobot.hwif.canbus.client import CanBus
from qrobot.hwif.canbus.node import BoardNode, run_node
from qrobot.hwif.gateway import NO_OPERATIONS
from tests.support.patience import MOMENT_S, PATIENCE_MS, PATIENCE_S, wait_until
from tests.support.virtual_clock import VirtualClock

_END_OF_CUT: Final = can.Message(arbitration_id=0x1FFFFFFF, is_extended_id=True)  # CANopen has none of 29 bits


def end_of_cut(channel: str) -> None:
    """Mark, behind all that was sent on a wire, where its far end hears again: it may not have had its turn so far."""
    with can.Bus(interface="virtual", channel=channel) as interface:
        interface.send(_END_OF_CUT)


def ends_cut(message: can.Message) -> bool:
    """Whether this is that mark."""
    return message.is_extended_id and message.arbitration_id == _END_OF_CUT.arbitration_id


class WeakWire:
    """A CAN interface that can be cut until the mark comes, or spoil the first process data that pass."""

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
        if message is not None and ends_cut(message):
            self.cut = False
            return None
        return None if self.cut else message

    def shutdown(self) -> None:
        self.bus.shutdown()


class CanTransport:
    """Near end, far end and the wire between them."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.channel = uuid.uuid4().hex
        self.wire = WeakWire(self.interface())
        self.clock = VirtualClock()
        self.node = BoardNode(self.wire, endpoint, watchdog_ms=PATIENCE_MS, now_ns=self.clock)  # type: ignore[arg-type]
        self.bus = CanBus("virtual", self.channel, timeout_s=PATIENCE_S)

    def interface(self) -> can.BusABC:
        """Another place on the wire."""
        return can.Bus(interface="virtual", channel=self.channel)

    def hurry(self) -> None:
        self.bus.link.timeout_s = MOMENT_S

    def cut(self) -> None:
        self.wire.cut = True

    def restore(self) -> None:
        self.bus.link.timeout_s = PATIENCE_S
        self.wire.garbage = False
        end_of_cut(self.channel)
        wait_until(lambda: not self.wire.cut, "what was sent before has passed")

    def expire(self) -> None:
        """Let the time of the node's watchdog pass."""
        self.clock.pass_ms(PATIENCE_MS + 1.0)
        wait_until(lambda: self.node.expired, "the watchdog of the far end acts")

    def garbage(self) -> None:
        self.wire.garbage = True


@contextmanager
def can_transport(endpoint: Endpoint) -> Iterator[CanTransport]:
    """A node that serves `endpoint` in a thread until the block ends; the near end is not connected."""
    endpoint.apply(NO_OPERATIONS)  # compile before somebody waits
    transport = CanTransport(endpoint)
    stop = threading.Event()
    booted = transport.interface()
    thread = threading.Thread(target=run_node, args=(transport.node, stop), daemon=True)
    thread.start()
    assert booted.recv(PATIENCE_S) is not None  # its boot-up message
    booted.shutdown()
    try:
        yield transport
    finally:
        transport.wire.cut = False
        transport.bus.close()
        stop.set()
        thread.join(PATIENCE_S)
        transport.wire.shutdown()
        assert not thread.is_alive()


class TransportStack:
    """Opens a transport to any endpoint, as `TransportRig` wants it, and tears it down with the block."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self.transport: CanTransport

    def open(self, endpoint: Endpoint) -> CanBus:
        self.transport = self._stack.enter_context(can_transport(endpoint))
        return self.transport.bus

    def __enter__(self) -> TransportStack:
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()
