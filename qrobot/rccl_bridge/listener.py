"""The door of the bridge: its address, and who comes in there; and an event loop that keeps time in microseconds."""

from __future__ import annotations

import asyncio
import errno
import select
import selectors
import socket
from collections.abc import Callable

from qrobot.errors import LinkBusy, LinkError, error_text
from qrobot.rccl_bridge.session import Peer
from qrobot.realtime.acceptor import Acceptor

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
        bound = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        where = f"{host}:{port}" + f" of interface {interface}" * bool(interface)
        try:
            if interface:
                bound.setsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, interface.encode())
            bound.bind((host, port))
        except OSError as error:
            bound.close()
            raise _explain(error, where) from error
        self._acceptor = Acceptor(
            bound, lambda connection, far: welcome(connection, Peer(far[0], far[1], bool(interface)))
        )

    def open(self) -> None:
        """Listen: until then nobody can connect."""
        try:
            self._acceptor.open()
        except OSError as error:
            host, port = self.address
            raise _explain(error, f"{host}:{port}") from error

    @property
    def address(self) -> tuple[str, int]:
        """Host and port."""
        return self._acceptor.address

    def close(self) -> None:
        """Listen no more."""
        self._acceptor.close()


def _explain(error: OSError, where: str) -> LinkError:
    if error.errno == errno.EADDRINUSE:
        return LinkBusy(f"{where} is in use: does another bridge run? Choose another port")
    return LinkError(f"cannot listen on {where}: {error_text(error)}")
