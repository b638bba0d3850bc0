"""Of a test with many cases or examples `make test` runs a part: always the same one, of the size asked for."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import settings

from tests.support import thorough
from tests.support.thorough import examples, mark_thorough


class Case:
    """What pytest knows of one case of a test."""

    def __init__(self, name: str, a: int, b: int, sampled: int | None) -> None:
        self.nodeid, self._sampled = f"tests/unit/project/test_thorough.py::{name}[{a}-{b}]", sampled
        self.callspec = SimpleNamespace(indices={"a": a, "b": b}, params={"a": a, "b": b})
        self.added: list[str] = []

    def get_closest_marker(self, name: str) -> Any:
        return None if self._sampled is None or name != "sampled" else pytest.mark.sampled(self._sampled).mark

    def add_marker(self, marker: Any) -> None:
        self.added.append(marker.name)


def left(cases: list[Any]) -> list[str]:
    """Names of the cases that `make test` runs."""
    mark_thorough(cases)
    assert all(case.added in ([], ["thorough"]) for case in cases)
    return [case.nodeid for case in cases if not case.added]


def many(name: str, sampled: int | None) -> list[Any]:
    return [Case(name, a, b, sampled) for a in range(8) for b in range(5)]


def test_of_each_test_that_is_sampled_so_many_cases_are_left_and_of_others_all() -> None:
    assert len(left(many("test_wide", 7) + many("test_other", 3) + many("test_small", None))) == 7 + 3 + 40


def test_the_sample_is_the_same_in_whatever_order_cases_are_collected() -> None:
    assert set(left(many("test_wide", 7))) == set(left(many("test_wide", 7)[::-1]))


def test_a_sample_larger_than_the_test_is_all_of_it() -> None:
    assert len(left(many("test_wide", 100))) == 40


def test_a_sample_has_every_value_of_every_parameter_as_often_as_it_can() -> None:
    kept = [name.partition("[")[2].strip("]").split("-") for name in left(many("test_wide", 16))]
    assert set(Counter(first for first, _ in kept).values()) == {2}
    assert set(Counter(second for _, second in kept).values()) == {3, 4}


def test_things_are_values_too_wherever_pytest_says_that_they_stand() -> None:
    """Of a table that is handed to a test it says the number of the case, of each parameter."""
    things, cases = [object() for _ in range(8)], many("test_things", 8)
    for k, case in enumerate(cases):
        case.callspec.params["a"] = things[case.callspec.params["a"]]
        case.callspec.indices = {"a": k, "b": k}
    mark_thorough(cases)
    kept = [case.callspec.params["a"] for case in cases if not case.added]
    assert len(set(map(id, kept))) == 8


def test_values_of_rows_of_a_table_are_told_apart() -> None:
    rows = [("gcc", "-O0"), ("gcc", "-O2"), ("clang", "-O0"), ("clang", "-O2")]
    cases = [Case("test_rows", k, 0, 2) for k in range(len(rows))]
    for case, (compiler, flag) in zip(cases, rows, strict=True):
        case.callspec.params = {"compiler": compiler, "flag": flag, "program": object()}
    kept = left(cases)
    first, second = (row for case, row in zip(cases, rows, strict=True) if case.nodeid in kept)
    assert first[0] != second[0]
    assert first[1] != second[1]


@pytest.mark.parametrize(("part", "tried"), [(False, [1, 25, 50]), (True, [1, 13, 25])])
def test_of_a_property_half_of_its_examples_are_tried_and_at_least_one(
    monkeypatch: pytest.MonkeyPatch, part: bool, tried: list[int]
) -> None:
    monkeypatch.setattr(thorough, "_part", part)
    assert [examples(number) for number in (1, 25, 50)] == tried


def test_this_run_tries_what_it_was_asked_for(request: pytest.FixtureRequest) -> None:
    part = "not thorough" in request.config.option.markexpr
    assert settings.default is not None
    assert settings.default.max_examples == examples(50) == (25 if part else 50)
