"""Wide forms of tests: of one with many cases or examples `make test` runs a part, and `make thorough` all."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from hashlib import sha256
from typing import Any

import pytest

_part = False  # of the examples of each property


def wide(*values: object) -> list[Any]:
    """Values of a parameter for `make thorough` alone."""
    return [pytest.param(value, marks=pytest.mark.thorough) for value in values]


def wide_rows(*rows: tuple[object, ...]) -> list[Any]:
    """Rows of several parameters for `make thorough` alone."""
    return [pytest.param(*row, marks=pytest.mark.thorough) for row in rows]


def run_a_part(part: bool) -> None:
    """Have properties tried with a part of their `examples`, or with all; before tests are collected."""
    global _part  # noqa: PLW0603 (test files ask for it as they are imported)
    _part = part


def examples(number: int) -> int:
    """Number of examples of a property, or of a loop's tries: that in `make thorough`, half of it in `make test`."""
    return -(-number // 2) if _part else number


def mark_thorough(items: Iterable[pytest.Item]) -> None:
    """Mark what is beyond the sample of a test that is marked `sampled(n)`.

    The sample depends on names and parameters of the cases alone: it is the same in each run and each worker. It has
    the values of each parameter as often as each other, as nearly as may be.
    """
    tests: dict[tuple[str, int], list[Any]] = defaultdict(list)
    for item in items:
        if (sampled := item.get_closest_marker("sampled")) is not None:
            tests[item.nodeid.partition("[")[0], sampled.args[0]].append(item)
    for (_, size), cases in tests.items():
        sample = {case.nodeid for case in _sample(cases, size)}
        for case in cases:
            if case.nodeid not in sample:
                case.add_marker(pytest.mark.thorough)


def _sample(cases: Sequence[Any], size: int) -> list[Any]:
    """Cases one after the other: next is the one whose values were there least so far."""
    rest = sorted(cases, key=lambda case: sha256(case.nodeid.encode()).digest())
    uses: Counter[tuple[str, object]] = Counter()
    sample = []
    while rest and len(sample) < size:
        case = min(rest, key=lambda each: sum(uses[value] for value in _values(each)))
        rest.remove(case)
        sample.append(case)
        uses.update(_values(case))
    return sample


def _values(case: Any) -> list[tuple[str, object]]:
    """Values of its parameters: plain ones as such, of others which thing of their table it is."""
    return [
        (name, value if isinstance(value, str | int | float | bool) else (id(value),))
        for name, value in case.callspec.params.items()
    ]
