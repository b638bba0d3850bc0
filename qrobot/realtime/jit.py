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


def kernel(function: F) -> F:
    """Compile `function` lazily for the cycle; the plain function stays reachable as `.py_func`."""
    compiled: F
    try:
        compiled = numba.njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:  # no source file to keep a cache beside: a notebook or a prompt
        compiled = numba.njit(**_OPTIONS)(function)
    return compiled


def jit_disabled() -> bool:
    """True when kernels run as plain Python (NUMBA_DISABLE_JIT=1)."""
    return bool(numba.config.DISABLE_JIT)
