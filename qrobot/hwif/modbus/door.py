"""The door of the Modbus server: who may come in, looked at before anything is made for them.

Connections are accepted a few at a time, and the kernel is asked for the account of each in one message: the event loop
behind the door also answers the controller and runs the watchdog, and anybody on this machine can knock.
"""

from __future__ import annotations

import asyncio
import os
import socket
from collections.abc import Callable, Sequence
from contextlib import suppress
from ipaddress import IPv4Network, IPv6Network, ip_address, ip_network
from typing import Any

from qrobot.errors import ConfigError
from qrobot.realtime.acceptor import Acceptor
from qrobot.realtime.loopback import is_loopback, maybe_peer_account
from qrobot.realtime.socket_diag import is_answered

Allowed = tuple[IPv4Network | IPv6Network, ...]


def networks(host: str, allowed: Sequence[str]) -> Allowed:
    """Networks out of their texts. Raises ConfigError for one that is none, or when a server for all allows nobody."""
    if not is_loopback(host) and not allowed:
        raise ConfigError(
            f"a Modbus server at {host} could be reached by every machine, and whoever reaches it moves the arm: "
            f"name those that may, as in {host}:1502+192.168.1.20, or serve at 127.0.0.1"
        )
    try:
        return tuple(ip_network(text) for text in allowed)
    except ValueError as error:
        raise ConfigError(f"a client of a Modbus server: {error}") from None


class BoardDoor:
    """Listens from the beginning; inside a running event loop.

    Args:
        host, port: where; port 0 takes a free one.
        allowed: other machines that may come in.
        enter: makes the protocol of a connection that is let in.

    Raises:
        OSError: the address cannot be had.
    """

    def __init__(self, host: str, port: int, allowed: Allowed, enter: Callable[[], asyncio.BaseProtocol]) -> None:
        self._allowed, self._enter = allowed, enter
        self._loop = asyncio.get_running_loop()
        self._entering: set[asyncio.Task[Any]] = set()
        is_answered()  # found out before anybody comes
        self._acceptors: list[Acceptor] = []
        try:
            for place in _places(host, port):
                port = self._acceptors[0].address[1] if self._acceptors else port
                self._acceptors.append(Acceptor(_bound(*place, port), self._welcome))
                self._acceptors[-1].open()
        except OSError:
            self._stop_listening()
            raise

    @property
    def address(self) -> tuple[str, int]:
        """Host and port, of several the first."""
        return self._acceptors[0].address

    def _stop_listening(self) -> None:
        for each in self._acceptors:
            each.close()

    def close(self) -> None:
        """Let nobody in any more; who is inside stays."""
        self._stop_listening()
        for task in self._entering:
            task.cancel()

    def admits(self, connection: socket.socket) -> bool:
        """Somebody of this account or of root on this machine, or from an address that was named."""
        try:
            host = ip_address(connection.getpeername()[0])
        except OSError:  # gone again
            return False
        if any(host in network for network in self._allowed):
            return True
        return is_loopback(str(host)) and maybe_peer_account(connection) in (0, os.geteuid())

    def _welcome(self, connection: socket.socket, _far: object) -> None:
        if not self.admits(connection):
            connection.close()
            return
        connection.setblocking(False)
        task = self._loop.create_task(self._let_in(connection))
        self._entering.add(task)
        task.add_done_callback(lambda done: self._entered(done, connection))

    async def _let_in(self, connection: socket.socket) -> None:
        with suppress(OSError):  # gone again
            await self._loop.connect_accepted_socket(self._enter, connection)

    def _entered(self, task: asyncio.Task[Any], connection: socket.socket) -> None:
        self._entering.discard(task)
        if task.cancelled():
            connection.close()


def _places(host: str, port: int) -> list[tuple[int, str]]:
    """Families and addresses of `host`, each once."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    return list(dict.fromkeys((int(family), str(address[0])) for family, _, _, _, address in found))


def _bound(family: int, address: str, port: int) -> socket.socket:
    """A socket at an address; one of IPv6 has none of IPv4, as asyncio's own servers have it."""
    bound = socket.socket(family, socket.SOCK_STREAM)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            bound.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        bound.bind((address, port))
    except OSError:
        bound.close()
        raise
    return bound
