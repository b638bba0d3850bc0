"""CLOCK_MONOTONIC from compiled code: read it, sleep to an absolute deadline, pause inside a spin.

Only the monotonic clock is ever used for control: a jump of the wall clock has no effect. The C calls are resolved by
name at link time, so kernels that use them stay cacheable. With the JIT off the `time` module serves.
"""
# ruff: noqa: ARG001 (Numba fixes the signatures of intrinsics)

from __future__ import annotations

import platform
import time
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from qrobot.realtime.jit import jit_disabled
from qrobot.units import NS_PER_S

_CLOCK_MONOTONIC = 1
_TIMER_ABSTIME = 1

if jit_disabled():

    def monotonic_ns() -> int:
        """CLOCK_MONOTONIC in nanoseconds."""
        return time.monotonic_ns()

    def sleep_until_ns(deadline_ns: int) -> None:
        """Sleep until CLOCK_MONOTONIC reaches `deadline_ns`; returns at once when it has passed."""
        time.sleep(max(0.0, (deadline_ns - time.monotonic_ns()) / NS_PER_S))

    def pause() -> None:
        """Hint to the processor that this is a spin loop."""

else:
    _I32, _I64 = ir.IntType(32), ir.IntType(64)
    _TIMESPEC = ir.ArrayType(_I64, 2)
    _HAS_PAUSE = platform.machine() in ("x86_64", "AMD64")

    def _timespec_field(builder: Any, timespec: Any, index: int) -> Any:
        return builder.gep(timespec, [_I32(0), _I32(index)])

    @intrinsic  # type: ignore[untyped-decorator]
    def monotonic_ns(typing_context: Any) -> Any:
        """CLOCK_MONOTONIC in nanoseconds."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            timespec = cgutils.alloca_once(builder, _TIMESPEC)
            prototype = ir.FunctionType(_I32, [_I32, _TIMESPEC.as_pointer()])
            function = cgutils.get_or_insert_function(builder.module, prototype, "clock_gettime")
            builder.call(function, [_I32(_CLOCK_MONOTONIC), timespec])
            seconds = builder.load(_timespec_field(builder, timespec, 0))
            nanoseconds = builder.load(_timespec_field(builder, timespec, 1))
            return builder.add(builder.mul(seconds, _I64(NS_PER_S)), nanoseconds)

        return types.int64(), codegen

    @intrinsic  # type: ignore[untyped-decorator]
    def sleep_until_ns(typing_context: Any, deadline_ns: Any) -> Any:
        """Sleep until CLOCK_MONOTONIC reaches `deadline_ns`, or a signal arrives; at once when it has passed."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            timespec = cgutils.alloca_once(builder, _TIMESPEC)
            builder.store(builder.sdiv(args[0], _I64(NS_PER_S)), _timespec_field(builder, timespec, 0))
            builder.store(builder.srem(args[0], _I64(NS_PER_S)), _timespec_field(builder, timespec, 1))
            pointer = _TIMESPEC.as_pointer()
            prototype = ir.FunctionType(_I32, [_I32, _I32, pointer, pointer])
            function = cgutils.get_or_insert_function(builder.module, prototype, "clock_nanosleep")
            builder.call(function, [_I32(_CLOCK_MONOTONIC), _I32(_TIMER_ABSTIME), timespec, pointer(None)])
            return context.get_dummy_value()

        return types.void(types.int64), codegen

    @intrinsic  # type: ignore[untyped-decorator]
    def pause(typing_context: Any) -> Any:
        """Hint to the processor that this is a spin loop; nothing on machines other than x86-64."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            if _HAS_PAUSE:
                prototype = ir.FunctionType(ir.VoidType(), [])
                builder.call(cgutils.get_or_insert_function(builder.module, prototype, "llvm.x86.sse2.pause"), [])
            return context.get_dummy_value()

        return types.void(), codegen
