"""docs/reference/glossary.md: one word, one meaning; one definition of each class name."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).parents[3]
SOURCES = sorted((ROOT / "qrobot").rglob("*.py"))
PAGE = (ROOT / "docs/reference/glossary.md").read_text()
TERMS = re.findall(r"^\| ([^|]+?) \| ([^|]+?) \| ([^|]*?) ?\|$", PAGE, re.MULTILINE)[1:]


def public_types(path: Path) -> list[str]:
    """Classes of a file and its aliases of types, those with a name of their own for use elsewhere."""
    names = []
    for node in ast.parse(path.read_text()).body:
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
    refused = {word.strip() for _, _, words in TERMS for word in words.split(",") if word.strip(" -")}
    assert len(refused) > 10
    assert [str(path.relative_to(ROOT)) for path in SOURCES if path.stem in refused] == []
