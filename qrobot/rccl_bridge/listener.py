"""The door of the bridge: connections are accepted a few at a time, so that a crowd never keeps it from its clients."""

from __future__ import annotations

import asyncio
import errno
import select
import selectors
import socket
from collections.abc import Callable
from typing import Final

from qrobot.errors import LinkBusy, LinkError, error_text
from qrobot.rccl_bridge.session import Peer

BURST: Final = 4  # connections accepted in a row: with what each costs, well below the shortest sample period [A]
PAUSE_S: Final = 0.004  # between two bursts: a thousand connections a second, a quarter of a processor [A]
BACKLOG: Final = 128  # connections that wait in the kernel meanwhile

AcceptConnection = Callable[[socket.socket, Peer], None]


class PreciseSelector(selectors.EpollSelector):
    """Any number of files, as epoll has it, and timers good to some microseconds, as epoll alone has not.

    Epoll rounds time-outs up to whole milliseconds; select() does not, and need only wait for one file: epoll's own.
    """

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """Files that are ready; waits at most `timeout` seconds, for ever when it is None."""
        if timeout is None or timeout > 0:
            select.select([self.fileno()], [], [], timeout)
        return super().select(0)


def precise_loop() -> asyncio.AbstractEventLoop:
    """An event loop on a `PreciseSelector`."""
    return asyncio.SelectorEventLoop(PreciseSelector())


class Listener:
    """Takes one address, and listens there once it is opened; inside a running event loop.

    Args:
        host, port: where; port 0 takes a free one.
        welcome: called with each connection and its far end.
        interface: the network interface of an isolated link, by which alone anybody comes; "" for no such link.

    Raises:
        LinkBusy: the port is taken. LinkError: it cannot be had. `open` as well.
    """

    def __init__(self, host: str, port: int, welcome: AcceptConnection, interface: str = "") -> None:
        self._welcome = welcome
        self._by_link = bool(interface)
        self._loop = asyncio.get_running_loop()
        self._pause: asyncio.TimerHandle | None = None
        self._socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        where = f"{host}:{port}" + f" of interface {interface}" * self._by_link
        try:
            if interface:
                self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface.encode())
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise _explain(error, where) from error
        self._socket.setblocking(False)

    def open(self) -> None:
        """Listen: until then nobody can connect."""
        try:
            self._socket.listen(BACKLOG)
        except OSError as error:
            host, port = self.address
            raise _explain(error, f"{host}:{port}") from error
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
            self._welcome(connection, Peer(address[0], address[1], self._by_link))


def _explain(error: OSError, where: str) -> LinkError:
    if error.errno == errno.EADDRINUSE:
        return LinkBusy(f"{where} is in use: does another bridge run? Choose another port")
    return LinkError(f"cannot listen on {where}: {error_text(error)}")
