"""docs/reference/glossary.md: one word, one meaning; one definition of each class name."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[3]
SOURCES = sorted((ROOT / "qrobot").rglob("*.py"))
PAGE = (ROOT / "docs/reference/glossary.md").read_text()
TERMS = re.findall(r"^\| ([^|]+?) \| ([^|]+?) \| ([^|]*?) ?\|$", PAGE, re.MULTILINE)[1:]


# Words of the last column that are the field's own elsewhere: brakes of an arm, contact in physics, residuals in
# statistics, corners of a box; `reset` of Python; and names of faults, configuration and wire, which are fixed.
AT_HOME_ELSEWHERE = {"brake", "contact", "corner", "form", "guard", "reset", "residual", "unseen", "visitor", "vote"}
AT_HOME_ELSEWHERE |= {"halt"}
NOT_IN_ROOM = {"qrobot/motion": {"corner", "halt", "contact"}, "qrobot/rccl": {"halt"}}


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


def refused_words() -> set[str]:
    return {word.strip() for _, _, words in TERMS for word in words.split(",") if word.strip(" -")}


def identifiers(path: Path) -> set[str]:
    """Names that a file gives: of classes, functions, arguments, variables and attributes."""
    found = set()
    for node in ast.walk(tree(path)):
        match node:
            case ast.ClassDef(name=name) | ast.FunctionDef(name=name) | ast.arg(arg=name):
                found.add(name)
            case ast.Name(id=name, ctx=ast.Store()) | ast.Attribute(attr=name, ctx=ast.Store()):
                found.add(name)
    return found


def parts(identifier: str) -> set[str]:
    """The words of an identifier in small letters, a plural's without its s: `_fastLegs` has fast and leg."""
    words = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", identifier)
    return {form for word in words for form in (word.lower(), word.lower().removesuffix("s"))}


def public_types(path: Path) -> list[str]:
    """Classes of a file and its aliases of types, those with a name of their own for use elsewhere."""
    names = []
    for node in tree(path).body:
        match node:
            case ast.ClassDef(name=name) | ast.AnnAssign(target=ast.Name(id=name)):
                names.append(name)
            case ast.Assign(targets=[ast.Name(id=name)]):
                names.append(name)
    return [name for name in names if re.match("[A-Z].*[a-z]", name)]


def test_each_class_name_has_one_definition() -> None:
    places = defaultdict(list)
    for path in SOURCES:
        for name in public_types(path):
            places[name].append(str(path.relative_to(ROOT)))
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_terms_stand_in_order_and_once() -> None:
    names = [term for term, _, _ in TERMS if term != "---"]
    assert len(names) > 50
    assert names == sorted(set(names))


def test_no_file_has_the_name_of_what_a_thing_is_not_called() -> None:
    refused = refused_words()
    assert len(refused) > 10
    assert [str(path.relative_to(ROOT)) for path in SOURCES if path.stem in refused] == []


def test_no_identifier_has_the_name_of_what_a_thing_is_not_called() -> None:
    refused = refused_words() - AT_HOME_ELSEWHERE
    assert {"errand", "leg", "course", "chart", "trail", "news", "aim", "desk", "road"} <= refused
    found = {}
    for path in SOURCES:
        place = str(path.relative_to(ROOT))
        words = refused.union(*(more for room, more in NOT_IN_ROOM.items() if place.startswith(room)))
        if named := sorted(name for name in identifiers(path) if parts(name) & words):
            found[place] = named
    assert found == {}
