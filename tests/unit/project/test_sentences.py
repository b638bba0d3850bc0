"""The first sentence of a docstring says what the thing is or does: it begins with a noun phrase or a verb."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCES = Path(__file__).parents[3] / "qrobot"
# With these a sentence begins whose subject is elsewhere or missing: "Of a window ...", "What is said is no error."
WORDS = (
    "about after against and as at because before behind below beneath beside between but by during for from how "
    "if in inside instead into it like of off on once onto or out outside over per since so somewhere than that "
    "their them then there these they those through till to toward towards under unless until up what whatever "
    "when whenever where wherever which while who whoever whom whose why with within without "
)
NO_SUBJECT = frozenset(WORDS.split())
PACKAGES = sorted({path.relative_to(SOURCES).parts[0] for path in SOURCES.rglob("*.py")})


def first_words(text: str) -> Iterator[tuple[int, str]]:
    """Line and first word of every docstring of a source file."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            docstring = ast.get_docstring(node)
            if docstring:
                yield node.body[0].lineno, docstring.split()[0].strip(",.:;()").lower()


def without_subject(text: str) -> list[tuple[int, str]]:
    return sorted((line, word) for line, word in first_words(text) if word in NO_SUBJECT)


@pytest.mark.parametrize("package", PACKAGES)
def test_a_docstring_begins_with_a_noun_phrase_or_a_verb(package: str) -> None:
    files = [SOURCES / package] if package.endswith(".py") else sorted((SOURCES / package).rglob("*.py"))
    found = {str(path.relative_to(SOURCES)): without_subject(path.read_text()) for path in files}
    assert {name: places for name, places in found.items() if places} == {}


@pytest.mark.parametrize(
    ("docstring", "words"),
    [
        ("Of a window (1 - x^2)^2 and its derivatives.", ["of"]),
        ("What is said is no error.", ["what"]),
        ("Weights of a window.", []),
        ("Subsample a window.", []),
        ("(6,) joint positions.", []),
        ("`True` while it runs.", []),
    ],
)
def test_the_check_tells_a_missing_subject(docstring: str, words: list[str]) -> None:
    assert [word for _, word in without_subject(f'def f():\n    """{docstring}"""\n')] == words
