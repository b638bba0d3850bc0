"""VAL II is read and printed: every form of line, and errors that name line, column and what was expected."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import ProgramError
from qrobot.val import tree
from qrobot.val.parser import parse_line
from qrobot.val.printer import print_line
from qrobot.val.source import print_source, read_source
from qrobot.val.structure import jumps_of
from qrobot.val.vocabulary import INSTRUCTIONS, MANNERS, RESERVED, UNSUPPORTED, form_of, taken
from tests.support.val_lines import LINES, spoil_lines


@pytest.mark.parametrize("text", LINES)
def test_a_line_that_is_printed_and_read_again_is_the_same(text: str) -> None:
    line = parse_line(text, 1)
    assert parse_line(print_line(line), 1) == line


@pytest.mark.parametrize("word", sorted(INSTRUCTIONS | MANNERS))
def test_each_instruction_of_the_table_is_known_in_either_case(word: str) -> None:
    kinds = (INSTRUCTIONS | MANNERS)[word]
    text = f"{word} {', '.join('1' if kind.startswith('number') else 'a' for kind in kinds)}"
    action = parse_line(text.lower()).action
    assert isinstance(action, tree.Instruction)
    assert action.word == word


@pytest.mark.parametrize("word", sorted(UNSUPPORTED))
def test_what_is_not_supported_is_refused_by_name_with_its_line(word: str) -> None:
    with pytest.raises(ProgramError, match=rf"^line 7, column 1: {word} is not supported"):
        parse_line(f"{word} a, 3", 7)


@pytest.mark.parametrize(
    ("text", "column", "said"),
    [
        ("MOVE 3", 1, "expected a location, not a number"),
        ("MOVE", 1, "expected 1 argument, not 0"),
        ("  FOO a", 3, "FOO is no instruction"),
        ("  MOVE", 3, "expected 1 argument, not 0"),
        ("10 x = $part", 8, "variables of text ($) are not supported"),
        ('TYPE "hello', 6, "no closing quote"),
        ("x = ", 4, "expected a value; the line ends there"),
        ("x = 3 + * 4", 9, "expected a value; '*' stands there"),
        ("GOTO x", 6, "expected a label"),
        ("SET a = 3", 5, "expected a location, not a number"),
        ("x = foo(3)", 5, "there is no function FOO"),
        ("x = STATE(3)", 5, "the function STATE is not supported"),
        ("IF x", 5, "expected GOTO or THEN or an operator; the line ends there"),
        ("x = 1e999", 5, "too large"),
        ("ENABLE FORCE", 1, "there is no switch FORCE; switches are CP"),
        ("x = " + "(" * 60, 45, "deep in one another"),
        ("x = " + "1" * 500, 400, "at most 400 characters"),
        ("HERE a:b", 7, "expected the name of a location"),
    ],
)
def test_an_error_names_line_column_and_what_was_expected(text: str, column: int, said: str) -> None:
    with pytest.raises(ProgramError) as caught:
        parse_line(text, 4)
    assert (caught.value.line, caught.value.column) == (4, column)
    assert said in str(caught.value)


# ----------------------------------------------------------------------------------------------- trees drawn at random

NUMBERS = st.floats(0, 1e9, allow_nan=False).map(tree.NumberLiteral)
NAMES = st.from_regex(r"[a-z][a-z0-9_.]{0,5}", fullmatch=True).filter(
    lambda name: name.upper() not in RESERVED | {"BY", "RANDOM"}
)


def grown(values: st.SearchStrategy[tree.Expression]) -> st.SearchStrategy[tree.Expression]:
    operators = st.sampled_from(["OR", "AND", "==", "<>", "<", "<=", ">", ">=", "+", "-", "*", "/", "MOD"])
    return st.one_of(
        st.builds(tree.BinaryOperation, operators, values, values),
        st.builds(tree.UnaryOperation, st.sampled_from(["-", "+", "NOT"]), values),
        st.builds(lambda value: tree.FunctionCall("SIN", (value,)), values),
        st.builds(lambda name, index: tree.VariableName(name, (index,)), NAMES, values),
    )


GROUPED = st.builds(tree.GroupedVariable, st.builds(tree.VariableName, NAMES.filter(lambda name: not taken(name))))
VALUES = st.recursive(NUMBERS | st.builds(tree.VariableName, NAMES) | GROUPED, grown, max_leaves=12)
PLACES = st.recursive(
    st.builds(tree.VariableName, NAMES | NAMES.map(lambda name: f"#{name}")),
    lambda inner: st.one_of(
        st.builds(lambda left, right: tree.BinaryOperation(":", left, right), inner, inner),
        st.builds(lambda place: tree.FunctionCall("INVERSE", (place,)), inner),
        st.builds(lambda place, by: tree.LocationChange("SHIFT", place, (None, by)), inner, VALUES),
    ),
    max_leaves=5,
)
LABELS = st.none() | st.integers(0, 99999)
ACTIONS = st.one_of(
    st.builds(lambda place: tree.Instruction("MOVES", (place,)), PLACES),
    st.builds(lambda place, number: tree.Instruction("APPRO", (place, number)), PLACES, VALUES),
    st.builds(tree.Assignment, st.builds(tree.VariableName, NAMES), VALUES),
    st.builds(lambda target, place: tree.Assignment(target, place, True), st.builds(tree.VariableName, NAMES), PLACES),
    st.builds(tree.Goto, st.integers(0, 9999), st.none() | VALUES),
    st.builds(tree.ForLoop, st.builds(tree.VariableName, NAMES), VALUES, VALUES, st.none() | VALUES),
    st.builds(tree.CaseValues, st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=3).map(tuple)),
    st.builds(tree.Reaction, st.sampled_from(["REACT", "REACTI"]), VALUES, NAMES, st.none() | VALUES),
    st.builds(tree.ProgramCall, NAMES, st.lists(VALUES | PLACES, max_size=3).map(tuple)),
    st.builds(tree.SpeedSetting, VALUES, st.booleans(), st.booleans()),
)


@given(action=ACTIONS, label=LABELS)
def test_printing_and_reading_again_is_the_identity_of_trees(action: tree.StepAction, label: int | None) -> None:
    line = tree.ProgramLine(action, label)
    if len(text := print_line(line)) <= 400:
        assert parse_line(text) == line


# --------------------------------------------------------------------------------------------------------------- files

FILE = """\
; a comment before
.PROGRAM main(a, #b, n)
    MOVE a

    IF n THEN
    END
.END
.locations
a 1 2 3 0 90 0
#b[2] 1.5 2 3 4 5 6
.END
.REALS
n -4
.end
"""


def test_a_file_that_is_printed_and_read_again_is_the_same() -> None:
    source, errors = read_source(FILE)
    assert errors == []
    assert source.programs["main"].parameters == ("a", "#b", "n")
    assert [line.line for line in source.programs["main"].lines] == [3, 4, 5, 6]
    assert source.locations == {"a": (1, 2, 3, 0, 90, 0), "#b[2]": (1.5, 2, 3, 4, 5, 6)}
    assert read_source(print_source(source)) == (source, [])


@pytest.mark.parametrize(
    ("text", "line", "said"),
    [
        (".PROGRAM a\n MOVE", 2, "MOVE: expected 1"),
        (".PROGRAM a\n MOVE x", 1, "expected .END"),
        ("MOVE x", 1, "expected .PROGRAM"),
        (".PROGRAM 3\n.END", 1, "expected `.PROGRAM name`"),
        (".PROGRAM a(b, b)\n.END", 1, "each once"),
        (".PROGRAM a\n.END\n.PROGRAM A\n.END", 3, "two programs"),
        (".LOCATIONS\na 1 2\n.END", 2, "expected 6 numbers"),
        (".LOCATIONS\na 1 2 3 4 5 nan\n.END", 2, "finite"),
        (".REALS\na x\n.END", 2, "a name and numbers"),
        (".REALS\na 1\nA 2\n.END", 3, "a is there twice"),
        (".LOCATIONS\nb 1 2 3 4 5 6\n.END\n.LOCATIONS\nb 1 2 3 4 5 6\n.END", 5, "b is there twice"),
    ],
)
def test_every_mistake_of_a_file_is_told_with_its_line(text: str, line: int, said: str) -> None:
    errors = read_source(text)[1]
    assert any(error.line == line and said in error.what for error in errors)


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        ("IF x THEN", "expected END for this IF"),
        ("DO", "expected UNTIL for this DO"),
        ("END", "END without IF"),
        ("UNTIL x", "UNTIL without DO"),
        ("ELSE", "ELSE without IF"),
        ("IF x THEN|ELSE|ELSE|END", "second ELSE"),
        ("VALUE 1:", "VALUE without CASE"),
        ("DO|END|UNTIL x", "END without"),
        ("GOTO 10", "there is no label 10"),
        ("10|10", "label 10 stands a second time"),
    ],
)
def test_structures_that_do_not_match_are_told(lines: str, said: str) -> None:
    program = tree.ValProgram("p", (), tuple(parse_line(text, at + 2) for at, text in enumerate(lines.split("|"))))
    assert any(said in str(error) for error in jumps_of(program)[1])


def test_three_thousand_spoilt_lines_are_read_or_refused_with_their_column() -> None:
    refused, read, wrong = spoil_lines(3000, seed=17)
    assert wrong == []
    assert refused + read == 3000
    assert 500 < refused < 2800


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("MOVE p1 p2", "expected ',' or the end of the line or an operator; 'p2' stands there; write MOVE location"),
        ("APPRO p", "APPRO: expected 2 arguments, not 1; write APPRO location, number"),
        ("FOR i = 1 TO", "expected a value; the line ends there; write FOR variable = first TO last STEP step"),
        ("TIMER 1", "expected '=' or an operator; the line ends there; write TIMER number = number"),
        ("x = 3 +", "expected a value; the line ends there"),
    ],
)
def test_an_error_tells_how_to_write_the_line(text: str, told: str) -> None:
    with pytest.raises(ProgramError) as refused:
        parse_line(text)
    assert refused.value.what == told


def test_each_word_that_begins_a_line_has_a_form_unless_it_stands_alone() -> None:
    alone = {word for word in RESERVED if form_of(word) == ""}
    bare = {word for word, arguments in {**INSTRUCTIONS, **MANNERS}.items() if not arguments}
    assert alone == bare | {"THEN", "ELSE", "DO", "TO", "STEP", "OF", "ANY", "END", "AND", "OR", "NOT", "MOD"}
