"""Random expressions: the kernel is CasADi, to the last bit."""

from __future__ import annotations

from collections.abc import Callable

import casadi
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.codegen import compile_function
from tests.support.thorough import examples

UNARY: list[Callable[..., casadi.SX]] = [casadi.sin, casadi.exp, casadi.tanh, casadi.sqrt, casadi.floor, casadi.sign]
BINARY: list[Callable[..., casadi.SX]] = [
    lambda x, y: x + y,
    lambda x, y: x - y,
    lambda x, y: x * y,
    lambda x, y: x / y,
    lambda x, y: x < y,
    casadi.fmax,
    casadi.atan2,
    lambda x, y: casadi.if_else(x > 0, x, y),
]
NUMBER = st.floats(-10.0, 10.0, allow_subnormal=False)
STEP = st.tuples(st.integers(0, 13), st.integers(0, 100), st.integers(0, 100), NUMBER)


def expression_of(program: list[tuple[int, int, int, float]], inputs: casadi.SX) -> casadi.SX:
    """Straight-line program over a growing list of values; its last two values."""
    values = [inputs[0], inputs[1]]
    for operation, left, right, number in program:
        x, y = values[left % len(values)], values[right % len(values)]
        if operation < len(UNARY):
            values.append(UNARY[operation](x + number))
        else:
            values.append(BINARY[operation - len(UNARY)](x, y))
    return casadi.vertcat(*values[-2:])


@settings(max_examples=examples(15))
@given(st.lists(STEP, max_size=30), st.lists(st.tuples(NUMBER, NUMBER), min_size=5, max_size=5))
def test_a_kernel_gives_what_casadi_gives_to_the_last_bit(
    program: list[tuple[int, int, int, float]], points: list[tuple[float, float]]
) -> None:
    x = casadi.SX.sym("x", 2)
    function = casadi.Function("random", [x], [casadi.densify(expression_of(program, x))], ["x"], ["y"])
    compiled = compile_function(function)
    for point in points:
        theirs, ours = np.array(function(point)).ravel(), compiled(np.array(point))[0]
        np.testing.assert_array_equal(ours, theirs)
