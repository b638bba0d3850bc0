"""A bundle of arrays and numbers as one block of memory, handed to compiled code as a single pointer.

A tuple of arrays reaches a kernel as seven machine words per array, copied from call to call; with a few dozen
arrays that dominates the time to compile and costs in every call (measured: a servo cycle of 1.2 us against 0.37 us).
`record_of` lays the same fields out in one NumPy record: kernels read `bundle.field` as before, lengths are part of the
type, and loops over joints unroll.

Records in shared memory have the same kind of type (`realtime.structure`). `words_of` shows one as words,
`copy_fields` copies by name, `float_bits` makes a word of a float bit by bit.
"""

# ruff: noqa: ARG001 (Numba fixes the signatures of intrinsics)

from __future__ import annotations

import struct
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array
from numba.np.numpy_support import as_dtype
from numpy.typing import NDArray

from qrobot.arrays import Words
from qrobot.realtime.jit import jit_disabled
from qrobot.realtime.structure import WORD_BYTES, record_type, view_words

Bundle = TypeVar("Bundle")


def record_of(bundle: Bundle) -> Bundle:
    """A copy of arrays, numbers and further bundles as one NumPy record with the same fields.

    A bundle is a NamedTuple, of what never changes, or a dataclass, whose numbers kernels may assign to. Array fields
    of the record are views of its memory.
    """
    record = np.zeros(1, dtype=record_type(_dtype_of(bundle))).view(np.recarray)
    _fill(record[0], bundle)
    kept: Any = record[0]
    return kept  # type: ignore[no-any-return]


def block_of(record: Any) -> NDArray[Any]:
    """A record of `record_of` as an array of one, in the same memory: a kernel called from Python takes `block[0]`.

    A call spends ten microseconds on a record, because its buffer spells out all its fields, and half of one on this.
    """
    block: NDArray[Any] = record.base
    return block if jit_disabled() else block.view(np.ndarray)  # the interpreter needs items with attributes


def _is_bundle(value: Any) -> bool:
    return is_dataclass(value) or (isinstance(value, tuple) and hasattr(value, "_fields"))


def _items(bundle: Any) -> list[tuple[str, Any]]:
    """Names and values of the fields of a bundle."""
    names = [field.name for field in fields(bundle)] if is_dataclass(bundle) else bundle._fields
    return [(name, getattr(bundle, name)) for name in names]


def _dtype_of(bundle: Any) -> np.dtype[Any]:
    columns: list[Any] = []
    for name, value in _items(bundle):
        assert not hasattr(np.record, name), f"{name!r} is a method of every NumPy record, which would hide the field"
        if _is_bundle(value):
            columns.append((name, _dtype_of(value)))
        elif isinstance(value, np.void):  # a record already
            columns.append((name, np.dtype((np.void, value.dtype))))
        else:
            array = np.asarray(value)
            kind = np.dtype(np.uint8) if array.dtype == np.bool_ else array.dtype  # Numba nests no arrays of bool
            columns.append((name, kind, array.shape))
    return np.dtype(columns, align=True)


def _fill(record: Any, bundle: Any) -> None:
    for name, value in _items(bundle):
        if _is_bundle(value):
            _fill(record[name], value)
        elif isinstance(value, np.void):
            view_words(record[name])[:] = view_words(value)
        else:
            record[name] = value


if jit_disabled():

    def float_bits(value: float) -> int:
        """The bit pattern of a float, as an int64."""
        return int(struct.unpack("<q", struct.pack("<d", value))[0])

    def words_of(record: Any) -> Words:
        """A record or part of one as an array of words, in the same memory."""
        return view_words(record)

    def copy_fields(source: Any, target: Any) -> None:
        """Give each field of `target` the value of the field of `source` that has its name."""
        for name in target.dtype.names:
            target[name] = getattr(source, name)

else:

    @intrinsic  # type: ignore[untyped-decorator]
    def float_bits(typing_context: Any, value: Any) -> Any:
        """The bit pattern of a float, as an int64."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.bitcast(args[0], context.get_value_type(types.int64))

        return types.int64(types.float64), codegen

    @intrinsic  # type: ignore[untyped-decorator]
    def words_of(typing_context: Any, record: Any) -> Any:
        """A record or part of one as an array of words, in the same memory."""
        array_type = types.Array(types.int64, 1, "C")

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            array = context.make_array(array_type)(context, builder)
            size, step = (
                context.get_constant(types.intp, number) for number in (record.size // WORD_BYTES, WORD_BYTES)
            )
            populate_array(
                array,
                data=builder.bitcast(args[0], ir.IntType(64).as_pointer()),
                shape=cgutils.pack_array(builder, [size]),
                strides=cgutils.pack_array(builder, [step]),
                itemsize=step,
                meminfo=None,
            )
            return array._getvalue()

        return array_type(record), codegen

    @intrinsic  # type: ignore[untyped-decorator]
    def copy_fields(typing_context: Any, source: Any, target: Any) -> Any:
        """Give each field of `target` the value of the field of `source` that has its name."""
        for name in target.fields:
            assert source.typeof(name) == target.typeof(name), f"{name!r} differs between the two"

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            byte = ir.IntType(8).as_pointer()
            start, end = (builder.bitcast(each, byte) for each in args)
            for name in target.fields:
                places = [(start, source.offset(name)), (end, target.offset(name))]
                here, there = (builder.gep(data, [ir.Constant(ir.IntType(64), at)]) for data, at in places)
                size = context.get_constant(types.intp, as_dtype(target.typeof(name)).itemsize)
                cgutils.raw_memcpy(builder, there, here, size, 1)
            return context.get_dummy_value()

        return types.void(source, target), codegen
