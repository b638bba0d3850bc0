"""The one set of options under which everything in the cycle is compiled.

`cache` starts warm from disk, `nogil` lets Python threads run beside the loop, `error_model="numpy"` makes a division
by zero an infinity instead of an exception (the guard catches it), and no fast-math keeps runs bit-identical.
With NUMBA_DISABLE_JIT=1 a kernel is the plain Python function: the oracle of the tests.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])
_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}


def _compile(function: F, **extra: Any) -> F:
    compiled: F
    try:
        compiled = numba.njit(cache=True, **_OPTIONS, **extra)(function)
    except RuntimeError:  # no source file to keep a cache beside: a notebook or a prompt
        compiled = numba.njit(**_OPTIONS, **extra)(function)
    return compiled


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


def jit_disabled() -> bool:
    """True when kernels run as plain Python (NUMBA_DISABLE_JIT=1)."""
    return bool(numba.config.DISABLE_JIT)
