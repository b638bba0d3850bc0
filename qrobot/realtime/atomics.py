"""Acquire loads, release stores, undivided steps and fences on int64 words of several threads and processes.

A word is an element of an array, `load_acquire(words, 3)`, or a field of a record, `load_acquire(lane, "head")`.

Numba hoists plain array loads out of spin loops and has no fences, so a mailbox written with plain indexing reads stale
or torn data. These intrinsics become single LLVM atomic instructions. With the JIT off they are plain accesses, which
is right for one thread.

None of them orders a store before a later load, which no lock-free structure here needs: on x86 they are free, where a
full fence waits until every store before it has reached the cache.
"""
# ruff: noqa: ARG001 (Numba fixes the signatures of intrinsics)

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from qrobot.realtime.jit import jit_disabled

WORD_BYTES = 8

if jit_disabled():

    def load_acquire(place: Any, key: int | str) -> int:
        """Value of `place[key]`; no later read moves before it."""
        return int(getattr(place, key) if isinstance(key, str) else place[key])

    def store_release(place: Any, key: int | str, value: int) -> None:
        """Set `place[key]`; no earlier write moves after it."""
        if isinstance(key, str):
            setattr(place, key, value)
        else:
            place[key] = value

    def raise_by_one(place: Any, key: int | str) -> None:
        """Raise `place[key]` by one, in one step; no earlier write moves after it."""
        store_release(place, key, load_acquire(place, key) + 1)

    def acquire_fence() -> None:
        """No access after it moves before a read that stands before it; nothing to do for one interpreter thread."""

    def release_fence() -> None:
        """No write after it moves before an access that stands before it; nothing to do for one interpreter thread."""

    def exchange(array: Any, index: int, value: int) -> int:
        """Put `value` into `array[index]` and return what stood there, in one step."""
        before = int(array[index])
        array[index] = value
        return before

else:

    def _pointer_to(context: Any, builder: Any, signature: Any, place: Any, key: Any) -> Any:
        """The address of an element of an array, or of a field of a record."""
        kind, key_type = signature.args[:2]
        if isinstance(kind, types.Record):
            data = builder.bitcast(place, ir.IntType(8).as_pointer())
            field = builder.gep(data, [ir.Constant(ir.IntType(64), kind.offset(key_type.literal_value))])
            return builder.bitcast(field, ir.IntType(64).as_pointer())
        return builder.gep(context.make_array(kind)(context, builder, place).data, [key])

    def _key_type(place: Any, key: Any) -> Any:
        """Type of a key; None, which refuses the call, for a field that is no int64, or an element that is none."""
        if isinstance(place, types.Record):
            named = isinstance(key, types.StringLiteral) and key.literal_value in place.fields
            return key if named and place.typeof(key.literal_value) == types.int64 else None
        return types.intp if isinstance(place, types.Array) and place.dtype == types.int64 else None

    @intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
    def load_acquire(typing_context: Any, place: Any, key: Any) -> Any:
        """Value of `place[key]`; no later read moves before it."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.load_atomic(
                _pointer_to(context, builder, signature, args[0], args[1]), "acquire", WORD_BYTES
            )

        key_type = _key_type(place, key)
        return None if key_type is None else (types.int64(place, key_type), codegen)

    @intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
    def store_release(typing_context: Any, place: Any, key: Any, value: Any) -> Any:
        """Set `place[key]`; no earlier write moves after it."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = _pointer_to(context, builder, signature, args[0], args[1])
            builder.store_atomic(args[2], pointer, "release", WORD_BYTES)
            return context.get_dummy_value()

        key_type = _key_type(place, key)
        return None if key_type is None else (types.void(place, key_type, types.int64), codegen)

    @intrinsic(prefer_literal=True)  # type: ignore[untyped-decorator]
    def raise_by_one(typing_context: Any, place: Any, key: Any) -> Any:
        """Raise `place[key]` by one, in one step; no earlier write moves after it."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = _pointer_to(context, builder, signature, args[0], args[1])
            builder.atomic_rmw("add", pointer, ir.Constant(ir.IntType(64), 1), "release")
            return context.get_dummy_value()

        key_type = _key_type(place, key)
        return None if key_type is None else (types.void(place, key_type), codegen)

    @intrinsic  # type: ignore[untyped-decorator]
    def exchange(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
        """Put `value` into `array[index]`, int64 or int32, and return what stood there, in one step that no access
        passes."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = _pointer_to(context, builder, signature, args[0], args[1])
            value = builder.trunc(args[2], ir.IntType(signature.args[0].dtype.bitwidth))
            return builder.sext(builder.atomic_rmw("xchg", pointer, value, "seq_cst"), ir.IntType(64))

        return types.int64(array, types.intp, types.int64), codegen

    def _fence(ordering: str) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            builder.fence(ordering)
            return context.get_dummy_value()

        return types.void(), codegen

    @intrinsic  # type: ignore[untyped-decorator]
    def acquire_fence(typing_context: Any) -> Any:
        """No access after it moves before a read that stands before it."""
        return _fence("acquire")

    @intrinsic  # type: ignore[untyped-decorator]
    def release_fence(typing_context: Any) -> Any:
        """No write after it moves before an access that stands before it."""
        return _fence("release")
