"""Sequence numbers: RFC 1982 on 32 bits."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from qrobot.wire.sequence import Sequence, difference

U32 = st.integers(0, (1 << 32) - 1)


def sequence_at(seq: int) -> Sequence:
    sequence = Sequence()
    assert sequence.accept(seq)
    return sequence


@given(U32)
def test_any_number_may_come_first(seq: int) -> None:
    assert sequence_at(seq).newest == seq


@given(U32, st.integers(1, (1 << 31) - 1))
def test_a_number_less_than_half_the_circle_ahead_is_newer_also_across_the_wrap(seq: int, step: int) -> None:
    sequence = sequence_at(seq)
    assert sequence.accept((seq + step) % (1 << 32))
    assert sequence.newest == seq + step
    assert sequence.refused == 0


@given(U32, st.integers(-(1 << 31), 0))
def test_a_repeated_or_older_number_is_refused_and_counted(seq: int, step: int) -> None:
    sequence = sequence_at(seq)
    assert not sequence.accept((seq + step) % (1 << 32))
    assert (sequence.newest, sequence.refused) == (seq, 1)


@given(U32, st.integers(-(1 << 31), (1 << 31) - 1))
def test_a_number_lies_as_far_ahead_of_another_as_was_counted_between_them(seq: int, step: int) -> None:
    assert difference((seq + step) % (1 << 32), seq) == step


def test_the_count_goes_on_through_many_wraps() -> None:
    sequence = sequence_at(0)
    stride = (1 << 31) - 1
    for k in range(1, 20):
        assert sequence.accept(k * stride % (1 << 32))
    assert sequence.newest == 19 * stride
