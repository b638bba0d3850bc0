"""docs/docstrings.py: what is drawn or indented stays as it is drawn, prose stays prose."""

from __future__ import annotations

import runpy
from pathlib import Path

DOCSTRINGS = runpy.run_path(str(Path(__file__).parents[3] / "docs/docstrings.py"))


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
