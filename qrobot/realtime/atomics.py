"""Acquire loads, release stores and fences on int64 arrays, for memory shared between threads and processes.

Numba hoists plain array loads out of spin loops and has no fences, so a mailbox written with plain indexing reads stale
or torn data. These intrinsics become single LLVM atomic instructions. With the JIT off they are plain accesses, which
is right for one thread.

None of them orders a store before a later load, which no lock-free structure here needs: on x86 they are free, where a
full fence waits until every store before it has reached the cache.
"""
# ruff: noqa: ARG001 (Numba fixes the signatures of intrinsics)

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import intrinsic

from qrobot.realtime.jit import jit_disabled

WORD_BYTES = 8

if jit_disabled():

    def load_acquire(array: Any, index: int) -> int:
        """Value of `array[index]`; no later read moves before it."""
        return int(array[index])

    def store_release(array: Any, index: int, value: int) -> None:
        """Set `array[index]`; no earlier write moves after it."""
        array[index] = value

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

    def _element_pointer(context: Any, builder: Any, array_type: Any, array: Any, index: Any) -> Any:
        data = context.make_array(array_type)(context, builder, array).data
        return builder.gep(data, [index])

    @intrinsic  # type: ignore[untyped-decorator]
    def load_acquire(typing_context: Any, array: Any, index: Any) -> Any:
        """Value of `array[index]`; no later read moves before it."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = _element_pointer(context, builder, signature.args[0], args[0], args[1])
            return builder.load_atomic(pointer, "acquire", WORD_BYTES)

        return types.int64(array, types.intp), codegen

    @intrinsic  # type: ignore[untyped-decorator]
    def store_release(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
        """Set `array[index]`; no earlier write moves after it."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = _element_pointer(context, builder, signature.args[0], args[0], args[1])
            builder.store_atomic(args[2], pointer, "release", WORD_BYTES)
            return context.get_dummy_value()

        return types.void(array, types.intp, types.int64), codegen

    @intrinsic  # type: ignore[untyped-decorator]
    def exchange(typing_context: Any, array: Any, index: Any, value: Any) -> Any:
        """Put `value` into `array[index]` and return what stood there, in one step that no access passes."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = _element_pointer(context, builder, signature.args[0], args[0], args[1])
            return builder.atomic_rmw("xchg", pointer, args[2], "seq_cst")

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
