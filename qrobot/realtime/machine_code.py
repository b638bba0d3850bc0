"""Machine code of a kernel, taken out in one process and loaded in another one.

Whoever loads it neither compiles nor runs any Python of the kernel's author. Each piece of code gets an execution
engine of its own, so that names in it meet only names of Numba's run time, never those of another version of the same
kernel. Code is for the processor and the versions of Numba and LLVM it was made with: it is never kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import llvmlite.binding as llvm
from numba import njit
from numba.core.registry import cpu_target
from numba.core.runtime import rtsys

from qrobot.errors import CodegenError


@dataclass(frozen=True)
class MachineCode:
    """Compiled code as bytes.

    Attributes:
        entry: symbol of the function, of C's calling convention.
        code: an object file.
    """

    entry: str
    code: bytes


def compile_for_export(function: Callable[..., Any], signature: Any) -> tuple[Callable[..., Any], MachineCode]:
    """Compile a plain Python function for `signature`: what runs it here, and its code for another process.

    Raises Numba's errors when it does not compile.
    """
    compiled: Any = njit(nogil=True, error_model="numpy")(function)  # not cached: cached code cannot be taken out again
    compiled.compile(signature)
    result = compiled.get_compile_result(signature)
    _, _, (code, _) = result.library.serialize_using_object_code()
    return compiled, MachineCode(result.fndesc.llvm_cfunc_wrapper_name, code)


class LoadedCode:
    """Machine code in this process, for as long as this object lives. Raises CodegenError when it cannot be loaded."""

    def __init__(self, code: MachineCode) -> None:
        context = cpu_target.target_context
        context.refresh()  # names the symbols of Numba's run time that the code may call
        rtsys.initialize(context)
        machine = llvm.Target.from_default_triple().create_target_machine(jit=True)
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
        try:
            self._engine.add_object_file(llvm.ObjectFileRef.from_data(code.code))
        except RuntimeError as error:
            raise CodegenError(f"machine code cannot be loaded: {error}") from error
        self._engine.finalize_object()
        self._entry = code.entry

    @cached_property
    def address(self) -> int:
        """Address of the function. Raises CodegenError when the code has none of that name."""
        address = int(self._engine.get_function_address(self._entry))
        if address == 0:
            raise CodegenError(f"machine code has no function {self._entry}")
        return address
