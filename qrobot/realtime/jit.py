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


def kernel(function: F) -> F:
    """Compile `function` lazily for the cycle; the plain function stays reachable as `.py_func`."""
    compiled: F = numba.njit(cache=True, nogil=True, error_model="numpy")(function)
    return compiled


def jit_disabled() -> bool:
    """True when kernels run as plain Python (NUMBA_DISABLE_JIT=1)."""
    return bool(numba.config.DISABLE_JIT)
