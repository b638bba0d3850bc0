"""The four instructions of port input and output, for compiled code on x86-64.

The processor faults on them (the kernel sends SIGSEGV) unless the thread was granted the ports: `permission.py`.
Elsewhere, and with the JIT off, there are no ports: reads give all ones, as of an empty bus, and writes go nowhere.
"""
# ruff: noqa: ARG001 (Numba fixes the signatures of intrinsics)

from __future__ import annotations

import platform
from typing import Any, Final

from numba import types
from numba.extending import intrinsic

from qrobot.realtime.jit import jit_disabled

HAS_PORTS: Final = platform.machine() in ("x86_64", "AMD64") and not jit_disabled()

if not HAS_PORTS:

    def in_byte(port: int) -> int:
        """Read eight bits at `port`."""
        return 0xFF

    def in_word(port: int) -> int:
        """Read sixteen bits at `port`."""
        return 0xFFFF

    def out_byte(port: int, value: int) -> None:
        """Write eight bits at `port`."""

    def out_word(port: int, value: int) -> None:
        """Write sixteen bits at `port`."""

else:
    from llvmlite import binding, ir

    binding.initialize_native_asmparser()  # Numba itself needs none; without it LLVM aborts the process
    _PORT: Final = ir.IntType(16)

    def _in(bits: int, assembly: str, register: str) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            function = ir.FunctionType(ir.IntType(bits), [_PORT])
            port = builder.trunc(args[0], _PORT)
            constraint = f"={{{register}}},{{dx}},~{{memory}}"
            return builder.zext(builder.asm(function, assembly, constraint, [port], True), ir.IntType(64))

        return types.int64(types.int64), codegen

    def _out(bits: int, assembly: str, register: str) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            function = ir.FunctionType(ir.VoidType(), [_PORT, ir.IntType(bits)])
            operands = [builder.trunc(args[0], _PORT), builder.trunc(args[1], ir.IntType(bits))]
            builder.asm(function, assembly, f"{{dx}},{{{register}}},~{{memory}}", operands, True)
            return context.get_dummy_value()

        return types.void(types.int64, types.int64), codegen

    @intrinsic  # type: ignore[untyped-decorator]
    def in_byte(typing_context: Any, port: Any) -> Any:
        """Read eight bits at `port`."""
        return _in(8, "inb %dx, %al", "al")

    @intrinsic  # type: ignore[untyped-decorator]
    def in_word(typing_context: Any, port: Any) -> Any:
        """Read sixteen bits at `port`."""
        return _in(16, "inw %dx, %ax", "ax")

    @intrinsic  # type: ignore[untyped-decorator]
    def out_byte(typing_context: Any, port: Any, value: Any) -> Any:
        """Write eight bits at `port`."""
        return _out(8, "outb %al, %dx", "al")

    @intrinsic  # type: ignore[untyped-decorator]
    def out_word(typing_context: Any, port: Any, value: Any) -> Any:
        """Write sixteen bits at `port`."""
        return _out(16, "outw %ax, %dx", "ax")
