"""docs/docstrings.py: what is drawn or indented stays as it is drawn, prose stays prose."""

from __future__ import annotations

import ast
import re
import runpy
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[3]
DOCSTRINGS = runpy.run_path(str(ROOT / "docs/docstrings.py"))
SECTION_OR_LIST = re.compile(r".*:$|[-*] |\d+\. ")


def converted(text: str) -> str:
    return "\n".join(DOCSTRINGS["to_restructured_text"](text.splitlines()))


def test_prose_and_sections_pass_unchanged() -> None:
    text = "Copy the image.\n\nArgs:\n    image: int64[3], the words.\n\nRaises:\n    LinkError: there is none.\n"
    assert converted(text) == text


def test_an_indented_formula_becomes_a_literal_block() -> None:
    assert converted("A law:\n\n    tau = |q|\n    v = 0") == "A law:\n\n::\n\n        tau = |q|\n        v = 0\n"


def test_an_example_announced_by_a_double_colon_is_marked_once() -> None:
    assert converted("Use::\n\n    f(x)") == "Use:\n\n::\n\n        f(x)\n"


def test_a_table_and_a_tree_become_literal_blocks() -> None:
    assert converted("| a | b |\n|---|---|") == "::\n\n    | a | b |\n    |---|---|\n"
    assert converted("Base\n├── One\n└── Two") == "::\n\n    Base\n    ├── One\n    └── Two\n"


def test_a_bar_in_prose_is_escaped_and_one_in_code_is_not() -> None:
    assert converted("|x| is at most `a | b`.") == "\\|x\\| is at most `a | b`.\n"


def test_a_letter_right_behind_code_does_not_spoil_it() -> None:
    assert converted("Use their `Channel`s, `a` and `b`.") == "Use their `Channel`\\ s, `a` and `b`.\n"


def crooked(text: str) -> Iterator[str]:
    """First lines of paragraphs at the margin that go on indented, and are neither section, list nor drawn."""
    for paragraph in DOCSTRINGS["_paragraphs"](text.splitlines()):
        straight = not paragraph[0].startswith(" ") and any(line.startswith(" ") for line in paragraph)
        underlined = len(paragraph) > 1 and set(paragraph[1]) == {"-"}
        plain = DOCSTRINGS["to_restructured_text"](paragraph)[0] != "::"
        if straight and plain and not underlined and not SECTION_OR_LIST.match(paragraph[0]):
            yield paragraph[0]


def test_what_is_drawn_in_a_docstring_is_indented() -> None:
    found = {}
    for path in (ROOT / "qrobot").rglob("*.py"):
        nodes = ast.walk(ast.parse(path.read_text()))
        kinds = ast.Module | ast.ClassDef | ast.FunctionDef
        texts = [ast.get_docstring(node) or "" for node in nodes if isinstance(node, kinds)]
        found[str(path.relative_to(ROOT))] = [line for text in texts for line in crooked(text)]
    assert {name: lines for name, lines in found.items() if lines} == {}


def test_a_table_without_lines_at_the_margin_is_seen() -> None:
    assert list(crooked("A cycle.\n\nONE   first\n      and more\n\n- a list\n  goes on")) == ["ONE   first"]
