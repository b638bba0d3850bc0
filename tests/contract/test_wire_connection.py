"""Both ends of a conversation over any stream of bytes."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from math import inf, nan
from zlib import crc32

import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import LocalProtocolError, RemoteProtocolError
from qrobot.wire import (
    VERSION,
    Bye,
    ClientRole,
    Command,
    Connection,
    ErrorCode,
    Hello,
    InvalidSetpoint,
    Side,
    State,
    WireError,
    WireEvent,
)
from qrobot.wire.codec import encode
from qrobot.wire.connection import MAX_BUFFER_BYTES
from tests.support.packets import commands, connected, resting, states

N = 6
STILL = Command(1, (0,) * N, (0.0,) * N)
REST = resting((0.1,) * N)


def events(connection: Connection) -> list[WireEvent]:
    found = []
    while (event := connection.next_event()) is not None:
        found.append(event)
    return found


def with_seqs(packets):
    return [replace(packet, seq=seq) for seq, packet in enumerate(packets, start=1)]


def pieces(data: bytes, cuts: list[int]) -> list[bytes]:
    edges = [0, *sorted(cut % (len(data) + 1) for cut in cuts), len(data)]
    return [data[a:b] for a, b in pairwise(edges)]


@given(st.lists(states(N), min_size=1, max_size=5).map(with_seqs), st.lists(st.integers(0, 1 << 16), max_size=8))
def test_every_split_of_the_servers_bytes_gives_the_client_the_same_events(sent, cuts) -> None:
    client, server = connected(N)
    stream = b"".join(server.send(packet) for packet in sent)
    received = []
    for piece in pieces(stream, cuts):
        client.receive_data(piece)
        received += events(client)
    assert received == sent


@given(st.lists(commands(N), min_size=1, max_size=5).map(with_seqs), st.lists(st.integers(0, 1 << 16), max_size=8))
def test_every_split_of_the_clients_bytes_gives_the_server_the_same_events(sent, cuts) -> None:
    client, server = connected(N)
    stream = b"".join(client.send(packet) for packet in sent)
    received = []
    for piece in pieces(stream, cuts):
        server.receive_data(piece)
        received += events(server)
    assert received == sent


def test_a_handshake_arrives_byte_by_byte() -> None:
    client, server = Connection(Side.CLIENT), Connection(Side.SERVER)
    hello = Hello(ClientRole.OBSERVER, "", "slow", auth=b"secret")
    for byte in client.send(hello)[:-1]:
        server.receive_data(bytes([byte]))
        assert server.next_event() is None
    server.receive_data(encode(hello)[-1:])
    assert server.next_event() == hello


@pytest.mark.parametrize("bad", [nan, inf, -inf, 1e300, -1.000001e6])
@pytest.mark.parametrize("joint", [0, N - 1])
def test_an_impossible_setpoint_is_an_event_not_the_end(bad: float, joint: int) -> None:
    _, server = connected(N)
    setpoints = tuple(bad if k == joint else 0.5 for k in range(N))
    server.receive_data(encode(replace(STILL, setpoints=setpoints, stop=True)))
    event = server.next_event()
    assert isinstance(event, InvalidSetpoint)
    assert (event.joint, event.command.seq, event.command.stop) == (joint, 1, True)
    server.receive_data(encode(replace(STILL, seq=2)))
    assert server.next_event() == replace(STILL, seq=2)


def test_our_own_side_does_not_send_an_impossible_setpoint() -> None:
    client, _ = connected(N)
    with pytest.raises(LocalProtocolError, match="joint 3"):
        client.send(replace(STILL, setpoints=(0.0, 0.0, nan, 0.0, 0.0, 0.0), power=True))
    assert client.send(STILL) == encode(STILL)


@pytest.mark.parametrize("asked", [{"power": False}, {"power": True, "stop": True}, {"power": False, "stop": True}])
@pytest.mark.parametrize("bad", [nan, inf, -inf, 1e300])
def test_our_own_side_sends_what_takes_away_whatever_the_setpoints_beside_it(
    asked: dict[str, bool], bad: float
) -> None:
    client, server = connected(N)
    server.receive_data(client.send(replace(STILL, setpoints=(bad,) * N, **asked)))
    event = server.next_event()
    assert isinstance(event, InvalidSetpoint)
    assert {name: getattr(event.command, name) for name in asked} == asked


def test_repeated_and_late_frames_are_dropped_and_counted() -> None:
    _, server = connected(N)
    for seq in (5, 5, 4, 6, 5, 7):
        server.receive_data(encode(replace(STILL, seq=seq)))
    assert [event.seq for event in events(server)] == [5, 6, 7]
    assert (server.received.refused, server.received.newest) == (3, 7)


def test_our_own_side_does_not_repeat_a_number() -> None:
    client, server = connected(N)
    client.send(STILL)
    server.send(State(9, REST))
    with pytest.raises(LocalProtocolError, match="COMMAND 1 is not newer"):
        client.send(STILL)
    with pytest.raises(LocalProtocolError, match="STATE 8 is not newer"):
        server.send(State(8, REST))


def test_joint_counts_have_to_agree_with_the_welcome() -> None:
    client, server = connected(N)
    with pytest.raises(LocalProtocolError, match="2 joints to a robot of 6"):
        client.send(Command(1, (0, 0), (0.0, 0.0)))
    server.receive_data(encode(Command(1, (0, 0), (0.0, 0.0))))
    with pytest.raises(RemoteProtocolError, match="2 joints to a robot of 6"):
        server.next_event()
    client.receive_data(encode(State(1, resting((0.0,)))))
    with pytest.raises(RemoteProtocolError, match="1 joints from a robot of 6"):
        client.next_event()


def test_packets_before_the_broken_one_still_count() -> None:
    _, server = connected(N)
    server.receive_data(encode(STILL) + b"rubbish!")
    assert server.next_event() == STILL
    with pytest.raises(RemoteProtocolError, match="no packet begins with"):
        server.next_event()


def test_after_a_broken_packet_nothing_is_listened_to_but_the_reason_can_be_told() -> None:
    _, server = connected(N)
    broken = bytearray(encode(STILL))
    broken[40] ^= 1
    server.receive_data(bytes(broken) + encode(replace(STILL, seq=2)))
    with pytest.raises(RemoteProtocolError, match="checksum"):
        server.next_event()
    server.receive_data(encode(replace(STILL, seq=3)))
    assert events(server) == []
    reason = WireError(ErrorCode.MALFORMED, "checksum", fatal=True)
    assert server.send(reason) == encode(reason)
    assert server.ended


def test_another_version_is_named_and_its_error_is_still_understood() -> None:
    client, server = Connection(Side.CLIENT), Connection(Side.SERVER)
    server.receive_data(_as_version(VERSION + 1, client.send(Hello(ClientRole.COMMANDER, "puma560"))))
    with pytest.raises(RemoteProtocolError, match=f"speaks version {VERSION + 1}"):
        server.next_event()
    assert server.peer_version == VERSION + 1
    complaint = WireError(ErrorCode.VERSION, "this is another version", fatal=True)
    client.receive_data(_as_version(VERSION + 1, encode(complaint)))
    assert client.next_event() == complaint


def _as_version(version: int, frame: bytes) -> bytes:
    changed = frame[:4] + bytes([version]) + frame[5:-4]
    return changed + crc32(changed).to_bytes(4, "little")


def test_after_a_bye_nothing_is_sent_and_what_was_under_way_is_ignored() -> None:
    client, server = connected(N)
    under_way = server.send(State(1, REST))
    server.receive_data(client.send(Bye("done")))
    assert events(server) == [Bye("done")]
    client.receive_data(under_way)
    assert events(client) == []
    for side, packet in ((client, STILL), (server, State(2, REST))):
        with pytest.raises(LocalProtocolError):
            side.send(packet)


def test_unread_bytes_are_bounded() -> None:
    _, server = connected(N)
    server.receive_data(bytes(MAX_BUFFER_BYTES))
    with pytest.raises(RemoteProtocolError, match="at once"):
        server.receive_data(b"x")
    assert not server.listening


@pytest.mark.parametrize("length", [0, 4, 24, 27, 30, 4100, 65535])
def test_a_length_that_lies_ends_the_conversation_before_anything_is_waited_for(length: int) -> None:
    server = Connection(Side.SERVER)
    server.receive_data(b"QROB\x01\x01" + length.to_bytes(2, "little"))
    with pytest.raises(RemoteProtocolError, match="impossible packet length"):
        server.next_event()


def test_a_welcome_tells_both_ends_the_joint_count() -> None:
    client, server = connected(7)
    assert (client.n, server.n) == (7, 7)
