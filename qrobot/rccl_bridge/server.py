"""The bridge on TCP. It only moves bytes and keeps time; what they mean is the session's business.

One thread, never waiting for a client: what a client does not read is left out (`Session.block`), and what has been
written for it is bounded by the two buffers set here.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import selectors
import signal
import socket
import time
from collections.abc import Callable
from typing import Final, cast

from qrobot.errors import LinkBusy, LinkError
from qrobot.rccl_bridge.actions import Action, carry_out
from qrobot.rccl_bridge.lease import ArmAuthority, Lease
from qrobot.rccl_bridge.port import RobotPort, RobotState
from qrobot.rccl_bridge.session import Peer, Session
from qrobot.rccl_bridge.settings import BridgeSettings
from qrobot.rccl_bridge.throttle import Throttle
from qrobot.wire import Connection, ErrorCode, Side, WireError

LOG: Final = logging.getLogger("qrobot.bridge")
SOCKET_BUFFER_BYTES: Final = 16_384  # a slow reader finds at most this much of the past, doubled by the kernel
WRITE_BUFFER_BYTES: Final = 8_192
LINGER_S: Final = 1.0  # a closed connection that does not drain is cut after this


class BridgeServer:
    """Serves one robot to its clients, inside a running event loop."""

    def __init__(self, port: RobotPort, settings: BridgeSettings, authority: ArmAuthority | None = None) -> None:
        self.port = port
        self.settings = settings
        self.lease = Lease(authority)
        self.clients: set[_Client] = set()
        self._server: asyncio.Server | None = None
        self._messages = Throttle()

    @property
    def address(self) -> tuple[str, int]:
        """Where it listens; the port is the one the system chose when the settings say 0."""
        if self._server is None:
            raise LinkError("the bridge has not been started")
        host, port = self._server.sockets[0].getsockname()[:2]
        return host, port

    async def start(self) -> None:
        """Listen. Raises LinkBusy when the port is taken, LinkError when it cannot be listened on."""
        settings, loop = self.settings, asyncio.get_running_loop()
        try:
            self._server = await loop.create_server(lambda: _Client(self), settings.host, settings.port)
        except OSError as error:
            raise _explain(error, settings) from error

    async def close(self) -> None:
        """Say BYE to everybody, stop the arm if somebody commands it, and stop listening."""
        for client in list(self.clients):
            client.dismiss("the bridge ends")
        if self._server is not None:
            self._server.close()
        while self.clients:
            await asyncio.sleep(LINGER_S / 100)

    def read_state(self) -> RobotState | None:
        """Newest sample of the robot; None while the servo is away."""
        try:
            return self.port.read_state() if self.port.alive() else None
        except LinkError:
            return None

    def say(self, message: str, *values: object) -> None:
        """Log, but never more than a few lines a second."""
        if self._messages.allows(time.monotonic_ns()):
            LOG.info(message, *values)


class _Client(asyncio.Protocol):
    """One socket and its session."""

    def __init__(self, server: BridgeServer) -> None:
        self._server = server
        self.session: Session | None = None
        self.transport: asyncio.Transport | None = None
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Somebody connects: give them a session, or send them away."""
        self.transport = cast(asyncio.Transport, transport)
        peer = Peer(*self.transport.get_extra_info("peername")[:2])
        if len(self._server.clients) >= self._server.settings.max_clients:
            self._turn_away(peer)
            return
        _bound_buffers(self.transport)
        server, port = self._server, self._server.port
        self.session = Session(port.robot_name, port.n, server.lease, server.settings, peer, time.monotonic_ns())
        server.clients.add(self)
        self._set_timer()

    def data_received(self, data: bytes) -> None:
        """Bytes came."""
        if self.session is not None:
            self._carry_out(self.session.receive(data, time.monotonic_ns()))
            self._set_timer()

    def connection_lost(self, exc: Exception | None) -> None:
        """The socket is gone, whoever closed it."""
        self._server.clients.discard(self)
        if self._timer is not None:
            self._timer.cancel()
        if self.session is not None:
            self._carry_out(self.session.lose())
            self._server.say("%s has gone (%s)", self.session.label, exc or "closed")

    def pause_writing(self) -> None:
        """The client does not read."""
        if self.session is not None:
            self.session.block(time.monotonic_ns())

    def resume_writing(self) -> None:
        """The client reads again."""
        if self.session is not None:
            self.session.unblock()

    def dismiss(self, reason: str) -> None:
        """End the session from our side."""
        if self.session is not None:
            self._carry_out(self.session.dismiss(reason, time.monotonic_ns()))

    def _tick(self) -> None:
        if self.session is not None:
            self._carry_out(self.session.tick(time.monotonic_ns(), self._server.read_state()))
            self._set_timer()

    def _set_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if self.session is not None and not self.session.ended:
            self._timer = asyncio.get_running_loop().call_at(self.session.due_ns / 1e9, self._tick)

    def _carry_out(self, actions: list[Action]) -> None:
        outcome = carry_out(actions, self._server.port)
        if self.transport is None or self.transport.is_closing():
            return
        if outcome.data:
            self.transport.write(outcome.data)
        if outcome.closed and self.session is not None:
            self._server.say("%s: %s", self.session.label, outcome.closed)
            self._close()

    def _turn_away(self, peer: Peer) -> None:
        limit = self._server.settings.max_clients
        complaint = WireError(ErrorCode.FULL, f"this bridge serves {limit} clients at most", True, time.monotonic_ns())
        self._server.say("%s is one client too many", peer)
        if self.transport is not None:
            self.transport.write(Connection(Side.SERVER).send(complaint))
            self._close()

    def _close(self) -> None:
        """Say no more, but read on until the client hangs up: to close with unread input would lose the last words."""
        if self.transport is not None:
            self.transport.write_eof()
            asyncio.get_running_loop().call_later(LINGER_S, self.transport.abort)


def _bound_buffers(transport: asyncio.Transport) -> None:
    sock: socket.socket = transport.get_extra_info("socket")
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BUFFER_BYTES)
    transport.set_write_buffer_limits(high=WRITE_BUFFER_BYTES, low=0)


def _explain(error: OSError, settings: BridgeSettings) -> LinkError:
    where = f"{settings.host}:{settings.port}"
    if error.errno == errno.EADDRINUSE:
        return LinkBusy(f"{where} is in use: does another bridge run? Choose another port")
    return LinkError(f"cannot listen on {where}: {error.strerror or error}")


def precise_loop() -> asyncio.AbstractEventLoop:
    """An event loop whose timers are good to some microseconds: epoll would round them up to whole milliseconds."""
    return asyncio.SelectorEventLoop(selectors.SelectSelector())


def run_bridge(
    port: RobotPort,
    settings: BridgeSettings,
    on_ready: Callable[[str, int], None] | None = None,
    authority: ArmAuthority | None = None,
) -> None:
    """Serve until SIGTERM or SIGINT. Raises LinkBusy or LinkError when the address cannot be had.

    Args:
        port: the way to the servo.
        settings: where to listen, and the limits.
        on_ready: called with host and port once clients can connect.
        authority: held while a client commands; see `Lease`.
    """
    with asyncio.Runner(loop_factory=precise_loop) as runner:
        runner.run(_serve(BridgeServer(port, settings, authority), on_ready))


async def _serve(server: BridgeServer, on_ready: Callable[[str, int], None] | None) -> None:
    stop = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    await server.start()
    if on_ready is not None:
        on_ready(*server.address)
    try:
        await stop.wait()
    finally:
        await server.close()
