"""Calls of VAL programs: what a parameter stands for, and what is left when a call has ended."""

from __future__ import annotations

import pytest

from qrobot.val.interpreter import RunState
from qrobot.val.source import print_source, read_source
from qrobot.val.vocabulary import LOCATION_VALUES, NUMBER_VALUES
from tests.support.val_runs import PLACES, interpreter, main_program, number

TWICE = ".PROGRAM twice(n)\nn = 2*n\n.END\n"


@pytest.mark.parametrize("word", sorted(NUMBER_VALUES))
def test_a_word_that_is_a_number_is_handed_by_its_value_which_the_call_may_change(word: str) -> None:
    program = main_program(f"CALL take({word})", f"y = {word}", rest=".PROGRAM take(n)\nx = n\nn = 7\n.END\n")
    with interpreter(program) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert [number(run, "x"), number(run, "y")] == [NUMBER_VALUES[word]] * 2


@pytest.mark.parametrize("word", sorted(LOCATION_VALUES))
def test_a_word_that_is_a_place_is_handed_as_it_is_at_the_call(word: str) -> None:
    """TOOL, BASE, HERE and DEST are others before the program called looks at them."""
    lines = "MOVE a", "BREAK", "TOOL SHIFT(NULL BY 0,0,80)", "BASE 20", f"SET was = {word}", f"CALL take({word})"
    take = ".PROGRAM take(place)\nTOOL\nBASE 0\nMOVE b\nBREAK\nSET x = place\n.END\n"
    with interpreter(main_program(*lines, "x = DISTANCE(x, was)", rest=take + PLACES)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert number(run, "x") == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("given", "x"), [("x", 6.0), ("(x)", 3.0), ("((x))", 3.0), ("x+0", 3.0)])
def test_a_variable_in_parentheses_is_handed_by_its_value(given: str, x: float) -> None:
    """Also when the program has been stored and loaded."""
    source, errors = read_source(main_program("x = 3", f"CALL twice({given})", rest=TWICE))
    assert errors == []
    with interpreter(print_source(source)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert number(run, "x") == x


def test_a_place_in_parentheses_is_that_place() -> None:
    lines = "SET c = (a):NULL", "CALL take((c))", "x = DISTANCE((c), a)"
    take = ".PROGRAM take(place)\nSET place = b\n.END\n"
    with interpreter(main_program(*lines, rest=take + PLACES)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert number(run, "x") == pytest.approx(0.0, abs=1e-9)


def test_random_needs_no_parentheses() -> None:
    with interpreter(main_program("x = RANDOM", "y = random()")) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert 0.0 <= number(run, "x") < 1.0
        assert number(run, "y") != number(run, "x")


def test_values_of_a_call_end_with_it() -> None:
    """One that keeps them takes memory as long as a process control program runs."""
    deep = ".PROGRAM deep(m)\nm = m+1\nm[1] = m\nx = m[1]\n.END\n"
    outer = ".PROGRAM outer(n, left.out)\nleft.out = n\nCALL deep(n)\nCALL deep(left.out)\n.END\n"
    lines = "FOR i = 1 TO 50", "CALL outer(i+1)", "END"
    with interpreter(main_program(*lines, rest=outer + deep)) as (run, _):
        assert run.execute("main") is RunState.COMPLETED, run.message
        assert number(run, "x") == 52.0
        assert set(run.machine.values) == {("i", ()), ("x", ())}


def test_a_call_that_leaves_an_argument_out_finds_no_value_of_a_call_before() -> None:
    take = ".PROGRAM take(n)\nn = n+1\n.END\n"
    with interpreter(main_program("CALL take(1)", "CALL take", rest=take)) as (run, _):
        assert run.execute("main") is RunState.FAILED
        assert "the value of n is not defined" in run.message


@pytest.mark.parametrize(
    ("lines", "step", "value"),
    [
        (("GOTO 10", "FOR i = 1 TO 3", "10 x = x+1", "END"), 1, 2.0),  # i is 2, then 3
        (("FOR i = 1 TO 3", "x = x+1", "END"), 2, 2.0),
        (("FOR i = 1 TO 3", "x = x+1", "END"), 3, 1.0),
        (("GOTO 10", "FOR i = 3 TO 1 STEP -1", "10 x = x+1", "END"), 1, 2.0),
        (("FOR i = 1 TO 3", "10 x = x+1", "END", "IF x < 5 GOTO 10"), 1, 5.0),  # i is past its end
    ],
)
def test_a_loop_that_is_entered_in_its_middle_goes_on_with_its_variable(
    lines: tuple[str, ...], step: int, value: float
) -> None:
    with interpreter(main_program(*lines)) as (run, _):
        run.machine.values["i", ()], run.machine.values["x", ()] = 2.0, 0.0
        assert run.execute("main", step=step) is RunState.COMPLETED, run.message
        assert number(run, "x") == value


def test_a_loop_that_is_entered_in_its_middle_without_a_value_is_a_mistake_which_retry_does_again() -> None:
    with interpreter(main_program("FOR i = 1 TO 3", "x = x+1", "END")) as (run, _):
        run.machine.values["x", ()] = 0.0
        assert run.execute("main", step=3) is RunState.FAILED
        assert run.message.startswith("program main, line 2")
        assert "the value of i is not defined" in run.message
        run.do("i = 2")
        assert run.retry() is RunState.COMPLETED, run.message
        assert number(run, "x") == 1.0  # it goes on with 3, and does not begin again
