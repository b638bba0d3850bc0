"""The codec by its definition: decode inverts encode, and the layout is what the page says."""

from __future__ import annotations

from dataclasses import replace
from zlib import crc32

import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import LocalProtocolError, RemoteProtocolError
from qrobot.printable import printable
from qrobot.wire import Bye, ClientRole, Command, Hello, Packet, State, Welcome, WireError
from qrobot.wire.codec import LONGEST_AUTH, decode, encode
from qrobot.wire.framing import LONGEST_TEXT, frame_length
from qrobot.wire.layout import LAYOUTS, MAX_PACKET_BYTES
from tests.support.packets import BYES, ERRORS, HELLOS, JOINTS, PACKETS, WELCOMES, commands, resting, states


@given(PACKETS)
def test_decoding_inverts_encoding(packet: Packet) -> None:
    assert decode(encode(packet)) == packet


@given(PACKETS)
def test_every_packet_says_its_own_length_and_ends_in_the_checksum_of_what_is_before(packet: Packet) -> None:
    data = encode(packet)
    assert frame_length(data) == len(data) <= MAX_PACKET_BYTES
    assert len(data) % 4 == 0
    assert int.from_bytes(data[-4:], "little") == crc32(data[:-4])


@given(PACKETS, st.data())
def test_a_changed_bit_never_goes_unnoticed(packet: Packet, data: st.DataObject) -> None:
    frame = bytearray(encode(packet))
    bit = data.draw(st.integers(8 * 8, 8 * len(frame) - 1))  # behind magic and length, which `frame_length` judges
    frame[bit // 8] ^= 1 << bit % 8
    with pytest.raises(RemoteProtocolError):
        decode(bytes(frame))


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
@given(n=JOINTS)
def test_every_number_is_aligned_to_its_size(layout, n: int) -> None:
    assert [field.name for offset, field in layout.rows(n) if offset % field.size] == []


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
@given(n=JOINTS)
def test_the_rows_account_for_every_byte_but_the_padding(layout, n: int) -> None:
    offset, last = list(layout.rows(n))[-1]
    assert 0 <= layout.size(n) - 4 - (offset + last.size * last.length(n)) < 4


@pytest.mark.parametrize(
    ("strategy", "name"),
    [
        (HELLOS, "HELLO"),
        (WELCOMES, "WELCOME"),
        (ERRORS, "ERROR"),
        (BYES, "BYE"),
        (commands(6), "COMMAND"),
        (states(6), "STATE"),
    ],
)
@given(data=st.data())
def test_the_kind_on_the_wire_is_the_layouts(strategy, name: str, data: st.DataObject) -> None:
    kind = encode(data.draw(strategy))[5]
    assert {layout.name: layout.kind for layout in LAYOUTS}[name] == kind


@pytest.mark.parametrize(
    "packet",
    [
        Command(-1, (1,), (0.0,)),
        Command(1 << 32, (1,), (0.0,)),
        Command(0, (3,), (0.0,)),
        Command(0, (-1,), (0.0,)),
        Command(0, (1,), (0.0, 0.0)),
        Command(0, (), ()),
        Command(0, (1,) * 33, (0.0,) * 33),
        Command(0, (1,), (0.0,), hand=3),
        Command(0, (1,), (0.0,), hand=-1),
        Command(0, (1,), (0.0,), outputs=-1),
        Command(0, (1,), (0.0,), outputs=1 << 32),
        Hello(ClientRole.OBSERVER, "x" * 65),
        Hello(ClientRole.OBSERVER, "a\0b"),
        Hello(ClientRole.OBSERVER, "", period_us=-1),
        Hello(ClientRole.OBSERVER, "", auth=bytes(LONGEST_AUTH + 1)),
        Welcome(ClientRole.OBSERVER, "puma560", 256, 28_000),
        WireError(1 << 16, "", fatal=True),
    ],
)
def test_what_does_not_fit_is_refused_before_it_is_sent(packet: Packet) -> None:
    with pytest.raises(LocalProtocolError):
        encode(packet)


def test_vectors_of_unequal_length_are_no_state() -> None:
    with pytest.raises(LocalProtocolError):
        encode(State(0, replace(resting((0.0, 0.0)), v=(0.0,))))


@given(st.text(st.characters(exclude_categories=["Cs"]), max_size=600))
def test_texts_for_people_are_cut_not_refused(text: str) -> None:
    sent = decode(encode(Bye(text)))
    assert isinstance(sent, Bye)
    assert printable(text.replace("\0", " ")).startswith(sent.text)
    assert len(text.encode()) > LONGEST_TEXT - 4 or sent.text == printable(text.replace("\0", " "))
