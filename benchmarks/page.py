"""The measured part of docs/performance.md."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.machine import described
from benchmarks.rows import Row

PAGE: Final = Path(__file__).parents[1] / "docs" / "performance.md"
_PART: Final = re.compile(r"(<!-- measured -->\n).*?(<!-- end -->)", re.DOTALL)
WAKE_UP_FIGURES: Final = ("p50", "p99", "p99.9", "> T/2", "> T", "CPU")


def rewrite(page: str, rows: Sequence[Row], machine: Mapping[str, Any]) -> str:
    """The page with its measured part made anew. Raises ValueError when it has none."""
    part = "\n\n".join([f"Measured on {described(dict(machine))}.", figures(rows), *wake_ups(rows)])
    page, found = _PART.subn(lambda match: f"{match[1]}\n{part}\n\n{match[2]}", page)
    if not found:
        raise ValueError("the page has no part between <!-- measured --> and <!-- end -->")
    return page


def figures(rows: Iterable[Row]) -> str:
    """Everything but the wake-ups, a line each."""
    lines = [["figure", "value", "against", "ratio", "goal", "met"]]
    lines += [[r.name, _value(r.value, r.unit), _peer(r), _ratio(r), r.goal, _met(r)] for r in rows if not r.labels]
    return table(lines)


def wake_ups(rows: Iterable[Row]) -> list[str]:
    """One table for each load: a line for each rate and loop, a column for each figure."""
    cases: dict[str, dict[tuple[str, str], dict[str, Row]]] = {}
    for r in rows:
        if r.labels:
            case = cases.setdefault(r.labels["load"], {}).setdefault((r.labels["rate"], r.labels["loop"]), {})
            case[r.labels["figure"]] = r
    return [f"Wake-up, {load}:\n\n{table(_lines(of_load))}" for load, of_load in cases.items()]


def _lines(cases: Mapping[tuple[str, str], Mapping[str, Row]]) -> list[list[str]]:
    lines = [["rate", "loop", *WAKE_UP_FIGURES, "goals met"]]
    for (rate, loop), found in cases.items():
        cells = [_value(found[name].value, found[name].unit) if name in found else "" for name in WAKE_UP_FIGURES]
        judged = [r for r in found.values() if r.met is not None]
        met = f"{sum(bool(r.met) for r in judged)} of {len(judged)}" if judged else ""
        lines.append([rate, loop, *cells, met])
    return lines


def table(lines: Sequence[Sequence[str]]) -> str:
    """A Markdown table; the first line is its heading."""
    cells = [[cell.replace("|", "\\|") for cell in line] for line in lines]
    rule = ["---"] * len(cells[0])
    return "\n".join(f"| {' | '.join(line)} |" for line in [cells[0], rule, *cells[1:]])


def _value(value: float, unit: str) -> str:
    return f"{number(value)} {unit}".strip()


def number(value: float) -> str:
    """Three significant digits, without an exponent where people would not use one."""
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}"
    return f"{value:.1e}"


def _peer(row: Row) -> str:
    return "" if row.reference is None else f"{_value(row.reference, row.unit)} ({row.peer})"


def _ratio(row: Row) -> str:
    return "" if row.ratio is None else number(row.ratio)


def _met(row: Row) -> str:
    return "" if row.met is None else "yes" if row.met else "**no**"
