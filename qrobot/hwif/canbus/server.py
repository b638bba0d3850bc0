"""A board served as a CAN node by a thread of this process."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import can

from qrobot.errors import ConfigError
from qrobot.hwif.bus import Endpoint
from qrobot.hwif.canbus.interface import open_interface
from qrobot.hwif.canbus.node import WATCHDOG_MS, BoardNode, run_node


def split_address(address: str) -> tuple[str, str, int]:
    """Interface, channel and node of `INTERFACE:CHANNEL` or `INTERFACE:CHANNEL@NODE`. Raises ConfigError."""
    where, _, node = address.partition("@")
    interface, _, channel = where.partition(":")
    if not channel or (node and not node.isdecimal()):
        raise ConfigError(f"CAN address {address!r}: give INTERFACE:CHANNEL or INTERFACE:CHANNEL@NODE")
    return interface, channel, int(node or 1)


@contextmanager
def can_server(
    address: str,
    endpoint: Endpoint,
    report: Callable[[str], None],
    watchdog_ms: float = WATCHDOG_MS,
    now_ns: Callable[[], int] = time.monotonic_ns,
) -> Iterator[BoardNode]:
    """Serve `endpoint` as a node while the block runs.

    Raises:
        ConfigError: the address is none, or its node has no number the board's may have.
        LinkError: the interface does not open.
    """
    interface, channel, node_id = split_address(address)
    bus = open_interface(interface, channel)
    stop = threading.Event()
    try:
        node = BoardNode(bus, endpoint, node_id, watchdog_ms, report, now_ns)
        thread = threading.Thread(target=_serve, args=(node, stop, report), name=f"can-node-{node_id}", daemon=True)
        thread.start()
        try:
            yield node
        finally:
            stop.set()
            thread.join()
    finally:
        bus.shutdown()


def _serve(node: BoardNode, stop: threading.Event, report: Callable[[str], None]) -> None:
    try:
        run_node(node, stop)
    except can.CanError as error:
        report(f"CAN node {node.node_id} has ended: {error}")
