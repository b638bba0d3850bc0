"""The one set of options under which everything in the cycle is compiled.

`cache` starts warm from disk, `nogil` lets Python threads run beside the loop, `error_model="numpy"` makes a division
by zero an infinity instead of an exception (the guard catches it), and no fast-math keeps runs bit-identical.
With NUMBA_DISABLE_JIT=1 a kernel is the plain Python function: the oracle of the tests.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

import numba

from qrobot.realtime.cache_folders import KernelCache
from qrobot.realtime.compile_once import compile_once
from qrobot.realtime.compiled_files import keep_in_files
from qrobot.realtime.source_digest import source_stamp
from qrobot.realtime.whole_program import EntryCompiler, separate, split

F = TypeVar("F", bound=Callable[..., Any])
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}


def _compile(function: F, halves: Callable[[Any], None] = split, **extra: Any) -> F:
    options: dict[str, Any] = _OPTIONS | extra | {"pipeline_class": EntryCompiler}
    compiled: F = numba.njit(**options)(function)
    _keep(compiled, Path(function.__code__.co_filename))
    if not jit_disabled():
        compile_once(compiled)
        halves(compiled)
    return compiled


def _keep(compiled: Any, path: Path) -> None:
    """Let code be kept, and the cached code go stale with everything it was made of.

    A notebook or a prompt has no source file: what is typed there is compiled anew.
    """
    if not jit_disabled():
        with suppress(RuntimeError, OSError):
            keep_in_files(compiled, KernelCache(compiled.py_func), source_stamp(path))


def kernel(function: F) -> F:
    """Compile `function` lazily for the cycle; the plain function stays reachable as `.py_func`."""
    return _compile(function)


def lean_kernel(function: F) -> F:
    """A `kernel` that neither allocates nor counts references: for what runs at every tick.

    A kernel counts references on every array it takes out of a NamedTuple or hands on, two locked instructions each;
    in a tick made of small functions that is most of the time. Here nothing is counted: whoever calls from Python holds
    the arrays anyway. In return the compiler refuses a function that would allocate (a new array, a list, a string).
    """
    return _compile(function, _nrt=False)


def part_kernel(function: F) -> F:
    """A `lean_kernel` with machine code of its own, of a module: what is large and called by several loops."""
    return _compile(function, separate, _nrt=False)


def jit_disabled() -> bool:
    """True when kernels run as plain Python (NUMBA_DISABLE_JIT=1)."""
    return bool(numba.config.DISABLE_JIT)
