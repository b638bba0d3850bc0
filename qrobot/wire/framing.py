"""Frame of all packets: header, checksum, and the form of names and texts.

What cannot be sent raises LocalProtocolError, what cannot be read RemoteProtocolError.
"""

from __future__ import annotations

from struct import Struct
from typing import Any, Final
from zlib import crc32

from qrobot.errors import LocalProtocolError, RemoteProtocolError
from qrobot.printable import printable
from qrobot.wire.layout import CRC_BYTES, ERROR, HEADER_BYTES, MAGIC, MAX_PACKET_BYTES, NAME_BYTES, Layout
from qrobot.wire.vocabulary import MAX_JOINTS, VERSION

LONGEST_TEXT: Final = 512  # longer texts are cut: they are for people

_START: Final = Struct("<4sBBH")  # magic, version, kind, length
_CRC: Final = Struct("<I")


def frame_length(start: bytes | bytearray) -> int | None:
    """Length of the packet that begins here; None while fewer than 8 bytes are there.

    Raises RemoteProtocolError when no packet begins so, or one of impossible length.
    """
    if len(start) < _START.size:
        return None
    magic, _, _, length = _START.unpack_from(start)
    if magic != MAGIC:
        raise RemoteProtocolError(f"no packet begins with {bytes(magic)!r}; {MAGIC!r} expected")
    if not HEADER_BYTES + CRC_BYTES <= length <= MAX_PACKET_BYTES or length % 4:
        raise RemoteProtocolError(f"impossible packet length {length}: a multiple of 4, 28 to {MAX_PACKET_BYTES}")
    return int(length)


def frame_version(frame: bytes) -> int:
    """Protocol version that a packet claims."""
    return frame[4]


def check_frame(frame: bytes) -> int:
    """Kind of the whole packet in `frame`. Raises RemoteProtocolError for a wrong checksum or a foreign version."""
    _, version, kind, length = _START.unpack_from(frame)
    if crc32(frame[:-CRC_BYTES]) != _CRC.unpack_from(frame, length - CRC_BYTES)[0]:
        raise RemoteProtocolError("packet with a wrong checksum")
    if version != VERSION and kind != ERROR.kind:
        raise RemoteProtocolError(f"far end speaks version {version} of the protocol, this is version {VERSION}")
    return int(kind)


def pack(shape: Layout, n: int, seq: int, ack: int, t_ns: int, *payload: Any, rest: bytes = b"") -> bytes:
    """Header, payload, rest (padded) and checksum."""
    rest += bytes(-len(rest) % 4)
    body = shape.struct(n)
    length = body.size + len(rest) + CRC_BYTES
    data = body.pack(MAGIC, VERSION, shape.kind, length, seq, ack, t_ns, *payload) + rest
    return data + _CRC.pack(crc32(data))


def unpack(shape: Layout, n: int, frame: bytes) -> tuple[Any, ...]:
    """Header and payload of a packet whose length is fixed by its joint count."""
    if len(frame) != shape.size(n):
        raise RemoteProtocolError(f"{shape.name} for {n} joints has {shape.size(n)} bytes, not {len(frame)}")
    return shape.struct(n).unpack_from(frame)


def unpack_with_rest(shape: Layout, frame: bytes) -> tuple[tuple[Any, ...], bytes]:
    """Header and payload of a packet that ends in a rest of any length, and that rest, padding included."""
    if len(frame) < shape.size(0):
        raise RemoteProtocolError(f"{shape.name} has at least {shape.size(0)} bytes, not {len(frame)}")
    body = shape.struct(0)
    # a rest field yields an empty string of its own, which is left out here
    return body.unpack_from(frame)[:-1], frame[body.size : -CRC_BYTES]


def joint_count(shape: Layout, frame: bytes) -> int:
    """The joint count, first byte of the payload in COMMAND and STATE."""
    n = frame[HEADER_BYTES] if len(frame) > HEADER_BYTES + CRC_BYTES else 0
    if not 1 <= n <= MAX_JOINTS:
        raise RemoteProtocolError(f"{shape.name} for {n} joints: 1 to {MAX_JOINTS} are possible")
    return n


def name_bytes(name: str) -> bytes:
    """A name for its field. Raises LocalProtocolError when it does not fit."""
    data = name.encode(errors="replace")
    if len(data) > NAME_BYTES or b"\0" in data:
        raise LocalProtocolError(f"name {name!r}: at most {NAME_BYTES} bytes of UTF-8, none of them 0")
    return data


def text_bytes(text: str) -> bytes:
    """A text for people, cut where it is too long, but not within a character."""
    cut = text.replace("\0", " ").encode(errors="replace")[:LONGEST_TEXT]
    return cut.decode(errors="ignore").encode()


def text_of(data: bytes) -> str:
    """Text up to the first 0, as C reads it, without control characters: it is printed, and stands in logs."""
    try:
        return printable(data.split(b"\0", 1)[0].decode())
    except UnicodeDecodeError as error:
        raise RemoteProtocolError("text that is not UTF-8") from error
