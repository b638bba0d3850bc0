"""Processor time of the calling thread, and how often it gave the processor away, from compiled code.

Two system calls, some 0.5 us each: not for every cycle. A thread that waits, for a lock or a disk, gives the processor
away itself (`ru_nvcsw`, getrusage(2)); what the kernel, or the host of a virtual machine, takes from it is not counted.
With the JIT off modules of Python serve.
"""
# ruff: noqa: ARG001 (Numba fixes the signatures of intrinsics)

from __future__ import annotations

import resource
import time
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from qrobot.realtime.jit import jit_disabled
from qrobot.units import NS_PER_S

_CLOCK_THREAD_CPUTIME_ID = 3
_RUSAGE_THREAD = 1
_RUSAGE_WORDS, _RU_NVCSW = 18, 16  # struct rusage: two struct timeval, fourteen long, the last but one of which is ours

if jit_disabled():

    def thread_time() -> tuple[int, int]:
        """Nanoseconds of processor time, and times the processor was given away, since the thread began."""
        return time.thread_time_ns(), resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw

else:
    _I32, _I64 = ir.IntType(32), ir.IntType(64)

    def _called(builder: Any, name: str, number: int, n_words: int) -> list[Any]:
        """Words that a function of the C library writes, which takes a number and their address."""
        block = ir.ArrayType(_I64, n_words)
        words = cgutils.alloca_once(builder, block)
        prototype = ir.FunctionType(_I32, [_I32, block.as_pointer()])
        builder.call(cgutils.get_or_insert_function(builder.module, prototype, name), [_I32(number), words])
        return [builder.load(builder.gep(words, [_I32(0), _I32(index)])) for index in range(n_words)]

    @intrinsic  # type: ignore[untyped-decorator]
    def thread_time(typing_context: Any) -> Any:
        """Nanoseconds of processor time, and times the processor was given away, since the thread began."""

        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            seconds, nanoseconds = _called(builder, "clock_gettime", _CLOCK_THREAD_CPUTIME_ID, 2)
            used_ns = builder.add(builder.mul(seconds, _I64(NS_PER_S)), nanoseconds)
            given = _called(builder, "getrusage", _RUSAGE_THREAD, _RUSAGE_WORDS)[_RU_NVCSW]
            return context.make_tuple(builder, signature.return_type, [used_ns, given])

        return types.UniTuple(types.int64, 2)(), codegen
