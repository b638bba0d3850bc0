"""One conversation, as either end sees it: bytes in, events out; packets in, bytes out. No socket, no clock.

A reader loops::

    connection.receive_data(data)
    while (event := connection.next_event()) is not None:
        ...

RemoteProtocolError means that the far end broke the protocol: nothing it says counts any more, and the owner ends the
conversation (a server says why, with a fatal `WireError`; a client says BYE) and closes the socket.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, TypeAlias

from qrobot.errors import LocalProtocolError, RemoteProtocolError
from qrobot.wire.codec import decode, encode
from qrobot.wire.framing import frame_length, frame_version
from qrobot.wire.packets import Command, Packet, State, Welcome, WireError
from qrobot.wire.sequence import Sequence
from qrobot.wire.states import TRANSITIONS, Conversation, Side, word_of
from qrobot.wire.vocabulary import LARGEST_SETPOINT

MAX_BUFFER_BYTES: Final = 1 << 18


@dataclass(frozen=True, slots=True)
class InvalidSetpoint:
    """A COMMAND whose setpoint of `joint` (from 0) is not finite or absurdly large: its frame counts as missing.

    Its requests (`command.stop` first of all) are as valid as ever.
    """

    command: Command
    joint: int


WireEvent: TypeAlias = Packet | InvalidSetpoint


def invalid_joint(command: Command) -> int | None:
    """First joint whose setpoint no robot can follow; written so that NaN fails. None when all are sane."""
    for joint, setpoint in enumerate(command.setpoints):
        if not abs(setpoint) <= LARGEST_SETPOINT:
            return joint
    return None


def takes_away(command: Command) -> bool:
    """The command asks for a stop, or for no power: it is sent and obeyed whatever its setpoints are."""
    return command.stop or not command.power


class Connection:
    """One end of a conversation.

    Attributes:
        side: which end this is.
        conversation: where the conversation stands.
        n: joint count, 0 before WELCOME.
        peer_version: protocol version of the far end's newest packet, None before the first.
        received: sequence of the numbered packets from the far end (STATE or COMMAND).
        listening: False once the far end broke the protocol, or the conversation has ended.
    """

    def __init__(self, side: Side) -> None:
        self.side = side
        self.conversation = Conversation.GREETING
        self.n = 0
        self.peer_version: int | None = None
        self.received = Sequence()
        self.listening = True
        self._sent = Sequence()
        self._buffer = bytearray()

    @property
    def ended(self) -> bool:
        """Whether the conversation is over; nothing may be sent then."""
        return self.conversation is Conversation.ENDED

    def receive_data(self, data: bytes) -> None:
        """Take bytes from the far end; `next_event` tells what they mean.

        Raises RemoteProtocolError when more than `MAX_BUFFER_BYTES` wait to be asked for.
        """
        if not self.listening:
            return
        if len(self._buffer) + len(data) > MAX_BUFFER_BYTES:
            self._stop_listening()
            raise RemoteProtocolError(f"more than {MAX_BUFFER_BYTES} bytes at once")
        self._buffer += data

    def next_event(self) -> WireEvent | None:
        """The next thing the far end said; None when that takes more bytes, or the conversation has ended.

        Raises RemoteProtocolError, once, when the far end broke the protocol.
        """
        try:
            return self._next_event()
        except RemoteProtocolError:
            self._stop_listening()
            raise

    def send(self, packet: Packet) -> bytes:
        """Bytes to hand to the far end.

        Raises LocalProtocolError when the packet is malformed or out of turn; nothing has changed then. Impossible
        setpoints beside a stop or a power-off are left to the far end to refuse, for the sake of what must get through.
        """
        target = self._target(self.side, packet)
        if target is None:
            raise LocalProtocolError(f"the {self.side.value} may not send {_name(packet)} while {self._where}")
        if isinstance(packet, Command) and not takes_away(packet) and (joint := invalid_joint(packet)) is not None:
            raise LocalProtocolError(f"setpoint {packet.setpoints[joint]} of joint {joint + 1} is not a sane number")
        self._check_joints(packet, LocalProtocolError)
        data = encode(packet)
        if isinstance(packet, Command | State) and not self._sent.accept(packet.seq):
            raise LocalProtocolError(f"{_name(packet)} {packet.seq} is not newer than the one before it")
        self._follow(packet, target)
        return data

    def _next_event(self) -> WireEvent | None:
        while (packet := self._next_packet()) is not None:
            target = self._target(self.side.other, packet)
            if target is None:
                raise RemoteProtocolError(f"the {self.side.other.value} sent {_name(packet)} while {self._where}")
            self._check_joints(packet, RemoteProtocolError)
            self._follow(packet, target)
            if isinstance(packet, Command | State) and not self.received.accept(packet.seq):
                continue
            return _judged(packet)
        return None

    def _next_packet(self) -> Packet | None:
        length = frame_length(self._buffer)
        if length is None or len(self._buffer) < length:
            return None
        frame = bytes(self._buffer[:length])
        del self._buffer[:length]
        self.peer_version = frame_version(frame)
        return decode(frame)

    def _target(self, speaker: Side, packet: Packet) -> Conversation | None:
        return TRANSITIONS[self.conversation].get((speaker, word_of(packet)))

    def _check_joints(self, packet: Packet, error: type[LocalProtocolError | RemoteProtocolError]) -> None:
        if isinstance(packet, Command) and packet.n != self.n:
            raise error(f"COMMAND for {packet.n} joints to a robot of {self.n}")
        if isinstance(packet, State) and packet.robot.n != self.n:
            raise error(f"STATE of {packet.robot.n} joints from a robot of {self.n}")

    def _follow(self, packet: Packet, target: Conversation) -> None:
        if isinstance(packet, Welcome):
            self.n = packet.n
        self.conversation = target
        if self.ended:
            self._stop_listening()

    def _stop_listening(self) -> None:
        self.listening = False
        self._buffer.clear()

    @property
    def _where(self) -> str:
        return f"the conversation is {self.conversation.value}"


def _judged(packet: Packet) -> WireEvent:
    """A COMMAND nobody can follow becomes an event of its own."""
    if isinstance(packet, Command) and (joint := invalid_joint(packet)) is not None:
        return InvalidSetpoint(packet, joint)
    return packet


def _name(packet: Packet) -> str:
    return "ERROR" if isinstance(packet, WireError) else word_of(packet).value.split()[0]
