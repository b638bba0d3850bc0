"""Compiled functions behind a pointer: who calls through one is compiled once, whatever stands behind it.

Numba makes a type for each function, so a kernel that takes a function is compiled anew for each and not cached. To a
pointer there is one type for each signature. The price is an indirect call that cannot be inlined.

A `KernelPointer` is an argument of its own. Inside a NamedTuple it would cost half a millisecond at every call from
Python, because Numba then works out the type of the whole tuple anew; there its `address` stands, a plain integer, and
the kernel turns it back with `function_at`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Final

import numba.experimental.function_type  # noqa: F401  (teaches Numba the type of a pointer; it loads this too late)
from numba import types
from numba.core import cgutils
from numba.core.errors import NumbaError
from numba.extending import intrinsic

from qrobot.realtime.jit import jit_disabled

PointerBody = Callable[..., None]
COMPILE_ERRORS: Final = (NumbaError, TypeError, ImportError)  # the last one for what Numba leaves to SciPy's BLAS
_BODIES: Final[dict[int, PointerBody]] = {}  # what stands at an address, with the JIT off


class KernelPointer(types.WrapperAddressProtocol):  # type: ignore[misc]
    """A kernel as a value of one signature.

    Args:
        body: a `kernel` or `lean_kernel` that fits the signature; plain Python with the JIT off.
        signature: Numba's, `types.void(...)`.
    """

    def __init__(self, body: PointerBody, signature: Any) -> None:
        self.body = body
        self._signature = signature

    def __call__(self, *arguments: Any) -> None:
        """Run it from Python."""
        self.body(*arguments)

    def signature(self) -> Any:
        """Its type, for Numba."""
        return self._signature

    @cached_property
    def address(self) -> int:
        """Address of the compiled code, while the body lives. Raises one of `COMPILE_ERRORS`: it does not fit."""
        body: Any = self.body
        if jit_disabled():
            _BODIES[id(body)] = body
            return id(body)
        if self._signature.args not in body.overloads:
            body.compile(self._signature)
        return self._address_of("llvm_cfunc_wrapper_name")

    @cached_property
    def raising_address(self) -> int:
        """Address of code that hands what the body raises to its caller, who is made by `raising_function_at`."""
        address = self.address
        return address if jit_disabled() else self._address_of("llvm_func_name")

    def _address_of(self, entry: str) -> int:
        body: Any = self.body
        result = body.get_compile_result(self._signature)
        return int(result.library.get_pointer_to_function(getattr(result.fndesc, entry)))

    def __wrapper_address__(self) -> int:
        """The address, for Numba."""
        return self.address


def function_at(signature: Any) -> Any:
    """Make the intrinsic by which kernels turn the address of a `KernelPointer` of that signature into a function.

    What that function raises is printed, and its caller goes on.
    """
    return _function_at(signature, "c_addr")


def raising_function_at(signature: Any) -> Any:
    """Make the intrinsic for a `raising_address`: what the function raises, the kernel that calls it raises."""
    return _function_at(signature, "jit_addr")


def _function_at(signature: Any, field: str) -> Any:
    if jit_disabled():
        return _BODIES.__getitem__
    function_type = types.FunctionType(signature)

    def build(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        function = cgutils.create_struct_proxy(function_type)(context, builder)
        nowhere = cgutils.get_null_value(cgutils.voidptr_t)
        function.c_addr = function.py_addr = function.jit_addr = nowhere
        setattr(function, field, builder.inttoptr(arguments[0], cgutils.voidptr_t))
        return function._getvalue()

    @intrinsic  # type: ignore[untyped-decorator]
    def at(_context: Any, address: Any) -> Any:
        return function_type(address), build

    return at
