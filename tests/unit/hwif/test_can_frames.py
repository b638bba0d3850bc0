"""Frames of the CAN transport: what goes in comes out, what is torn is thrown away, what is late is not taken."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.errors import LocalProtocolError, RemoteProtocolError
from qrobot.hwif.canbus.frames import MAX_FRAMES, Collector, Mailbox, encode_image, encode_operations
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_INPUTS, IMAGE_T_NS, make_image
from qrobot.hwif.operations import OP_READ, OP_WRITE
from qrobot.hwif.registers import ADC_START, DAC, DISCRETE, N_DACS, N_INPUT_WORDS
from tests.support.bus import Row, rows_of
from tests.support.thorough import examples

offsets = st.integers(0, 31).map(lambda word: 2 * word)
operations = st.lists(
    st.one_of(
        st.tuples(st.just(OP_WRITE), offsets, st.integers(0, 0xFFFF)),
        st.tuples(st.just(OP_READ), offsets, st.just(0)),
    ),
    min_size=1,
    max_size=MAX_FRAMES,
)


def rows(taken: np.ndarray | None) -> list[tuple[int, ...]]:
    assert taken is not None
    return [tuple(row) for row in taken.tolist()]


@settings(max_examples=examples(50))
@given(operations)
def test_a_list_of_operations_survives_its_frames(wanted: list[Row]) -> None:
    mailbox = Mailbox()
    for frame in encode_operations(rows_of(wanted)):
        assert len(frame) == 8
        mailbox.put(frame)
    assert rows(mailbox.take()) == wanted
    assert mailbox.take() is None
    assert mailbox.torn == 0


@pytest.mark.parametrize("reads", [MAX_FRAMES, MAX_FRAMES + 1, 2 * MAX_FRAMES + 44])
def test_a_list_of_more_frames_than_can_be_counted_goes_as_several(reads: int) -> None:
    wanted = [(OP_READ, 2 * (k % 32), 0) for k in range(reads)]
    frames, mailbox, taken = encode_operations(rows_of(wanted)), Mailbox(), []
    for first in range(0, len(frames), MAX_FRAMES):
        for frame in frames[first : first + MAX_FRAMES]:
            mailbox.put(frame)
        taken += rows(mailbox.take())
    assert taken == wanted


def test_frames_without_a_sync_take_no_memory_without_end() -> None:
    mailbox = Mailbox()
    for _ in range(1000):
        mailbox.put(*encode_operations(rows_of([(OP_READ, ADC_START, 0)])))
    assert len(mailbox._rows) <= 1
    assert mailbox.take() is None


def test_all_converters_take_three_frames_and_a_read_one() -> None:
    writes = [(OP_WRITE, DAC + 2 * channel, 0x800) for channel in range(N_DACS)]
    assert len(encode_operations(rows_of(writes))) == 3
    assert len(encode_operations(rows_of([*writes, (OP_READ, ADC_START, 0), (OP_WRITE, DISCRETE, 1)]))) == 5


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_a_list_that_lost_a_frame_is_thrown_away_whole(lost: int) -> None:
    frames = encode_operations(rows_of([(OP_WRITE, DAC + 2 * channel, channel) for channel in range(N_DACS)]))
    mailbox = Mailbox()
    for i, frame in enumerate(frames):
        if i != lost:
            mailbox.put(frame)
    assert mailbox.take() is None
    assert mailbox.torn == 1


def test_two_lists_without_a_sync_between_them_are_none() -> None:
    """Their client has gone in the middle and come again."""
    mailbox = Mailbox()
    for _ in range(2):
        mailbox.put(*encode_operations(rows_of([(OP_WRITE, DAC, 1)])))
    assert mailbox.take() is None
    assert mailbox.torn == 1


@pytest.mark.parametrize("offset", [1, -2, 0x40])
def test_an_offset_outside_the_window_is_refused_before_anything_is_sent(offset: int) -> None:
    with pytest.raises(LocalProtocolError, match=f"offset {offset}"):
        encode_operations(rows_of([(OP_WRITE, offset, 1)]))


def test_a_frame_of_another_length_is_none() -> None:
    with pytest.raises(RemoteProtocolError, match="8 bytes, not 7"):
        Mailbox().put(bytes(7))
    with pytest.raises(RemoteProtocolError, match="TPDO 2"):
        Collector(1).put(1, bytes(9))


def example_image() -> np.ndarray:
    image = make_image()
    image[IMAGE_T_NS], image[IMAGE_COUNT] = 0x123456789ABCDE, 0x1FFFE
    image[IMAGE_INPUTS : IMAGE_INPUTS + N_INPUT_WORDS] = np.arange(N_INPUT_WORDS) + 0xFF00
    image[[IMAGE_INPUTS + 7, IMAGE_INPUTS + 15]] = 0  # no register there, and one whose value means nothing
    return image


def test_an_image_survives_its_five_frames_and_its_count_goes_on_beyond_sixteen_bits() -> None:
    image = example_image()
    answer = Collector(77)
    for number, frame in enumerate(encode_image(image, 77, 5)):
        assert not answer.whole
        answer.put(number, frame)
    assert answer.whole
    assert answer.lists == 5
    near = make_image()
    near[IMAGE_COUNT] = 0x1FFF0
    answer.fill(near)
    assert near.tolist() == image.tolist()


def test_frames_that_answer_another_sync_are_no_answer() -> None:
    answer = Collector(2)
    for number, frame in enumerate(encode_image(example_image(), 1, 0)):
        answer.put(number, frame)
    assert not answer.whole
    for number, frame in enumerate(encode_image(example_image(), 2, 0)):
        answer.put(number, frame)
    assert answer.whole
