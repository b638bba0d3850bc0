"""The bridge on TCP. It only moves bytes and keeps time; what they mean is the session's business.

One thread, never waiting for a client: what a client does not read is left out (`Session.block`), and what has been
written for it is bounded by the two buffers set here. Whoever does not greet gives way to whoever comes after, so that
no crowd at the door keeps a program out; those who have been sent away are waited for in small numbers only.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from typing import Final, cast

from qrobot.errors import LinkError
from qrobot.rccl_bridge.actions import Action, carry_out
from qrobot.rccl_bridge.arm_time import read_arm_time_ns
from qrobot.rccl_bridge.lease import ArmAuthority, Lease
from qrobot.rccl_bridge.listener import Listener, precise_loop
from qrobot.rccl_bridge.places import Places
from qrobot.rccl_bridge.rate_limit import RateLimit
from qrobot.rccl_bridge.servo_interface import RobotPort, RobotState
from qrobot.rccl_bridge.session import Peer, Session
from qrobot.rccl_bridge.settings import BridgeSettings
from qrobot.realtime.bridge_token import offered_token
from qrobot.realtime.signals import ending_signals
from qrobot.wire import ErrorCode

LOG: Final = logging.getLogger("qrobot.rccl_bridge")
SOCKET_BUFFER_BYTES: Final = 16_384  # a slow reader finds at most this much of the past, doubled by the kernel
WRITE_BUFFER_BYTES: Final = 8_192
OVERSLEPT_S: Final = 0.02  # a timer that fires later found this process stopped [A]
LOOK_S: Final = 0.002
PATIENCE_S: Final = 0.2  # with an emulated arm that wakes up after we did [A]
MOST_UNWANTED: Final = 1 << 16  # [A] bytes of a client that was sent away, before it is cut: they cost time
LINGER_S: Final = 1.0  # a closed connection that does not drain is cut after this
MAX_LINGERING: Final = 32  # closed connections that are waited for


class BridgeServer:
    """Serves one robot to its clients, inside a running event loop.

    Attributes:
        token: what clients have to show; empty asks for none.
    """

    def __init__(self, port: RobotPort, settings: BridgeSettings, authority: ArmAuthority | None = None) -> None:
        self.port = port
        self.settings = settings
        self.lease = Lease(authority)
        self.places = Places(settings.max_clients)
        self.token = b""
        self.clients: dict[_Client, None] = {}  # in the order in which they came
        self._listener: Listener | None = None
        self._link_listener: Listener | None = None
        self._messages = RateLimit()

    @property
    def address(self) -> tuple[str, int]:
        """Address that is listened at; the port is the one the system chose when the settings say 0."""
        if self._listener is None:
            raise LinkError("the bridge has not been started")
        return self._listener.address

    def take_address(self) -> Listener:
        """Take the port; nobody can connect yet. Raises LinkBusy when it is taken, LinkError when it cannot be had."""
        if self._listener is None:
            self._listener = Listener(self.settings.host, self.settings.port, self._welcome)
            if (link := self.settings.link) is not None:
                self._link_listener = Listener(link.address, self.address[1], self._welcome, link.interface)
        return self._listener

    async def start(self) -> None:
        """Listen. Raises what `take_address` raises."""
        self.take_address().open()
        if self._link_listener is not None:
            self._link_listener.open()

    async def close(self) -> None:
        """Say BYE to everybody, stop the arm if somebody commands it, and stop listening."""
        for client in list(self.clients):
            client.dismiss("the bridge ends")
        for listener in (self._listener, self._link_listener):
            if listener is not None:
                listener.close()
        while self.clients:
            await asyncio.sleep(LINGER_S / 100)

    def read_state(self) -> RobotState | None:
        """Newest sample of the robot; None while the servo is away."""
        try:
            return self.port.read_state() if self.port.alive() else None
        except LinkError:
            return None

    def now_ns(self) -> int:
        """The arm's time, see `read_arm_time_ns`."""
        return read_arm_time_ns(self.port.slipped_ns)

    def say(self, message: str, *values: object) -> None:
        """Log, but never more than a few lines a second."""
        if self._messages.allows(time.monotonic_ns()):
            LOG.info(message, *values)

    def _welcome(self, connection: socket.socket, peer: Peer) -> None:
        """Somebody connects: make room for them, and give them a session."""
        self._make_room()
        client = _Client(self, peer)
        self.clients[client] = None
        connection.setblocking(False)
        asyncio.get_running_loop().create_task(client.take_over(connection))

    def _make_room(self) -> None:
        """Send one of too many away who have not greeted: the first to come of the address that most of them have."""
        greeting = [client for client in self.clients if not client.session.greeted and not client.session.ended]
        if len(greeting) >= self.settings.max_greeting:
            host, _ = Counter(client.peer.host for client in greeting).most_common(1)[0]
            next(client for client in greeting if client.peer.host == host).send_away()
        lingering = [client for client in self.clients if client.session.ended]
        for client in lingering[: max(0, len(lingering) - MAX_LINGERING)]:
            client.cut()


class _Client(asyncio.Protocol):
    """One socket and its session."""

    def __init__(self, server: BridgeServer, peer: Peer) -> None:
        port, now_ns = server.port, server.now_ns()
        self._server = server
        self.peer = peer
        self.session = Session(
            port.robot_name, port.n, server.lease, server.settings, peer, now_ns, server.places, server.token,
            port.judge_payload, port.judge_collision, port.judge_analog, arm=port.arm,
        )  # fmt: skip
        self.transport: asyncio.Transport | None = None
        self._timer: asyncio.TimerHandle | None = None
        self._unwanted = 0  # bytes that came behind its end
        self._wake_s = self._patient_until_s = 0.0  # when the timer is to fire, on the event loop's clock

    async def take_over(self, connection: socket.socket) -> None:
        """Serve this connection."""
        try:
            await asyncio.get_running_loop().connect_accepted_socket(lambda: self, connection)
        except OSError:  # gone again
            connection.close()
            self._server.clients.pop(self, None)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """The connection is ours."""
        self.transport = cast(asyncio.Transport, transport)
        _bound_buffers(self.transport)
        if self.session.ended:  # sent away before it began
            self.transport.abort()
            return
        self._set_timer()

    def data_received(self, data: bytes) -> None:
        """Bytes came."""
        if self.session.ended:  # they are read to let the last words arrive; nobody has much under way
            self._unwanted += len(data)
            if self._unwanted > MOST_UNWANTED:
                self.cut()
            return
        self._carry_out(self.session.receive(data, self._server.now_ns()))
        self._set_timer()

    def connection_lost(self, exc: Exception | None) -> None:
        """The socket is gone, whoever closed it."""
        self._server.clients.pop(self, None)
        if self._timer is not None:
            self._timer.cancel()
        self._carry_out(self.session.lose())
        self._server.say("%s has gone (%s)", self.session.label, exc or "closed")

    def pause_writing(self) -> None:
        """The client does not read."""
        self.session.block(self._server.now_ns())

    def resume_writing(self) -> None:
        """The client reads again."""
        self.session.unblock()

    def dismiss(self, reason: str) -> None:
        """End the session from our side."""
        self._carry_out(self.session.dismiss(reason, self._server.now_ns()))

    def send_away(self) -> None:
        """End a session that has not begun: others wait."""
        text = f"no HELLO yet, and {self._server.settings.max_greeting} others wait"
        self._carry_out(self.session.refuse(ErrorCode.FULL, text, self._server.now_ns()))

    def cut(self) -> None:
        """Wait no longer for the client to hang up."""
        if self.transport is not None:
            self.transport.abort()

    def _tick(self) -> None:
        asked_ns, state = self._server.now_ns(), self._server.read_state()
        if self._awaits_the_arm():
            self._call_at(asyncio.get_running_loop().time() + LOOK_S)
            return
        now_ns = min(asked_ns, self._server.now_ns())  # the later is the smaller where a stall was told of in between
        if state is None:  # or it was looked for at the end of a stall, of which its arm had not told yet
            state = self._server.read_state()
        port = self._server.port
        self._carry_out(self.session.tick(now_ns, state, port.mismatch, port.servo))
        self._set_timer()

    def _set_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        if not self.session.ended:
            self._call_at((self.session.due_ns + self._server.port.slipped_ns()) / 1e9)

    def _call_at(self, wake_s: float) -> None:
        self._wake_s = wake_s
        self._timer = asyncio.get_running_loop().call_at(wake_s, self._tick)

    def _awaits_the_arm(self) -> bool:
        """This process was kept from running, and so was its emulated arm, which may be about to say for how long."""
        now_s = asyncio.get_running_loop().time()
        if now_s - self._wake_s > OVERSLEPT_S:
            self._patient_until_s = now_s + PATIENCE_S
        return now_s < self._patient_until_s and self._server.port.stalled()

    def _carry_out(self, actions: list[Action]) -> None:
        outcome = carry_out(actions, self._server.port)
        for note in outcome.notes:
            self._server.say("%s", note)
        if self.transport is None or self.transport.is_closing():
            return
        if outcome.data:
            self.transport.write(outcome.data)
        if outcome.closed:
            self._server.say("%s: %s", self.session.label, outcome.closed)
            self._close()

    def _close(self) -> None:
        """Say no more, but read on until the client hangs up: to close with unread input would lose the last words."""
        if self.transport is not None:
            with suppress(OSError):  # the client has gone, and nobody has told us yet
                self.transport.write_eof()
            asyncio.get_running_loop().call_later(LINGER_S, self.transport.abort)


def _bound_buffers(transport: asyncio.Transport) -> None:
    sock: socket.socket = transport.get_extra_info("socket")
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SOCKET_BUFFER_BYTES)
    transport.set_write_buffer_limits(high=WRITE_BUFFER_BYTES, low=0)


def run_bridge(
    port: RobotPort,
    settings: BridgeSettings,
    on_ready: Callable[[str, int], None] | None = None,
    authority: ArmAuthority | None = None,
    arm: str = "",
) -> None:
    """Serve whoever can read the token in the runtime folder, until SIGTERM, SIGINT or SIGHUP.

    Raises LinkBusy or LinkError when the address cannot be had, LinkError when the runtime folder cannot be used.

    Args:
        port: the way to the servo.
        settings: where to listen, and the limits.
        on_ready: called with host and port once clients can connect.
        authority: held while a client commands; see `Lease`.
        arm: its name, which the token tells.
    """
    with asyncio.Runner(loop_factory=precise_loop) as runner:
        runner.run(_serve(BridgeServer(port, settings, authority), on_ready, arm))


async def _serve(server: BridgeServer, on_ready: Callable[[str, int], None] | None, arm: str = "") -> None:
    stop = asyncio.Event()
    for number in ending_signals():
        asyncio.get_running_loop().add_signal_handler(number, stop.set)
    server.take_address()
    try:
        with offered_token(server.address[1], arm) as server.token:
            await server.start()  # not before: who connects has looked for the token already
            if on_ready is not None:
                on_ready(*server.address)
            await stop.wait()
    finally:
        await server.close()
