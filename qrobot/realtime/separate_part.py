"""Parts of a program with machine code of their own, which every program that calls them shares.

A kernel takes in all it calls. The stages of a servo cycle are called by several loops, that of the servo and that of
lock-step for example, and each loop would compile all of them again, front end and optimiser. A *part* is compiled
once: its callers know its name alone, and the loader joins them. So two processes can each compile some of the parts
of a program, and a loop that is new to a machine compiles little besides itself. The price is a call that cannot be
inlined; a stage is called once in a cycle.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import llvmlite.binding as llvm
from numba import types

from qrobot.realtime.compile_progress import end_part


@dataclass(frozen=True)
class Part:
    """Record of a part of a program in the cache beside it; to call it is to have the part loaded.

    Attributes:
        module, kernel: where the part stands. arguments: its types. symbol: its name in the program's machine code.
    """

    module: str
    kernel: str
    arguments: tuple[Any, ...]
    symbol: str

    def __call__(self) -> None:
        """Load the part, or compile it; it may bear another name when it was compiled after the program."""
        entry: Any = getattr(sys.modules.get(self.module) or import_module(self.module), self.kernel)
        entry.compile(self.arguments)
        result = entry.overloads[self.arguments]
        name = result.fndesc.llvm_func_name
        if name != self.symbol:
            llvm.add_symbol(self.symbol, result.library.get_pointer_to_function(name))


def parts_in(library: Any) -> Iterator[Part]:
    """The part whose code a library is, if any."""
    if part := getattr(library, "part", None):
        yield part


def stand_apart(entry: Any, told_below: Callable[[Any], set[str]]) -> None:
    """Let kernels that call `entry` link nothing of it but its name. `told_below`: names of the kernels it takes in."""
    compile_now, template = entry.compile, entry.get_call_template

    def compile(signature: Any) -> Any:
        compiled = compile_now(signature)
        for arguments, result in entry.overloads.items():
            _leave_out(result, Part(entry.py_func.__module__, entry.py_func.__name__, arguments, _symbol_of(result)))
        end_part(told_below(entry.py_func))
        return compiled

    entry.callee, entry.compile = lambda: entry, compile
    entry.get_call_template = lambda args, kws: template(tuple(map(types.unliteral, args)), kws)


def _symbol_of(result: Any) -> str:
    return str(result.fndesc.llvm_func_name)


def _leave_out(result: Any, part: Part) -> None:
    """Let whoever links the library of `result` take in nothing."""
    result.library.part = part
    result.library._shared_module = llvm.parse_assembly("")
