"""The blocking client of a bridge over TCP."""

from __future__ import annotations

import os
import select
import socket
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from ipaddress import IPv6Address
from typing import Final, TypeVar

from qrobot.errors import ConfigError, LinkLost, LinkTimeout, error_text
from qrobot.rci.client import Beside, Client, ServoLoss
from qrobot.rci.forked_child import keep_from_children
from qrobot.rci.link import NEW_PERIOD
from qrobot.realtime.bridge_token import arm_of_token, token_for
from qrobot.realtime.deadline import Deadline
from qrobot.wire import DEFAULT_PORT, ClientRole, Command, Hello, State, Welcome

BRIDGE_VARIABLE: Final = "QROBOT_BRIDGE"
ONLY_VARIABLE: Final = "QROBOT_ONLY_BRIDGES"
"""Addresses with commas between them, of the only arms that a program may reach; whoever starts it sets it."""
LOCALHOST: Final = "127.0.0.1"
CONNECT_TIMEOUT_S: Final = 3.0
ANSWER_TIMEOUT_S: Final = 2.0  # far beyond the longest sample period of 100 ms
STEP_TIMEOUT_S: Final = 0.5  # for arms in step, which may carry something together, once samples come [A]
LINGER_S: Final = 0.5  # a bridge that does not close its end after our goodbye is left after this
_CHUNK: Final = 1 << 16

T = TypeVar("T")
SocketAddress = tuple[str, int]


def bridge_address(text: str | None = None) -> SocketAddress:
    """Host and port of the bridge from "host:port", "host" or ":port"; default the variable QROBOT_BRIDGE.

    An address of IPv6 stands without brackets, with its port: "::1:5600".

    Raises:
        ConfigError: that is no address.
    """
    what = BRIDGE_VARIABLE if text is None else "the address of a bridge"
    text = os.environ.get(BRIDGE_VARIABLE, "") if text is None else text
    host, _, port = text.rpartition(":") if ":" in text else (text, "", "")
    if (port and not (port.isdecimal() and 0 < int(port) < 1 << 16)) or (":" in host and not _is_ipv6(host)):
        raise ConfigError(f"{what} is {text!r}; host:port is needed, as in {LOCALHOST}:{DEFAULT_PORT}")
    return host or LOCALHOST, int(port) if port else DEFAULT_PORT


def _is_ipv6(host: str) -> bool:
    try:
        return bool(IPv6Address(host))
    except ValueError:
        return False


def address_text(bridge: str) -> str:
    """The address of a bridge in full, "host:port". Raises ConfigError: that is no address."""
    return place_text(bridge_address(bridge))


def place_text(address: SocketAddress) -> str:
    """The same of host and port; this machine has one name."""
    host, port = address
    return f"{LOCALHOST if host == 'localhost' else host}:{port}"


def check_reachable(address: SocketAddress) -> None:
    """Raise ConfigError for a bridge that whoever has started the program keeps from it."""
    allowed, place = os.environ.get(ONLY_VARIABLE), place_text(address)
    if allowed is not None and place not in map(address_text, allowed.split(",")):
        raise ConfigError(
            f"the bridge at {place} is not for this program, which was started for {allowed} alone: at the pendant, "
            "drive the other arm from the same page as well, and start the program again"
        )


def insist_on_arm(address: SocketAddress, arm: str) -> None:
    """Raise ConfigError for a bridge that tells of another arm than `arm` by its token; "" is any."""
    found = arm_of_token(token_for(*address))
    if arm and found not in ("", arm) and _is_there(address):
        raise ConfigError(
            f"the bridge at {place_text(address)} is that of arm {found!r}, not of {arm!r}: --deployment names the "
            "file of an arm, --arm one of several"
        )


def _is_there(address: SocketAddress) -> bool:
    """Somebody listens: the token is none that a killed bridge has left."""
    with suppress(OSError):
        socket.create_connection(address, CONNECT_TIMEOUT_S).close()
        return True
    return False


def connect(address: SocketAddress) -> socket.socket:
    """A TCP connection without Nagle's delay. Raises LinkTimeout or LinkLost."""
    where = f"{address[0]}:{address[1]}"
    try:
        sock = socket.create_connection(address, CONNECT_TIMEOUT_S)
    except TimeoutError as error:
        raise LinkTimeout(f"the bridge at {where} does not answer") from error
    except OSError as error:
        raise LinkLost(f"no bridge at {where}: {error_text(error)}; start one with `qrobot up`") from error
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return sock


def _read_to_the_end(sock: socket.socket, seconds: float) -> None:
    """Wait until the far end closes. To close with unread input would take back what was sent (RFC 9293, 3.6.1)."""
    deadline = Deadline(seconds)
    while (left_s := deadline.left_s) > 0:
        sock.settimeout(left_s)
        if not sock.recv(_CHUNK):
            return


class TcpLink:
    """A `Link` in real time.

    Args:
        hello: how to greet; without authentication of its own it takes the token of that bridge, see `bridge_token`.
        address: host and port of the bridge.
        connector: opens the socket; tests bring their own.
        answer_s: how long the bridge may be silent, None for the usual time; in step with others at most
            `STEP_TIMEOUT_S` once a sample has come.
        arm: name of the arm that is to be commanded; "" for whichever the bridge has.

    Attributes:
        address: as given.
    """

    virtual_time = False

    def __init__(
        self,
        hello: Hello,
        address: SocketAddress,
        connector: Callable[[SocketAddress], socket.socket] = connect,
        answer_s: float | None = None,
        arm: str = "",
    ) -> None:
        self._hello, self._arm = hello, arm
        self.address = address
        self._answer_s = answer_s
        self._client = self._new_client(address)
        self._connector = connector
        self._socket: socket.socket | None = None
        keep_from_children(self)

    @property
    def answer_s(self) -> float:
        """Time that the bridge may be silent, s."""
        return ANSWER_TIMEOUT_S if self._answer_s is None else self._answer_s

    @property
    def hello(self) -> Hello:
        """Greeting, as it was given or sent last."""
        return self._hello

    def open(self) -> Welcome:
        """Connect and greet; see `Link.open`. Raises ConfigError: that arm is not for this program."""
        if self._hello.role is ClientRole.COMMANDER:
            check_reachable(self.address)
            insist_on_arm(self.address, self._arm)
        self._socket = self._connector(self.address)
        self._socket.settimeout(self.answer_s)
        self._send(self._client.greet())
        return self._await(self._client.pop_welcome)

    def exchange(self, command: Command | None) -> State:
        """Send, and wait for the newest STATE; see `Link.exchange`."""
        if data := self._client.say(command):
            self._send(data)
        state = self._await(self._client.pop_state)
        if self._hello.in_step and self.answer_s > STEP_TIMEOUT_S:
            self._open_socket.settimeout(STEP_TIMEOUT_S)
        return state

    def take_state(self) -> State | None:
        """The newest STATE that has come; None when none has, for nobody waits here. Raises LinkLost, ServoFault."""
        if data := self._client.say(None):
            self._send(data)
        while (state := self._client.pop_state()) is None and self._can_be_read():
            self._client.take(self._receive())
        return state

    def send(self, command: Command) -> None:
        """Send without waiting. Raises LinkLost, or what the server refused by."""
        self._send(self._client.say(command))

    def tell(self, packet: Beside) -> None:
        """Send a packet with the next `exchange`; see `Link.tell`."""
        self._client.tell(packet)

    @property
    def refusals(self) -> Mapping[type[Beside], str]:
        """Reasons that `refusal` gives, by kind."""
        return self._client.refusals

    def refusal(self, kind: type[Beside]) -> str:
        """See `Link.refusal`."""
        return self._client.refusals.get(kind, "")

    def fileno(self) -> int:
        """Descriptor of the socket, which becomes readable when a STATE comes. Raises LinkLost: it is closed."""
        return self._open_socket.fileno()

    @property
    def has_state(self) -> bool:
        """A STATE waits to be handed out, of which the descriptor tells nothing: it came together with the WELCOME."""
        return self._client.has_state

    def take_servo_loss(self) -> ServoLoss:
        """See `Link.take_servo_loss`."""
        loss, self._client.servo_loss = self._client.servo_loss, ServoLoss.NONE
        return loss

    def now_ns(self) -> int:
        """The monotonic clock."""
        return time.monotonic_ns()

    def reopen(self, period_us: int) -> Welcome:
        """See `Link.reopen`."""
        self.close(NEW_PERIOD)
        self._hello = replace(self._hello, period_us=period_us)
        self._client = self._new_client(self.address)
        return self.open()

    def close(self, reason: str = "") -> None:
        """Say goodbye, and close the socket when the bridge has heard it: within `LINGER_S`."""
        sock, self._socket = self._socket, None  # first: a program's own thread may close it as well
        if sock is None:
            return
        with sock, suppress(OSError):
            sock.sendall(self._client.farewell(reason))
            sock.shutdown(socket.SHUT_WR)
            _read_to_the_end(sock, LINGER_S)

    def forget_in_child(self) -> None:
        """See `Owned`: the connection is the parent's, which says goodbye itself."""
        sock, self._socket = self._socket, None
        if sock is not None:
            sock.close()

    def _new_client(self, address: SocketAddress) -> Client:
        hello = self._hello if self._hello.auth else replace(self._hello, auth=token_for(*address))
        return Client(hello, f"the bridge at {address[0]}:{address[1]}")

    def _await(self, pop: Callable[[], T | None]) -> T:
        while (answer := pop()) is None:
            self._client.take(self._receive())
        return answer

    def _can_be_read(self) -> bool:
        look = select.poll()
        look.register(self._open_socket, select.POLLIN)
        return bool(look.poll(0))

    def _send(self, data: bytes) -> None:
        try:
            self._open_socket.sendall(data)
        except OSError as error:
            self._hear_last_words()
            raise self._lost(error) from error

    def _hear_last_words(self) -> None:
        """A server that refuses closes at once; why it did may still lie in the socket."""
        with suppress(OSError):
            if data := self._open_socket.recv(_CHUNK):
                self._client.take(data)

    def _receive(self) -> bytes:
        try:
            return self._open_socket.recv(_CHUNK)
        except TimeoutError as error:
            raise self._client.silence() from error
        except OSError as error:
            raise self._lost(error) from error

    def _lost(self, error: OSError) -> LinkLost:
        return LinkLost(f"lost {self._client.peer}: {error_text(error)}")

    @property
    def _open_socket(self) -> socket.socket:
        if self._socket is None:
            raise LinkLost(f"the connection to {self._client.peer} is closed")
        return self._socket
