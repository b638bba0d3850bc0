"""The client's side of a conversation, without I/O: what the server says, sorted, and its refusals as our errors."""

from __future__ import annotations

from collections import deque
from enum import IntEnum
from typing import Final, TypeAlias

from qrobot.errors import LinkBusy, LinkError, LinkLost, LinkTimeout, LocalProtocolError, RemoteProtocolError
from qrobot.wire import (
    AnalogOutputs,
    Bye,
    Collision,
    Command,
    Connection,
    ErrorCode,
    Hello,
    Payload,
    Side,
    Signals,
    State,
    Stop,
    Welcome,
    WireError,
    WireEvent,
)

_REFUSALS: Final[dict[int, type[LinkError]]] = {
    ErrorCode.COMMANDER_BUSY: LinkBusy,
    ErrorCode.FULL: LinkBusy,
    ErrorCode.TIMEOUT: LinkTimeout,
}

Beside: TypeAlias = Stop | Signals | Payload | Collision | AnalogOutputs
"""Packets that a client sends beside the sample periods."""

_REFUSED: Final[dict[int, type[Beside]]] = {
    ErrorCode.PAYLOAD_REFUSED: Payload,
    ErrorCode.COLLISION_REFUSED: Collision,
    ErrorCode.ANALOG_REFUSED: AnalogOutputs,
}


class ServoLoss(IntEnum):
    """Absence of the servo before a STATE."""

    NONE = 0
    AWAY = 1  # the servo was away for a moment; it remembers what it was told
    ANOTHER = 2  # this one has started anew since, and was told nothing


class Client:
    """One conversation.

    Attributes:
        peer: the server, for people.
        warning: newest complaint of the server that did not end the conversation, "" when there was none.
        refusals: reasons for which what was told last of a kind, payload, collision or outputs, was refused.
        servo_loss: whether the servo was away before the newest STATE; whoever has seen that takes it back.
    """

    def __init__(self, hello: Hello, peer: str) -> None:
        self.peer = peer
        self.warning = ""
        self.refusals: dict[type[Beside], str] = {}
        self.servo_loss = ServoLoss.NONE
        self._told = deque[Beside]()
        self._hello = hello
        self._connection = Connection(Side.CLIENT)
        self._welcome: Welcome | None = None
        self._state: State | None = None
        self._sampled = False  # a STATE has come

    def greet(self) -> bytes:
        """The first bytes to send."""
        return self._connection.send(self._hello)

    def tell(self, packet: Beside) -> None:
        """Have a packet sent with the next `say`. May be called from any thread."""
        self.refusals.pop(type(packet), None)
        self._told.append(packet)

    def say(self, command: Command | None) -> bytes:
        """Packets that were told, then a command, as bytes. Raises LocalProtocolError when one is malformed."""
        data = b""
        while self._told:
            data += self._connection.send(self._told.popleft())
        return data if command is None else data + self._connection.send(command)

    def farewell(self, reason: str) -> bytes:
        """The last bytes to send; none when the conversation is over, or never began."""
        try:
            return self._connection.send(Bye(reason))
        except LocalProtocolError:
            return b""

    def take(self, data: bytes) -> None:
        """Bytes came from the server; none at all means that it closed the connection.

        Raises:
            LinkBusy, LinkTimeout, LinkError: the server refused, for the reason in the text.
            LinkTimeout: the servo does not run any more, and samples are in step: what other arms carry together with
                this one cannot wait until it may have come back.
            LinkLost: the server left.
            RemoteProtocolError: the far end does not speak the protocol.
        """
        if not data:
            raise LinkLost(f"{self.peer} closed the connection")
        try:
            self._connection.receive_data(data)
            while (event := self._connection.next_event()) is not None:
                self._sort(event)
        except RemoteProtocolError as error:
            raise RemoteProtocolError(f"{self.peer} does not speak our protocol: {error}") from error

    def pop_welcome(self) -> Welcome | None:
        """The WELCOME, once."""
        welcome, self._welcome = self._welcome, None
        return welcome

    def pop_state(self) -> State | None:
        """The newest STATE not handed out yet."""
        state, self._state = self._state, None
        return state

    @property
    def has_state(self) -> bool:
        """A STATE has come that was not handed out yet."""
        return self._state is not None

    def silence(self) -> LinkTimeout:
        """The error for a server that says nothing any more; it repeats the server's last complaint."""
        complaint = f"; its last words: {self.warning}" if self.warning else ""
        return LinkTimeout(f"{self.peer} has fallen silent{complaint}")

    def _sort(self, event: WireEvent) -> None:
        match event:
            case Welcome():
                self._welcome = event
            case State():
                self._state, self._sampled = event, True
            case WireError(fatal=True):
                raise _REFUSALS.get(event.code, LinkError)(f"{self.peer} refused: {event.text}")
            case WireError():
                self._warn(event)
            case Bye():
                raise LinkLost(f"{self.peer} said goodbye: {event.text or 'no reason given'}")
            case _:  # the state table lets nothing else through from a server
                raise RemoteProtocolError(f"unexpected {type(event).__name__}")

    def _warn(self, complaint: WireError) -> None:
        self.warning = complaint.text
        if (kind := _REFUSED.get(complaint.code)) is not None:
            self.refusals[kind] = complaint.text
        if complaint.code == ErrorCode.SERVO_GONE:
            self._state = None  # a STATE of the servo before tells nothing of the next one
            self.servo_loss = max(self.servo_loss, ServoLoss.AWAY)
            if self._hello.in_step and self._sampled:
                raise LinkTimeout(f"{self.peer} says: {complaint.text}")
        if complaint.code == ErrorCode.SERVO_NEW:
            self.servo_loss = ServoLoss.ANOTHER
