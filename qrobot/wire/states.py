"""State machine of a conversation. The table below *is* the machine; its picture in the docs is generated from it.

Rules:

* both ends run the same table on the same conversation; what matters is which side speaks and what it says;
* the client greets, the server welcomes it as commander or observer, or refuses it with a fatal error;
* STATE flows from the server to everybody who is in; COMMAND, SIGNALS, PAYLOAD, COLLISION and ANALOG
  only from the commander;
* anybody who is in may ask for a STOP;
* an error that is not fatal changes nothing, a fatal one or a BYE ends the conversation for both;
* what is not in the table is a protocol error: a local one for the speaker, a remote one for the listener;
* after the end nothing may be sent, and what still arrives (it was under way) is ignored.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

from qrobot.wire.packets import (
    AnalogOutputs,
    Bye,
    Collision,
    Command,
    Hello,
    Packet,
    Payload,
    Signals,
    State,
    Stop,
    Welcome,
    WireError,
)
from qrobot.wire.vocabulary import ClientRole


class Side(Enum):
    """The two ends of a conversation."""

    CLIENT = "client"
    SERVER = "server"

    @property
    def other(self) -> Side:
        """The far end."""
        return Side.SERVER if self is Side.CLIENT else Side.CLIENT


class Conversation(Enum):
    """States of a conversation."""

    GREETING = "greeting"
    ANSWERING = "answering"
    COMMANDING = "commanding"
    OBSERVING = "observing"
    ENDED = "ended"


class PacketClass(Enum):
    """Inputs of the table: kinds of packets, and of two of them what they say."""

    HELLO = "HELLO"
    WELCOME_COMMANDER = "WELCOME as commander"
    WELCOME_OBSERVER = "WELCOME as observer"
    COMMAND = "COMMAND"
    STATE = "STATE"
    WARNING = "ERROR"
    REFUSAL = "fatal ERROR"
    BYE = "BYE"
    STOP = "STOP"
    SIGNALS = "SIGNALS"
    PAYLOAD = "PAYLOAD"
    COLLISION = "COLLISION"
    ANALOG = "ANALOG"


_CLIENT_LEAVES: Final = {(Side.CLIENT, PacketClass.BYE): Conversation.ENDED}
_SERVER_ENDS: Final = {
    (Side.SERVER, PacketClass.REFUSAL): Conversation.ENDED,
    (Side.SERVER, PacketClass.BYE): Conversation.ENDED,
}
_EITHER_ENDS: Final = _CLIENT_LEAVES | _SERVER_ENDS

TRANSITIONS: Final[dict[Conversation, dict[tuple[Side, PacketClass], Conversation]]] = {
    Conversation.GREETING: {
        (Side.CLIENT, PacketClass.HELLO): Conversation.ANSWERING,
        **_EITHER_ENDS,
    },
    Conversation.ANSWERING: {
        (Side.SERVER, PacketClass.WELCOME_COMMANDER): Conversation.COMMANDING,
        (Side.SERVER, PacketClass.WELCOME_OBSERVER): Conversation.OBSERVING,
        **_EITHER_ENDS,
    },
    Conversation.COMMANDING: {
        (Side.SERVER, PacketClass.STATE): Conversation.COMMANDING,
        (Side.CLIENT, PacketClass.COMMAND): Conversation.COMMANDING,
        (Side.CLIENT, PacketClass.STOP): Conversation.COMMANDING,
        (Side.CLIENT, PacketClass.SIGNALS): Conversation.COMMANDING,
        (Side.CLIENT, PacketClass.PAYLOAD): Conversation.COMMANDING,
        (Side.CLIENT, PacketClass.COLLISION): Conversation.COMMANDING,
        (Side.CLIENT, PacketClass.ANALOG): Conversation.COMMANDING,
        (Side.SERVER, PacketClass.WARNING): Conversation.COMMANDING,
        **_EITHER_ENDS,
    },
    Conversation.OBSERVING: {
        (Side.SERVER, PacketClass.STATE): Conversation.OBSERVING,
        (Side.CLIENT, PacketClass.STOP): Conversation.OBSERVING,
        (Side.SERVER, PacketClass.WARNING): Conversation.OBSERVING,
        **_EITHER_ENDS,
    },
    Conversation.ENDED: {},
}

_PLAIN_WORDS: Final[dict[type, PacketClass]] = {
    State: PacketClass.STATE,
    Command: PacketClass.COMMAND,
    Hello: PacketClass.HELLO,
    Bye: PacketClass.BYE,
    Stop: PacketClass.STOP,
    Signals: PacketClass.SIGNALS,
    Payload: PacketClass.PAYLOAD,
    Collision: PacketClass.COLLISION,
    AnalogOutputs: PacketClass.ANALOG,
}


def word_of(packet: Packet) -> PacketClass:
    """Input of the table that a packet is."""
    if isinstance(packet, Welcome):
        return PacketClass.WELCOME_COMMANDER if packet.role is ClientRole.COMMANDER else PacketClass.WELCOME_OBSERVER
    if isinstance(packet, WireError):
        return PacketClass.REFUSAL if packet.fatal else PacketClass.WARNING
    return _PLAIN_WORDS[type(packet)]


def mermaid() -> str:
    """The state diagram of the documentation."""
    lines = ["stateDiagram-v2", f"    [*] --> {Conversation.GREETING.name}"]
    for origin, row in TRANSITIONS.items():
        lines += [
            f"    {origin.name} --> {target.name}: {side.value} {word.value}" for (side, word), target in row.items()
        ]
    return "\n".join([*lines, f"    {Conversation.ENDED.name} --> [*]"]) + "\n"
