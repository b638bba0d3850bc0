"""Compiled functions behind a pointer: who calls through one is compiled once, whatever stands behind it.

Numba makes a type for each function, so a kernel that takes a function is compiled anew for each and not cached. To a
pointer there is one type for each signature. The price is an indirect call that cannot be inlined.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import numba.experimental.function_type  # noqa: F401  (teaches Numba the type of a pointer; it loads this too late)
from numba import types


class KernelPointer(types.WrapperAddressProtocol):  # type: ignore[misc]
    """A kernel as a value of one signature; may stand in a NamedTuple of arrays.

    Args:
        body: a `kernel` or `lean_kernel` that fits the signature; plain Python with the JIT off.
        signature: Numba's, `types.void(...)`.
    """

    def __init__(self, body: Callable[..., None], signature: Any) -> None:
        self.body = body
        self._signature = signature

    def __call__(self, *arguments: Any) -> None:
        """Run it from Python."""
        self.body(*arguments)

    def signature(self) -> Any:
        """Its type, for Numba."""
        return self._signature

    @cached_property
    def _address(self) -> int:
        body: Any = self.body
        if self._signature.args not in body.overloads:
            body.compile(self._signature)
        result = body.get_compile_result(self._signature)
        return int(result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name))

    def __wrapper_address__(self) -> int:
        """Where the compiled code is, for Numba. Raises Numba's typing error when the body does not fit."""
        return self._address
