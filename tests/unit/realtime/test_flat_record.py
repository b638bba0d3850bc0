"""Bundles as records, and records as blocks: one memory, the same fields."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest

from qrobot.realtime.flat_record import block_of, record_of
from qrobot.realtime.jit import lean_kernel


class Inner(NamedTuple):
    gain: float
    words: Any


class Outer(NamedTuple):
    inner: Inner
    vector: Any


def outer() -> Any:
    return record_of(Outer(Inner(2.5, np.arange(3)), np.array([1.0, 2.0])))


@lean_kernel
def scale(block: Any) -> None:
    record = block[0]
    for j in range(record.vector.size):
        record.vector[j] *= record.inner.gain
    record.inner.words[0] = 7


def test_a_record_has_the_fields_of_its_bundle_as_copies() -> None:
    vector = np.array([1.0, 2.0])
    record = record_of(Outer(Inner(2.5, np.arange(3)), vector))
    vector[0] = 9.0
    assert record.vector.tolist() == [1.0, 2.0]
    assert (record.inner.gain, record.inner.words.tolist()) == (2.5, [0, 1, 2])


def test_what_a_kernel_does_to_a_block_is_seen_in_the_record() -> None:
    record = outer()
    scale(block_of(record))
    assert record.vector.tolist() == [2.5, 5.0]
    assert record.inner.words.tolist() == [7, 1, 2]


def test_records_of_equal_bundles_have_one_type_by_which_calls_find_their_code() -> None:
    assert outer().dtype is outer().dtype
    assert block_of(outer()).dtype is block_of(outer()).dtype
    assert record_of(Outer(Inner(2.5, np.arange(4)), np.array([1.0, 2.0]))).dtype != outer().dtype


def test_a_block_keeps_its_record_alive() -> None:
    block = block_of(outer())
    assert block[0].vector.tolist() == [1.0, 2.0]
    assert block.nbytes == outer().nbytes


def test_a_field_that_a_numpy_method_would_hide_from_the_interpreter_is_refused() -> None:
    class Hidden(NamedTuple):
        sum: Any

    with pytest.raises(AssertionError, match="'sum' is a method"):
        record_of(Hidden(np.zeros(2)))
