"""docs/features.md keeps its promises: every identifier of the papers once, a real test behind every claim."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[3]
RANGES = (("A", 1, 50), ("B", 1, 49), ("C", 1, 23), ("C", 30, 62), ("D", 1, 26), ("E", 1, 39))
IDENTIFIERS = [f"{letter}-{number:02d}" for letter, first, last in RANGES for number in range(first, last + 1)]
STATES = {"works", "partly", "not yet"}
BOX = "test_a_box_is_traced_and_its_way_drawn_beside_the_one_asked_for"


class Row(NamedTuple):
    identifier: str
    feature: str
    state: str
    remark: str


def read_rows(text: str) -> list[Row]:
    lines = re.findall(r"^\| *([A-E]-\d+) *\|(.*)\|(.*)\|(.*)\|$", text, re.MULTILINE)
    return [Row(*(cell.strip() for cell in line)) for line in lines]


def named_tests(remark: str) -> list[str]:
    return re.findall(r"`(tests/[^`]+)`", remark)


@cache
def functions_of(path: Path) -> dict[str, bool]:
    """Functions of a file, and whether `make thorough` alone runs them."""
    nodes = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)]
    return {node.name: "pytest.mark.thorough" in map(ast.unparse, node.decorator_list) for node in nodes}


def complaint_about(row: Row) -> str | None:
    """What is wrong with the claim of a row, or None."""
    if row.state == "not yet":
        return None
    tests = named_tests(row.remark)
    if row.state == "works" and not tests:
        return f"{row.identifier} works, but no test is named"
    if row.state == "partly" and not re.sub(r"`[^`]*`|[,;. ]", "", row.remark):
        return f"{row.identifier} is there partly, but not what is missing"
    if missing := [test for test in tests if not is_test(test)]:
        return f"{row.identifier} names {missing[0]}: no such test"
    return f"{row.identifier}: `make thorough` alone shows it" if tests and all(map(is_thorough, tests)) else None


def is_test(test: str) -> bool:
    path, _, function = test.partition("::")
    return (ROOT / path).is_file() and (not function or function.split("::")[-1] in functions_of(ROOT / path))


def is_thorough(test: str) -> bool:
    path, _, function = test.partition("::")
    return functions_of(ROOT / path).get(function, False)


ROWS = read_rows((ROOT / "docs/features.md").read_text())


def test_every_identifier_stands_on_the_page_once_and_in_order() -> None:
    assert [row.identifier for row in ROWS] == IDENTIFIERS


def test_every_row_says_what_the_feature_is_and_one_of_three_states() -> None:
    assert [row.identifier for row in ROWS if not row.feature or row.state not in STATES] == []


def test_every_claim_names_its_test_or_what_is_missing() -> None:
    assert [complaint for row in ROWS if (complaint := complaint_about(row))] == []


@pytest.mark.parametrize(
    ("state", "remark", "expected"),
    [
        ("works", "", "no test is named"),
        ("works", "`tests/unit/test_nothing.py`", "no such test"),
        ("works", "`tests/unit/project/test_features_page.py::test_of_nothing`", "no such test"),
        ("partly", "`tests/unit/project/test_features_page.py`", "what is missing"),
        ("works", f"`tests/system/test_programs_live.py::{BOX}`", "`make thorough` alone shows it"),
    ],
)
def test_an_empty_claim_is_found(state: str, remark: str, expected: str) -> None:
    assert expected in str(complaint_about(Row("A-01", "anything", state, remark)))


def test_a_claim_with_its_test_is_accepted() -> None:
    remark = "`tests/unit/project/test_features_page.py::test_a_claim_with_its_test_is_accepted`"
    assert complaint_about(Row("A-01", "anything", "works", remark)) is None
