"""The table of the conversation: complete, and nobody says what it does not give them."""

from __future__ import annotations

import pytest

from qrobot.errors import LocalProtocolError, RemoteProtocolError
from qrobot.wire import (
    AnalogOutputs,
    Bye,
    ClientRole,
    Collision,
    Command,
    Connection,
    Conversation,
    ErrorCode,
    Hello,
    Packet,
    Payload,
    Side,
    Signals,
    State,
    Stop,
    Welcome,
    WireError,
)
from qrobot.wire.codec import encode
from qrobot.wire.states import TRANSITIONS, PacketClass, mermaid, word_of
from tests.support.packets import resting

N = 2
REST = resting((0.0,) * N)
SPOKEN: dict[PacketClass, Packet] = {
    PacketClass.HELLO: Hello(ClientRole.COMMANDER, "puma560"),
    PacketClass.WELCOME_COMMANDER: Welcome(ClientRole.COMMANDER, "puma560", N, 28_000),
    PacketClass.WELCOME_OBSERVER: Welcome(ClientRole.OBSERVER, "puma560", N, 28_000),
    PacketClass.COMMAND: Command(1, (0,) * N, (0.0,) * N),
    PacketClass.STATE: State(1, REST),
    PacketClass.WARNING: WireError(ErrorCode.SERVO_GONE, "", fatal=False),
    PacketClass.REFUSAL: WireError(ErrorCode.FULL, "", fatal=True),
    PacketClass.BYE: Bye(),
    PacketClass.STOP: Stop(),
    PacketClass.SIGNALS: Signals(("depth",)),
    PacketClass.PAYLOAD: Payload(1.0),
    PacketClass.COLLISION: Collision((0.0,) * N),
    PacketClass.ANALOG: AnalogOutputs((0.0,) * 8),
}
EVERYTHING_SAID = [(where, side, word) for where in Conversation for side in Side for word in PacketClass]


def connection_in(where: Conversation, side: Side) -> Connection:
    connection = Connection(side)
    connection.conversation, connection.n = where, N
    connection.listening = where is not Conversation.ENDED
    return connection


def test_every_word_is_what_its_packet_says() -> None:
    assert {word: word_of(packet) for word, packet in SPOKEN.items()} == {word: word for word in PacketClass}


def test_every_conversation_has_a_row_and_can_end() -> None:
    assert set(TRANSITIONS) == set(Conversation)
    for where in set(Conversation) - {Conversation.ENDED}:
        assert Conversation.ENDED in TRANSITIONS[where].values()
    assert TRANSITIONS[Conversation.ENDED] == {}


def test_a_stop_is_anybodys_who_is_in() -> None:
    where = {where for where, row in TRANSITIONS.items() for side, word in row if word is PacketClass.STOP}
    assert where == {Conversation.COMMANDING, Conversation.OBSERVING}


def test_only_a_commander_commands_and_only_the_server_tells_the_state() -> None:
    speakers = {(where, side, word) for where, row in TRANSITIONS.items() for side, word in row}
    settings = (PacketClass.SIGNALS, PacketClass.PAYLOAD, PacketClass.COLLISION, PacketClass.ANALOG)
    for word in (PacketClass.COMMAND, *settings):
        assert {entry for entry in speakers if entry[2] is word} == {(Conversation.COMMANDING, Side.CLIENT, word)}
    assert {side for _, side, word in speakers if word is PacketClass.STATE} == {Side.SERVER}


@pytest.mark.parametrize(("where", "speaker", "word"), EVERYTHING_SAID)
def test_a_speaker_may_say_what_the_table_has_and_nothing_else(where, speaker, word) -> None:
    connection = connection_in(where, speaker)
    target = TRANSITIONS[where].get((speaker, word))
    if target is None:
        with pytest.raises(LocalProtocolError):
            connection.send(SPOKEN[word])
        assert connection.conversation is where
    else:
        assert connection.send(SPOKEN[word]) == encode(SPOKEN[word])
        assert connection.conversation is target


@pytest.mark.parametrize(("where", "speaker", "word"), EVERYTHING_SAID)
def test_a_listener_takes_what_the_table_has_and_stops_listening_at_the_rest(where, speaker, word) -> None:
    connection = connection_in(where, speaker.other)
    target = TRANSITIONS[where].get((speaker, word))
    connection.receive_data(encode(SPOKEN[word]))
    if where is Conversation.ENDED:
        assert connection.next_event() is None
    elif target is None:
        with pytest.raises(RemoteProtocolError):
            connection.next_event()
        assert not connection.listening
    else:
        assert connection.next_event() == SPOKEN[word]
        assert connection.conversation is target


def test_the_picture_shows_every_transition() -> None:
    arrows = [line for line in mermaid().splitlines() if "-->" in line and "[*]" not in line]
    assert len(arrows) == sum(len(row) for row in TRANSITIONS.values())
