"""What Numba is asked again it answers at once, and as before."""

from __future__ import annotations

import operator
from typing import Any

import pytest
from llvmlite import ir
from numba import njit, types
from numba.core.errors import TypingError
from numba.core.registry import cpu_target
from numba.core.typing.templates import AbstractTemplate
from numba.extending import overload

from qrobot.realtime.jit import jit_disabled

pytestmark = pytest.mark.skipif(jit_disabled(), reason="nothing is compiled")
NUMBERS = (types.float64, types.int64)


def ways_tried(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    tried: list[Any] = []
    apply = AbstractTemplate.apply

    def noted(template: Any, args: Any, kws: Any) -> Any:
        tried.append(args)
        return apply(template, args, kws)

    monkeypatch.setattr(AbstractTemplate, "apply", noted)
    return tried


def test_a_sum_of_two_types_is_typed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    cpu_target.typing_context.refresh()
    first = cpu_target.typing_context.resolve_function_type(operator.add, NUMBERS, {})
    tried = ways_tried(monkeypatch)
    assert cpu_target.typing_context.resolve_function_type(operator.add, list(NUMBERS), {}) is first
    assert (first.return_type, tried) == (types.float64, [])


def size(x: Any) -> Any:
    raise NotImplementedError


def measure(x: Any) -> Any:
    return size(x)


def test_a_function_that_is_given_another_meaning_has_it_from_then_on() -> None:
    @overload(size)
    def of_a_float(x):  # type: ignore[no-untyped-def]
        return (lambda x: 8) if isinstance(x, types.Float) else None  # noqa: ARG005

    assert njit(measure)(1.0) == 8
    for _ in range(2):
        with pytest.raises(TypingError):
            njit(measure)(1)

    @overload(size)
    def of_an_integer(x):  # type: ignore[no-untyped-def]
        return (lambda x: 4) if isinstance(x, types.Integer) else None  # noqa: ARG005

    assert [njit(measure)(x) for x in (1, 1.0)] == [4, 8]


@pytest.mark.parametrize(
    ("kind", "size"),
    [
        (ir.DoubleType(), 8),
        (ir.IntType(1), 1),
        (ir.ArrayType(ir.IntType(8), 96), 96),
        (ir.LiteralStructType([ir.IntType(8), ir.DoubleType()]), 16),
    ],
)
def test_types_have_the_sizes_of_c(kind: ir.Type, size: int) -> None:
    assert [cpu_target.target_context.get_abi_sizeof(kind) for _ in range(2)] == [size, size]
