"""Connections accepted a few at a time, so that a crowd never keeps an event loop from its other work."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import Callable
from typing import Any, Final

BURST: Final = 4  # connections accepted in a row: with what each costs, well below the shortest sample period [A]
PAUSE_S: Final = 0.004  # between two bursts: a thousand connections a second, a quarter of a processor [A]
BACKLOG: Final = 128  # connections that wait in the kernel meanwhile

TakeConnection = Callable[[socket.socket, Any], None]


class Acceptor:
    """Takes connections at a bound socket once it is opened; inside a running event loop.

    Args:
        bound: the socket; it is the acceptor's from now on.
        welcome: called with each connection and the address of its far end, as `accept` tells it.
    """

    def __init__(self, bound: socket.socket, welcome: TakeConnection) -> None:
        self._socket, self._welcome = bound, welcome
        self._loop = asyncio.get_running_loop()
        self._pause: asyncio.TimerHandle | None = None
        bound.setblocking(False)

    def open(self) -> None:
        """Listen: until then nobody can connect. Raises OSError."""
        self._socket.listen(BACKLOG)
        self._resume()

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        host, port = self._socket.getsockname()[:2]
        return host, port

    def close(self) -> None:
        """Listen no more."""
        if self._pause is not None:
            self._pause.cancel()
        self._loop.remove_reader(self._socket)
        self._socket.close()

    def _resume(self) -> None:
        self._pause = None
        self._loop.add_reader(self._socket, self._accept)

    def _accept(self) -> None:
        """Accept a few, then leave the rest in the kernel for a while."""
        self._loop.remove_reader(self._socket)
        self._pause = self._loop.call_later(PAUSE_S, self._resume)
        for _ in range(BURST):
            try:
                connection, address = self._socket.accept()
            except OSError:  # no more, or gone again, or too many open files
                return
            self._welcome(connection, address)
