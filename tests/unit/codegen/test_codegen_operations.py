"""Each operation of CasADi against its translation, over edges and random numbers, to the last bit."""

from __future__ import annotations

import casadi
import numpy as np
import pytest
from numpy.typing import NDArray

from qrobot.codegen import compile_function
from qrobot.codegen.opcodes import EXPRESSIONS, opcode_names
from qrobot.errors import CodegenError

EDGES = [0.0, -0.0, 0.5, -0.5, 1.0, -1.0, 2.0, -3.0, 5e-310, -5e-310, 1e-8, 1e19, -1e19, 1e308, -1e308, 709.9, -745.2]
EDGES += [np.pi / 2, 1e22, np.inf, -np.inf, np.nan]
X, Y = casadi.SX.sym("x"), casadi.SX.sym("y")
OPERATIONS: dict[str, casadi.SX] = {
    "OP_ADD": X + Y,
    "OP_SUB": X - Y,
    "OP_MUL": X * Y,
    "OP_DIV": X / Y,
    "OP_NEG": -X,
    "OP_INV": 1 / X,
    "OP_SQ": X * X,
    "OP_TWICE": 2 * X,
    "OP_EXP": casadi.exp(X),
    "OP_EXPM1": casadi.expm1(X),
    "OP_LOG": casadi.log(X),
    "OP_LOG1P": casadi.log1p(X),
    "OP_SQRT": casadi.sqrt(X),
    "OP_POW": X**Y,
    "OP_CONSTPOW": X**2.5,
    "OP_HYPOT": casadi.hypot(X, Y),
    "OP_SIN": casadi.sin(X),
    "OP_COS": casadi.cos(X),
    "OP_TAN": casadi.tan(X),
    "OP_ASIN": casadi.asin(X),
    "OP_ACOS": casadi.acos(X),
    "OP_ATAN": casadi.atan(X),
    "OP_ATAN2": casadi.atan2(X, Y),
    "OP_SINH": casadi.sinh(X),
    "OP_COSH": casadi.cosh(X),
    "OP_TANH": casadi.tanh(X),
    "OP_ASINH": casadi.asinh(X),
    "OP_ACOSH": casadi.acosh(X),
    "OP_ATANH": casadi.atanh(X),
    "OP_ERF": casadi.erf(X),
    "OP_FABS": casadi.fabs(X),
    "OP_SIGN": casadi.sign(X),
    "OP_COPYSIGN": casadi.copysign(X, Y),
    "OP_FLOOR": casadi.floor(X),
    "OP_CEIL": casadi.ceil(X),
    "OP_FMOD": casadi.fmod(X, Y),
    "OP_REMAINDER": casadi.remainder(X, Y),
    "OP_FMIN": casadi.fmin(X, Y),
    "OP_FMAX": casadi.fmax(X, Y),
    "OP_LT": X < Y,
    "OP_LE": X <= Y,
    "OP_EQ": X == Y,
    "OP_NE": X != Y,
    "OP_NOT": casadi.logic_not(X),
    "OP_AND": casadi.logic_and(X, Y),
    "OP_OR": casadi.logic_or(X, Y),
    "OP_IF_ELSE_ZERO": casadi.if_else(X, Y, 0),
}


def samples() -> NDArray[np.float64]:
    """Every pair of edges, and random pairs of all magnitudes. Shape (samples, 2)."""
    random = np.random.default_rng(11)
    edges = np.array([grid.ravel() for grid in np.meshgrid(EDGES, EDGES)])
    near = random.normal(scale=3.0, size=(2, 500))
    far = random.choice([-1.0, 1.0], (2, 300)) * 10.0 ** random.uniform(-20, 20, (2, 300))
    return np.concatenate([edges, near, far], axis=1).T


@pytest.fixture(scope="module")
def results() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """All operations at all samples, by CasADi and by the kernel. Shapes (samples, operations)."""
    function = casadi.Function("operations", [X, Y], [casadi.vertcat(*OPERATIONS.values())], ["x", "y"], ["z"])
    compiled, xy = compile_function(function), samples()
    theirs = np.array(function.map(len(xy))(xy[:, :1].T, xy[:, 1:].T)).T
    return theirs, np.array([compiled(x, y)[0] for x, y in zip(xy[:, :1], xy[:, 1:], strict=True)])


def bits(values: NDArray[np.float64]) -> NDArray[np.int64]:
    """The bit patterns; NaN is NaN whatever its sign."""
    return np.where(np.isnan(values), np.nan, values).view(np.int64)


@pytest.mark.parametrize("name", OPERATIONS)
def test_an_operation_gives_what_casadi_gives_to_the_last_bit(
    name: str, results: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> None:
    column = list(OPERATIONS).index(name)
    theirs, ours = (np.ascontiguousarray(table[:, column]) for table in results)
    different = np.flatnonzero(bits(theirs) != bits(ours))
    assert [(*samples()[i], theirs[i], ours[i]) for i in different[:5]] == []


@pytest.mark.parametrize("name", OPERATIONS)
def test_the_operation_meant_is_the_one_tried(name: str) -> None:
    function = casadi.Function("one", [X, Y], [OPERATIONS[name]])
    assert name in [opcode_names()[function.instruction_id(k)] for k in range(function.n_instructions())]


def test_every_operation_that_has_a_translation_is_tried() -> None:
    assert set(OPERATIONS) == set(EXPRESSIONS)


@pytest.mark.parametrize(
    ("name", "expression"), [("OP_ERFINV", casadi.erfinv(X)), ("OP_PRINTME", X.printme(Y))], ids=str
)
def test_an_operation_without_translation_is_refused_by_name(name: str, expression: casadi.SX) -> None:
    with pytest.raises(CodegenError, match=f"odd: CasADi's operation {name} has no translation"):
        compile_function(casadi.Function("odd", [X, Y], [expression]))
