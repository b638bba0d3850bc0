"""CasADi functions as kernels: same numbers, honest refusals, one file per expression, cached on disk."""

from __future__ import annotations

import runpy
import subprocess
import sys
from pathlib import Path

import casadi
import numpy as np
import pytest
from numpy.typing import NDArray

from qrobot.codegen import QUICK_EXPRESSIONS, compile_function
from qrobot.codegen.compile import default_cache_dir
from qrobot.codegen.translate import translate
from qrobot.errors import CodegenError
from qrobot.realtime.jit import lean_kernel

ROOT = Path(__file__).parents[3]
X, Y = casadi.SX.sym("x", 2), casadi.SX.sym("y", 2)


def pendulum() -> casadi.Function:
    """One step of a damped pendulum, x = (angle, speed)."""
    rate = casadi.vertcat(X[1], -9.81 * casadi.sin(X[0]) - 0.1 * X[1])
    return casadi.Function("pendulum", [X], [X + 0.01 * rate], ["x"], ["x_next"])


# --- numbers -----------------------------------------------------------------------------------------------------


def test_outputs_are_new_arrays_with_casadis_numbers() -> None:
    function = casadi.Function("f", [X, Y], [X * Y, casadi.dot(X, Y)], ["x", "y"], ["product", "sum"])
    product, total = compile_function(function)(np.array([2.0, 3.0]), np.array([5.0, 7.0]))
    assert product.tolist() == [10.0, 21.0]
    assert total.tolist() == [31.0]


def test_a_matrix_is_its_nonzeros_by_columns() -> None:
    matrix = casadi.SX(3, 3)
    matrix[0, 0], matrix[2, 0], matrix[1, 1] = X[0], X[1], 5.0
    compiled = compile_function(casadi.Function("sparse", [X], [matrix], ["x"], ["m"]))
    assert compiled.sizes == {"x": 2, "m": 3}
    assert compiled(np.array([1.0, 2.0]))[0].tolist() == [1.0, 2.0, 5.0]


def test_elements_of_an_input_that_comes_as_rows_are_taken_row_by_row() -> None:
    given = casadi.SX.sym("given", 6)
    function = casadi.Function("rows", [given], [casadi.vertcat(given[1], given[3])], ["given"], ["y"])
    compiled = compile_function(function, matrices=("given",))
    assert compiled(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]))[0].tolist() == [2.0, 4.0]


@pytest.mark.parametrize("number", [0.1, -1e-310, 1.7976931348623157e308, np.inf, -np.inf, np.nan, -3.0])
def test_a_constant_arrives_bit_for_bit(number: float) -> None:
    compiled = compile_function(casadi.Function("constant", [], [casadi.SX(number)], [], ["c"]))
    assert compiled()[0].tobytes() == np.array([number]).tobytes()


def test_quick_sine_and_cosine_are_casadis_to_rounding() -> None:
    function = casadi.Function("turn", [X], [casadi.vertcat(casadi.sin(X[0]), casadi.cos(X[0]))], ["x"], ["turn"])
    compiled = compile_function(function, expressions=QUICK_EXPRESSIONS)
    for angle in np.linspace(-7.0, 7.0, 101):
        np.testing.assert_allclose(compiled(np.array([angle, 0.0]))[0], [np.sin(angle), np.cos(angle)], atol=1.2e-16)


def test_a_function_of_matrices_is_expanded() -> None:
    m = casadi.MX.sym("m", 2, 2)
    function = casadi.Function("square", [m], [casadi.mtimes(m, m)], ["m"], ["square"])
    assert compile_function(function)(np.array([1.0, 2.0, 3.0, 4.0]))[0].tolist() == [7.0, 10.0, 15.0, 22.0]


def test_a_step_in_place_is_the_step_applied_to_its_own_result() -> None:
    apart, together = compile_function(pendulum()), compile_function(pendulum(), in_place={"x_next": "x"})
    state = x = np.array([0.5, 0.0])
    together_x = x.copy()
    for _ in range(100):
        (state,) = apart(state)
        together.kernel(together_x)
    assert state.tobytes() == together_x.tobytes() != x.tobytes()


@lean_kernel
def twice(kernel: object, x: NDArray[np.float64]) -> None:
    kernel(x)  # type: ignore[operator]
    kernel(x)


def test_a_kernel_that_neither_allocates_nor_counts_may_call_one() -> None:
    step = compile_function(pendulum(), in_place={"x_next": "x"})
    x, expected = np.array([0.5, 0.0]), np.array([0.5, 0.0])
    twice(step.kernel, x)
    step.kernel(expected)
    step.kernel(expected)
    assert x.tobytes() == expected.tobytes()


# --- what is not translated ----------------------------------------------------------------------------------------


def test_what_no_output_needs_is_neither_computed_nor_read() -> None:
    both = casadi.Function("both", [X, Y], [2 * X[1], casadi.sin(X[0])])
    function = casadi.Function("lazy", [X, Y], [both(X, Y)[0]], ["x", "y"], ["z"])
    body = translate(function).partition("def lazy(x, y, z):\n")[2]
    assert body == "    _0 = x[1]\n    _1 = 2.0 * _0\n    z[0] = _1\n"
    assert compile_function(function)(np.array([1.0, 4.0]), np.zeros(2))[0].tolist() == [8.0]


def test_a_function_that_cannot_be_expanded_is_refused() -> None:
    m = casadi.MX.sym("m", 2, 2)
    with pytest.raises(CodegenError, match="inverse cannot be expanded to scalar operations"):
        compile_function(casadi.Function("inverse", [m], [casadi.inv(m)]))


def test_a_call_that_stays_a_call_is_refused_by_name() -> None:
    x = casadi.MX.sym("x")
    table = casadi.interpolant("table", "bspline", [[0.0, 1.0, 2.0, 3.0, 4.0]], [0.0, 1.0, 4.0, 9.0, 16.0])
    with pytest.raises(CodegenError, match="looked_up: CasADi's operation OP_CALL has no translation"):
        compile_function(casadi.Function("looked_up", [x], [table(x)]))


def test_a_free_symbol_is_refused_by_name() -> None:
    loose = casadi.Function("loose", [X], [X[0] * casadi.SX.sym("mass")], {"allow_free": True})
    with pytest.raises(CodegenError, match="loose: not among its arguments: mass"):
        compile_function(loose)


def test_a_word_of_python_is_no_name() -> None:
    with pytest.raises(CodegenError, match="'lambda' is a word of Python"):
        compile_function(casadi.Function("f", [X], [X], ["lambda"], ["y"]))


def test_names_of_mathematics_are_names_like_others() -> None:
    compiled = compile_function(casadi.Function("sin", [X], [casadi.sin(X)], ["cos"], ["lean_kernel"]))
    np.testing.assert_array_equal(compiled(np.array([0.5, 1.5]))[0], [np.sin(0.5), np.sin(1.5)])


@pytest.mark.parametrize(
    ("in_place", "message"),
    [
        ({"z": "x"}, "'z' over 'x': there is no such"),
        ({"a": "z"}, "'a' over 'z': there is no such"),
        ({"b": "x"}, "'b' does not fit over 'x': 1x1, 2x1"),
        ({"a": "x", "c": "x"}, "two outputs over the same input"),
    ],
)
def test_an_output_that_cannot_be_in_place_is_refused(in_place: dict[str, str], message: str) -> None:
    function = casadi.Function("f", [X], [X, X[0], X], ["x"], ["a", "b", "c"])
    with pytest.raises(CodegenError, match=message):
        compile_function(function, in_place=in_place)


def test_arguments_of_another_size_are_refused_from_python() -> None:
    with pytest.raises(CodegenError, match=r"pendulum takes \{'x': 2\} numbers"):
        compile_function(pendulum())(np.zeros(3))


# --- files ---------------------------------------------------------------------------------------------------------


def test_an_expression_is_one_file_and_another_expression_another(tmp_path: Path) -> None:
    other = casadi.Function("pendulum", [X], [X + 0.02 * X], ["x"], ["x_next"])
    paths = {compile_function(f, cache_dir=tmp_path).path for f in (pendulum(), pendulum(), other)}
    assert paths == set(tmp_path.glob("pendulum_*.py"))
    assert len(paths) == 2


def test_a_torn_file_is_written_anew(tmp_path: Path) -> None:
    path = compile_function(pendulum(), cache_dir=tmp_path).path
    source = path.read_text()
    path.write_text(source[:100])
    assert compile_function(pendulum(), cache_dir=tmp_path).path.read_text() == source
    assert [file for file in tmp_path.iterdir() if file.suffix == ".new"] == []


def test_a_folder_that_cannot_be_written_is_an_error_that_says_what_to_set(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(CodegenError, match="set QROBOT_CACHE"):
        compile_function(pendulum(), cache_dir=tmp_path / "file" / "below")


def test_the_cache_folder_is_the_one_asked_for_else_the_users(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("QROBOT_CACHE", "here")
    monkeypatch.setenv("XDG_CACHE_HOME", "there")
    assert default_cache_dir() == Path("here/codegen")
    monkeypatch.delenv("QROBOT_CACHE")
    assert default_cache_dir() == Path("there/qrobot/codegen")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert default_cache_dir() == Path.home() / ".cache/qrobot/codegen"


USE = """
import sys, numpy as np, qrobot.codegen
from pathlib import Path
assert "casadi" not in sys.modules
from tests.unit.codegen.test_codegen import pendulum
step = qrobot.codegen.compile_function(pendulum(), cache_dir=Path(sys.argv[1]))
print(step(np.ones(2))[0].tobytes().hex(), sum(step.kernel.stats.cache_hits.values()))
"""


@pytest.mark.thorough
def test_a_second_process_finds_the_compiled_kernel_and_casadi_is_only_loaded_by_who_uses_it(tmp_path: Path) -> None:
    command = [sys.executable, "-c", USE, str(tmp_path)]
    runs = [subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    (first, compiled), (second, found) = (run.stdout.split() for run in runs)
    assert first == second
    assert (compiled, found) == ("0", "1")


# --- the page ------------------------------------------------------------------------------------------------------


def test_the_example_of_the_how_to_page_swings_as_casadi_says(tmp_path: Path) -> None:
    page = (ROOT / "docs/how-to/compile-an-expression.md").read_text()
    example = tmp_path / "example.py"  # a file, so that its kernel can be cached
    example.write_text(page.partition("```python\n")[2].partition("```")[0])
    names = runpy.run_path(str(example))
    state = np.array([0.5, 0.0])
    for _ in range(1000):
        state = np.array(names["function"](state, 0.0)).ravel()
    assert names["state"].tobytes() == state.tobytes()
