"""The Modbus map: derived from the register table, every number back as it went, garbage refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.errors import RemoteProtocolError
from qrobot.hwif.bus import BoardFacts
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_T_NS, make_image
from qrobot.hwif.modbus.map import (
    BOARD_ROWS,
    FIRST_WRITTEN,
    IDENTITY,
    IMAGE,
    IMAGE_REGISTERS,
    MAILBOX_REGISTERS,
    MAX_JOINTS,
    MAX_OPERATIONS,
    MAX_READ,
    MAX_READ_WRITE,
    ROBOT_ROWS,
    VECTORS,
    decode_identity,
    decode_image,
    decode_operations,
    encode_identity,
    encode_image,
    encode_operations,
    written,
)
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import DAC, REGISTERS, WINDOW_BYTES, Access
from qrobot.servo.memory import servo_memory
from tests.support.thorough import examples

words = st.integers(0, 0xFFFF)
operations = st.lists(
    st.tuples(st.sampled_from((0, 1)), st.integers(0, WINDOW_BYTES // 2 - 1).map(lambda i: 2 * i), words),
    max_size=MAX_OPERATIONS,
)


def test_every_register_of_the_board_stands_at_half_its_offset_and_is_written_only_where_the_board_is() -> None:
    rows = {row.name: row for row in BOARD_ROWS}
    for register in REGISTERS:
        row = rows[register.name]
        assert (row.address, row.count) == (register.offset // 2, register.count)
        assert ("write" in row.access) == (register.access is Access.WRITE)
        assert (row.address >= FIRST_WRITTEN) == (register.access is Access.WRITE)


def test_no_two_rows_of_the_map_share_a_register() -> None:
    ends = 0
    for row in sorted(BOARD_ROWS + ROBOT_ROWS, key=lambda row: row.address):
        assert row.address >= ends, row.name
        ends = row.address + row.count


def test_an_exchange_fits_into_one_request() -> None:
    assert MAILBOX_REGISTERS <= MAX_READ_WRITE
    assert IMAGE_REGISTERS + 1 <= MAX_READ


def test_the_map_has_room_for_every_joint_a_servo_can_have() -> None:
    assert MAX_JOINTS == servo_memory.MAX_JOINTS
    assert ROBOT_ROWS[-1].address + ROBOT_ROWS[-1].count == VECTORS + 4 * 2 * MAX_JOINTS


@settings(max_examples=examples(30))
@given(st.integers(0, 2**63 - 1), st.integers(0, 2**63 - 1), st.lists(words, min_size=16, max_size=16))
def test_an_image_comes_back_as_it_went(t_ns: int, count: int, inputs: list[int]) -> None:
    image, back = make_image(), make_image()
    image[:] = [t_ns, count, *inputs]
    decode_image(encode_image(image), back)
    assert back.tolist() == image.tolist()


def test_the_most_significant_word_has_the_lowest_address() -> None:
    image = make_image()
    image[IMAGE_T_NS], image[IMAGE_COUNT] = 0x0001_0002_0003_0004, 7
    assert encode_image(image)[:8] == [1, 2, 3, 4, 0, 0, 0, 7]
    assert IMAGE + len(encode_image(image)) <= IDENTITY


@settings(max_examples=examples(30))
@given(words, operations)
def test_operations_come_back_as_they_went(sequence: int, rows: list[tuple[int, int, int]]) -> None:
    sent = np.array(rows, np.int64).reshape(-1, 3)
    registers = encode_operations(sequence, sent)
    assert registers[0] == sequence
    assert decode_operations(registers[1:]).tolist() == sent.tolist()


@settings(max_examples=examples(50))
@given(st.lists(words, min_size=1, max_size=MAILBOX_REGISTERS))
def test_a_mailbox_of_garbage_is_refused_or_holds_operations_of_the_board(registers: list[int]) -> None:
    try:
        rows = decode_operations(registers).tolist()
    except RemoteProtocolError:
        return
    assert len(rows) == registers[0]
    assert all(kind in (0, 1) and offset % 2 == 0 and offset < WINDOW_BYTES for kind, offset, _ in rows)


def test_registers_written_together_are_written_in_the_order_of_addresses() -> None:
    assert written(DAC // 2, [5, 6]).tolist() == [[OP_WRITE, DAC, 5], [OP_WRITE, DAC + 2, 6]]


@pytest.mark.parametrize("facts", [BoardFacts("E", 6), BoardFacts("F", 3, 1_000_000)])
def test_a_board_says_what_it_is(facts: BoardFacts) -> None:
    assert decode_identity(encode_identity(facts)) == facts


@pytest.mark.parametrize(
    ("register", "value", "says"),
    [(0, 0, "no board of ours"), (2, 99, "map has version 99"), (3, ord("G"), "no revision 'G'")],
)
def test_what_is_no_board_of_ours_is_told(register: int, value: int, says: str) -> None:
    registers = encode_identity(BoardFacts("F", 6))
    registers[register] = value
    with pytest.raises(RemoteProtocolError, match=says):
        decode_identity(registers)
