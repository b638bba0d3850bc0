"""From the plain docstrings of the source to reStructuredText, for the API pages.

Docstrings are written to be read in an editor: prose, formulas and examples indented by four, Markdown tables, trees
drawn with lines. Whatever is drawn or indented becomes a literal block; in prose a | stands for itself.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import groupby

_DRAWN = re.compile(r"^\s*\|.*\|$|[├└│]")
_CODE_OR_BAR = re.compile(r"(`[^`]*`)(\w?)|\|")
_LITERAL_MARK = re.compile(r"::$")  # what follows is indented, and marked for that
_INDENT = "    "


def to_restructured_text(lines: Iterable[str]) -> list[str]:
    """The docstring `lines`, dedented, as reStructuredText."""
    return [line for paragraph in _paragraphs(lines) for line in (*_marked_up(paragraph), "")]


def _paragraphs(lines: Iterable[str]) -> Iterator[list[str]]:
    for filled, group in groupby(lines, key=lambda line: bool(line.strip())):
        if filled:
            yield list(group)


def _marked_up(paragraph: list[str]) -> list[str]:
    if any(_DRAWN.search(line) for line in paragraph) or all(line.startswith(_INDENT) for line in paragraph):
        return ["::", "", *(_INDENT + line for line in paragraph)]
    return [_CODE_OR_BAR.sub(_escaped, _LITERAL_MARK.sub(":", line)) for line in paragraph]


def _escaped(found: re.Match[str]) -> str:
    """A bar escaped; code parted from a letter that follows at once, as in the plural of a name."""
    code, letter = found[1], found[2]
    if code is None:
        return r"\|"
    return rf"{code}\ {letter}" if letter else code
