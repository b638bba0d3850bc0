"""Connections that are opened and closed at full speed, as by a port scan or a program in a loop."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def flood(address: tuple[str, int]) -> Iterator[None]:
    """Inside, somebody opens and closes connections to `address` as fast as one thread can."""
    done = threading.Event()
    visitors = threading.Thread(target=_open_and_close, args=(address, done))
    visitors.start()
    try:
        yield
    finally:
        done.set()
        visitors.join()


def _open_and_close(address: tuple[str, int], done: threading.Event) -> None:
    while not done.is_set():
        with socket.socket() as visitor:
            visitor.setblocking(False)
            visitor.connect_ex(address)
