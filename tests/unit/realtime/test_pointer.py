"""Kernels behind pointers: two functions, one caller."""

from __future__ import annotations

import numpy as np
import pytest
from numba import types

from qrobot.arrays import Floats
from qrobot.realtime.jit import jit_disabled, kernel, lean_kernel
from qrobot.realtime.pointer import KernelPointer, function_at

SIGNATURE = types.void(types.float64[::1], types.float64)
at = function_at(SIGNATURE)


@lean_kernel
def fill(x: Floats, value: float) -> None:
    for i in range(x.size):
        x[i] = value


@kernel
def count(x: Floats, value: float) -> None:
    for i in range(x.size):
        x[i] += i * value


@lean_kernel
def misfit(x: Floats) -> None:
    x[0] = 0.0


@lean_kernel
def call(address: int, x: Floats, value: float) -> None:
    at(address)(x, value)


@lean_kernel
def call_value(function: object, x: Floats, value: float) -> None:
    function(x, value)  # type: ignore[operator]


@pytest.mark.parametrize(("body", "expected"), [(fill, [2.0, 2.0, 2.0]), (count, [1.0, 3.0, 5.0])])
def test_a_kernel_does_the_same_by_address_by_value_and_called_directly(body: object, expected: list[float]) -> None:
    pointer = KernelPointer(body, SIGNATURE)  # type: ignore[arg-type]
    ways = (
        lambda x: call(pointer.address, x, 2.0),
        lambda x: call_value(pointer, x, 2.0),
        lambda x: pointer(x, 2.0),
    )
    for way in ways:
        x = np.ones(3)
        way(x)
        assert x.tolist() == expected


def test_callers_are_compiled_once_for_all_kernels() -> None:
    x = np.ones(3)
    for body in (fill, count):
        pointer = KernelPointer(body, SIGNATURE)
        call(pointer.address, x, 1.0)
        call_value(pointer, x, 1.0)
    if not jit_disabled():
        assert len(call.signatures) == len(call_value.signatures) == 1  # type: ignore[attr-defined]


def test_a_kernel_of_another_signature_is_refused() -> None:
    with pytest.raises(TypeError):
        call(KernelPointer(misfit, SIGNATURE).address, np.ones(3), 1.0)
