"""Structured types of shared memory: each block is a class whose attributes are its fields, in their order.

    class Lane:
        head = word(own_line=True)  # the producer's
        tail = word(own_line=True)  # the consumer's
        ring = part(Operation, 512, own_line=True)

`dtype_of` lays such a class out as a NumPy type of 64-bit fields, `record_in` shows the words of a memory as a record
of it: compiled code and Python alike read and assign `record.tail`, and atomics take a field by name
(`realtime.atomics`). A field on a cache line of its own does not slow down who writes the line before it; that is part
of the type, so nobody counts words. The base of a mapping is a page's, so lines of the type are lines of memory.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from qrobot.arrays import Words

WORD_BYTES: Final = 8
LINE_BYTES: Final = 64  # a cache line of x86-64 and of most of ARMv8

ArrayLength = int | str | tuple[int | str, ...]  # a name stands for a size that `dtype_of` is given

_RECORD_TYPES: Final[dict[np.dtype[Any], np.dtype[Any]]] = {}


@dataclass(frozen=True)
class StructureField:
    """A field as a class declares it: a number or a part, how many of them, and whether it begins a cache line."""

    item: Any
    length: ArrayLength | None
    own_line: bool


def word(own_line: bool = False) -> Any:
    """One int64."""
    return StructureField(np.int64, None, own_line)


def words(length: ArrayLength, own_line: bool = False) -> Any:
    """An array of int64."""
    return StructureField(np.int64, length, own_line)


def number(own_line: bool = False) -> Any:
    """One float64."""
    return StructureField(np.float64, None, own_line)


def floats(length: ArrayLength, own_line: bool = False) -> Any:
    """An array of float64."""
    return StructureField(np.float64, length, own_line)


def text(n_bytes: int, own_line: bool = False) -> Any:
    """UTF-8, filled up with zeros."""
    assert n_bytes % WORD_BYTES == 0
    return StructureField(np.dtype(f"S{n_bytes}"), None, own_line)


def part(kind: type, length: ArrayLength | None = None, own_line: bool = False) -> Any:
    """A block of another class, or an array of them."""
    return StructureField(kind, length, own_line)


def dtype_of(kind: type, **sizes: int) -> np.dtype[Any]:
    """The NumPy type of a block; `sizes` are the lengths that fields give by name. Raises KeyError without one."""
    names, formats, offsets, end = [], [], [], 0
    for name, column in columns_of(kind):
        assert not hasattr(np.record, name), f"{name!r} is a method of every NumPy record, which would hide the field"
        item = dtype_of(column.item, **sizes) if columns_of(column.item) else np.dtype(column.item)
        shape = _shape(column.length, sizes)
        offset = align(end) if column.own_line else end
        names.append(name)
        formats.append(np.dtype((item, shape)) if shape else item)
        offsets.append(offset)
        end = offset + formats[-1].itemsize
    if any(column.own_line for _, column in columns_of(kind)):
        end = align(end)  # so that it holds for every element of an array
    layout: Any = {"names": names, "formats": formats, "offsets": offsets, "itemsize": end}
    dtype: np.dtype[Any] = np.dtype(layout, align=True)
    return dtype


def columns_of(kind: Any) -> list[tuple[str, StructureField]]:
    """Names and fields of a block, those of the class it extends first; none for what is no block."""
    kinds = reversed(kind.__mro__) if isinstance(kind, type) else ()
    return [(name, value) for each in kinds for name, value in vars(each).items() if isinstance(value, StructureField)]


def align(offset: int) -> int:
    """The first byte of the cache line at or after `offset`."""
    return -(-offset // LINE_BYTES) * LINE_BYTES


def offset_of(dtype: np.dtype[Any], path: str) -> int:
    """Byte at which a field stands, such as that of "command.power"; "lanes[2].head" takes an element of an array.

    Raises KeyError for an unknown field.
    """
    offset = 0
    for step in path.replace("[", ".[").split("."):
        if step.startswith("["):
            dtype = dtype.base
            offset += int(step[1:-1]) * dtype.itemsize
        else:
            fields: Any = dtype.fields
            offset += fields[step][1]
            dtype = fields[step][0]
    return offset


def digest_of(dtype: np.dtype[Any]) -> int:
    """A number of 64 bits for names, places and formats of all fields: what is laid out otherwise has another."""
    text = "\n".join(_described(dtype))
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:WORD_BYTES], "little", signed=True)


def record_type(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """The type of records with these fields: the same object for all of them in this process.

    Numba knows the type of an argument by this object. Of an equal one it compares field by field in every call from
    Python: of a servo's records that takes 140 us, beside a cycle of 3.
    """
    made: np.dtype[Any] = np.dtype((np.record, dtype))
    return _RECORD_TYPES.setdefault(made, made)


def record_in(memory: Words, dtype: np.dtype[Any], start: int = 0) -> Any:
    """The words of a memory from `start` on as a record; both are the same memory."""
    size = dtype.itemsize // WORD_BYTES
    return memory[start : start + size].view(record_type(dtype)).view(np.recarray)[0]


def local_record(dtype: np.dtype[Any]) -> Any:
    """A record of zeros in this process's own memory."""
    return record_in(np.zeros(dtype.itemsize // WORD_BYTES, np.int64), dtype)


def view_words(record: Any) -> Words:
    """A record or part of one as an array of words, in the same memory; in kernels it is `flat_record.words_of`."""
    owner, at = record.base, _address_of(np.frombuffer(record, np.int64))
    while isinstance(owner.base, np.ndarray | np.void):
        owner = owner.base
    words: Words = owner.view(np.int64).reshape(-1)
    first = (at - _address_of(words)) // WORD_BYTES
    return words[first : first + record.dtype.itemsize // WORD_BYTES]


def _address_of(words: Words) -> int:
    """Address of plain words: a record that is asked for its own describes all its fields first, for up to 0.3 ms."""
    at: int = words.__array_interface__["data"][0]
    return at


def _shape(length: ArrayLength | None, sizes: dict[str, int]) -> tuple[int, ...]:
    if length is None:
        return ()
    steps = length if isinstance(length, tuple) else (length,)
    return tuple(sizes[step] if isinstance(step, str) else step for step in steps)


def _described(dtype: np.dtype[Any], path: str = "") -> Iterator[str]:
    """A line for each field and for each field of its parts."""
    fields: Any = dtype.fields or {}
    for name, (field, offset, *_) in fields.items():
        yield f"{path}{name} at {offset}: {field.base.str} {field.shape}"
        yield from _described(field.base, f"{path}{name}.")
