"""Answers of Numba that it works out anew at each use, remembered while the program runs.

A cycle has ten thousand sums, comparisons and elements of arrays, of two dozen kinds. For each of them Numba tries
every way in which an operator could be meant, and for each variable it has LLVM read a module to learn how many bytes
it takes.
"""

from __future__ import annotations

from typing import Any, Final

from numba import types
from numba.core.registry import cpu_target
from numba.core.targetconfig import ConfigStack

_SIZES: Final[dict[str, int]] = {}


def remember_answers() -> None:
    """Let Numba in this process remember sizes of LLVM's types, and types of operations."""
    _remember_sizes(cpu_target.target_context)
    _remember_types(cpu_target.typing_context)


def _remember_sizes(target: Any) -> None:
    measure = target.get_abi_sizeof

    def get_abi_sizeof(kind: Any) -> int:
        name = str(kind)
        if name not in _SIZES:
            _SIZES[name] = measure(kind)
        return _SIZES[name]

    target.get_abi_sizeof = get_abi_sizeof


def _remember_types(typing: Any) -> None:
    """Calls of built-in functions and operators, for each set of compiler flags: with some nothing may allocate.

    What another package adds to a function makes a new type of it, of which nothing is known yet.
    """
    resolve = typing.resolve_function_type

    def resolve_function_type(function: Any, arguments: Any, keywords: Any) -> Any:
        kind = function if isinstance(function, types.Type) else typing._lookup_global(function)
        if keywords or type(kind) is not types.Function:
            return resolve(function, arguments, keywords)
        known = kind.__dict__.setdefault("_known_signatures", {})
        key = ConfigStack.top_or_none(), tuple(arguments)
        if (signature := known.get(key)) is None:
            signature = known[key] = resolve(function, arguments, keywords)
        return signature

    typing.resolve_function_type = resolve_function_type
