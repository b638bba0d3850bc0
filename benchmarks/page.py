"""The measured part of docs/performance.md."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from benchmarks.machine import described
from benchmarks.rows import Row

PAGE: Final = Path(__file__).parents[1] / "docs" / "performance.md"
_PART: Final = re.compile(r"(<!-- measured(?:: (\w+))? -->\n).*?(<!-- end -->)", re.DOTALL)
COLUMNS: Final = {"Wake-up": ("p50", "p99", "p99.9", "> T/2", "> T", "CPU"), "RCI": ("p50", "p99", "missed")}


def own_parts(page: str) -> set[str]:
    """Benchmarks whose rows have a part of the page to themselves; all others share one, and are measured together."""
    return {group for _, group, _ in _PART.findall(page) if group}


def rewrite(page: str, rows: Sequence[Row], machine: Mapping[str, Any]) -> str:
    """The page with each measured part made anew for which there are rows.

    Raises ValueError when it has no part for some of them.
    """
    own, parts = own_parts(page), dict[str, list[Row]]()
    for each in rows:
        parts.setdefault(each.group if each.group in own else "", []).append(each)
    if parts.keys() - {group for _, group, _ in _PART.findall(page)}:
        raise ValueError("the page has no part between <!-- measured --> and <!-- end -->")

    def anew(found: re.Match[str]) -> str:
        if not (of_part := parts.get(found[2] or "")):
            return found[0]
        part = "\n\n".join([f"Measured on {described(dict(machine))}.", *figures(of_part), *cases(of_part)])
        return f"{found[1]}\n{part}\n\n{found[3]}"

    return _PART.sub(anew, page)


def figures(rows: Iterable[Row]) -> list[str]:
    """A table of everything but what has one of its own, a line each; none for nothing."""
    lines = [[r.name, _value(r.value, r.unit), _peer(r), _ratio(r), r.goal, _met(r)] for r in rows if not r.labels]
    return [table([["figure", "value", "against", "ratio", "goal", "met"], *lines])] if lines else []


def cases(rows: Iterable[Row]) -> list[str]:
    """One table for each kind and load: a line for each rate and loop, a column for each figure."""
    found: dict[tuple[str, str], dict[tuple[str, str], dict[str, Row]]] = {}
    for r in rows:
        if r.labels:
            of = found.setdefault((r.labels["table"], r.labels["load"]), {})
            of.setdefault((r.labels["rate"], r.labels["loop"]), {})[r.labels["figure"]] = r
    return [f"{name}, {load}:\n\n{table(_lines(COLUMNS[name], of))}" for (name, load), of in found.items()]


def _lines(columns: Sequence[str], cases: Mapping[tuple[str, str], Mapping[str, Row]]) -> list[list[str]]:
    """Lines of a table; the judgement is left out where no line has a goal."""
    lines = [["rate", "loop", *columns, "goals met"]]
    for (rate, loop), found in cases.items():
        cells = [_value(found[name].value, found[name].unit) if name in found else "" for name in columns]
        judged = [r for r in found.values() if r.met is not None]
        lines.append([rate, loop, *cells, f"{sum(bool(r.met) for r in judged)} of {len(judged)}" if judged else ""])
    return lines if any(line[-1] for line in lines[1:]) else [line[:-1] for line in lines]


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
