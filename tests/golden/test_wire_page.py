"""The page a C programmer works from says what the codec does."""

from __future__ import annotations

import ctypes
import re
import struct
from math import nan
from pathlib import Path
from zlib import crc32

import pytest

from qrobot.wire import document
from qrobot.wire.codec import decode, encode
from qrobot.wire.document import EXAMPLE, refresh
from qrobot.wire.layout import HEADER_FIELDS, LAYOUTS, Field, Layout

PAGE = (Path(__file__).parents[2] / "docs/reference/wire-protocol.md").read_text()
C_NUMBERS = {
    "B": ctypes.c_uint8, "H": ctypes.c_uint16, "h": ctypes.c_int16, "I": ctypes.c_uint32, "q": ctypes.c_int64,
    "d": ctypes.c_double, "s": ctypes.c_char, "x": ctypes.c_uint8,
}  # fmt: skip


def test_the_page_is_fresh() -> None:
    assert refresh(PAGE) == PAGE, "run: python docs/refresh.py"


def test_a_stale_part_would_be_noticed() -> None:
    assert refresh(PAGE.replace("client HELLO", "client HALLO")) == PAGE
    with pytest.raises(KeyError):
        refresh("<!-- generated: poetry -->\n<!-- end -->")


def test_every_generated_part_is_on_the_page() -> None:
    assert set(re.findall("<!-- generated: ([a-z-]+) -->", PAGE)) == set(document.PARTS)


def dumped_bytes() -> bytes:
    dump = PAGE.split("## A packet byte by byte")[1].split("```text\n")[1].split("```")[0]
    return b"".join(bytes.fromhex(line[5:52]) for line in dump.splitlines())


def test_the_dump_on_the_page_is_the_packet_it_is_said_to_be() -> None:
    assert decode(dumped_bytes()) == EXAMPLE
    assert encode(EXAMPLE) == dumped_bytes()


def test_the_dump_can_be_written_by_hand_from_the_tables() -> None:
    body = struct.pack(
        "<4sBBHIIqBBHIII8d2d2BH", b"QROB", 3, 3, 128, 258, 258, 1000, 2, 0, 1, 1, 0, 0, *(nan,) * 8, 0.5, 0.0, 1, 0, 0
    )
    assert body + struct.pack("<I", crc32(body)) == dumped_bytes()


def c_struct(shape: Layout, n: int) -> type[ctypes.Structure]:
    """The struct as a C compiler lays it out: natural alignment, nothing packed."""

    def member(field: Field) -> tuple[str, type]:
        number = C_NUMBERS[field.code]
        return field.name, number if field.count == 1 else number * field.length(n)

    fields = [member(field) for field in HEADER_FIELDS + shape.fields if field.count != "rest"]
    return type(shape.name, (ctypes.LittleEndianStructure,), {"_fields_": [*fields, ("crc", ctypes.c_uint32)]})


@pytest.mark.parametrize("n", [1, 2, 5, 6, 7, 32])
@pytest.mark.parametrize("shape", LAYOUTS, ids=lambda shape: shape.name)
def test_a_c_compiler_finds_every_field_where_the_codec_puts_it(shape: Layout, n: int) -> None:
    struct_in_c = c_struct(shape, n)
    for offset, field in shape.rows(n):
        if field.count != "rest":
            assert getattr(struct_in_c, field.name).offset == offset
    assert struct_in_c.crc.offset == shape.size(n) - 4


def test_the_example_reads_the_same_through_the_c_struct() -> None:
    shape = next(shape for shape in LAYOUTS if shape.name == "COMMAND")
    seen = c_struct(shape, EXAMPLE.n).from_buffer_copy(dumped_bytes().ljust(256, b"\0"))
    assert (seen.magic, seen.length, seen.seq, seen.requests) == (b"QROB", 128, EXAMPLE.seq, 1)
    assert (tuple(seen.setpoint), tuple(seen.mode)) == (EXAMPLE.setpoints, EXAMPLE.modes)
