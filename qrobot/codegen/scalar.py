"""The functions generated code is made of, with the meaning they have in CasADi, that is in C.

Numba compiles most of Python's `math` to calls of the C library, bit for bit what CasADi calls; the others are named to
the linker or written here. Python's own raise where C returns an infinity or NaN, so with the JIT off numpy answers
there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numba import types

from qrobot.realtime.jit import jit_disabled, lean_kernel
from qrobot.realtime.sine import cosine, sine

Scalar = Callable[..., float]
# Numpy's, so that with the JIT off a division by zero is an infinity and no exception.
_ZERO: Final = np.float64(0.0)
_ONE: Final = np.float64(1.0)

inf: Final = math.inf
nan: Final = math.nan


def _total(function: Scalar, elsewhere: Scalar) -> Scalar:
    """`function` where it is defined and `elsewhere` where it raises."""

    def total(*x: float) -> float:
        try:
            return np.float64(function(*x))
        except (ValueError, OverflowError):
            with np.errstate(all="ignore"):
                return elsewhere(*x)

    return total


def _known(function: Scalar, elsewhere: Scalar) -> Scalar:
    """A function Numba knows."""
    return _total(function, elsewhere) if jit_disabled() else function


def _linked(name: str, function: Scalar, elsewhere: Scalar) -> Any:
    """A function of two arguments of the C library."""
    if jit_disabled():
        return _total(function, elsewhere)
    return types.ExternalFunction(name, types.float64(types.float64, types.float64))


def _undefined(*_x: float) -> float:
    return nan


exp = _known(math.exp, np.exp)
expm1 = _known(math.expm1, np.expm1)
log = _known(math.log, np.log)
log1p = _known(math.log1p, np.log1p)
sqrt = _known(math.sqrt, np.sqrt)
power = _known(math.pow, np.power)
sin = _known(math.sin, np.sin)
cos = _known(math.cos, np.cos)
tan = _known(math.tan, np.tan)
asin = _known(math.asin, np.arcsin)
acos = _known(math.acos, np.arccos)
atan = _known(math.atan, np.arctan)
atan2 = _known(math.atan2, np.arctan2)
sinh = _known(math.sinh, np.sinh)
cosh = _known(math.cosh, np.cosh)
tanh = _known(math.tanh, np.tanh)
asinh = _known(math.asinh, np.arcsinh)
acosh = _known(math.acosh, np.arccosh)
atanh = _known(math.atanh, np.arctanh)
erf = _known(math.erf, _undefined)
quick_sin, quick_cos = sine, cosine
fabs = _known(math.fabs, np.fabs)
copysign = _known(math.copysign, np.copysign)
floor: Scalar = np.floor  # the `math` ones go through integers and lose what does not fit
ceil: Scalar = np.ceil
hypot = _linked("hypot", np.hypot, np.hypot)  # Python's own is another algorithm
fmod = _linked("fmod", math.fmod, np.fmod)
remainder = _linked("remainder", math.remainder, _undefined)


@lean_kernel
def fmin(x: float, y: float) -> float:
    """The smaller one; of a number and NaN the number."""
    return x if x <= y or math.isnan(y) else y


@lean_kernel
def fmax(x: float, y: float) -> float:
    """The larger one; of a number and NaN the number."""
    return x if x >= y or math.isnan(y) else y


@lean_kernel
def sign(x: float) -> float:
    """-1, 1, or `x` itself when it is a zero or NaN."""
    if x > 0.0:
        return _ONE
    return -_ONE if x < 0.0 else x


@lean_kernel
def less(x: float, y: float) -> float:
    """1 if x < y, else 0."""
    return _ONE if x < y else _ZERO


@lean_kernel
def less_or_equal(x: float, y: float) -> float:
    """1 if x <= y, else 0."""
    return _ONE if x <= y else _ZERO


@lean_kernel
def equal(x: float, y: float) -> float:
    """1 if x = y, else 0."""
    return _ONE if x == y else _ZERO


@lean_kernel
def differs(x: float, y: float) -> float:
    """1 unless x = y, else 0."""
    return _ONE if x != y else _ZERO


@lean_kernel
def logic_not(x: float) -> float:
    """1 if x is zero, else 0; NaN is true as in C."""
    return _ONE if x == 0.0 else _ZERO


@lean_kernel
def logic_and(x: float, y: float) -> float:
    """1 if neither is zero, else 0."""
    return _ONE if x != 0.0 and y != 0.0 else _ZERO


@lean_kernel
def logic_or(x: float, y: float) -> float:
    """1 if one is not zero, else 0."""
    return _ONE if x != 0.0 or y != 0.0 else _ZERO


@lean_kernel
def if_else_zero(condition: float, x: float) -> float:
    """`x` unless the condition is zero; NaN in `x` does not pass a false condition."""
    return x if condition != 0.0 else _ZERO
