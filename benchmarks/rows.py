"""One figure and how it is kept."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal


@dataclass(frozen=True)
class Goal:
    """What a figure is meant to reach: reported, never asserted, for the machine is part of it."""

    limit: float
    of: Literal["value", "ratio"] = "value"
    at_least: bool = False

    def holds(self, value: float, ratio: float | None) -> bool:
        """Whether a row meets it; a ratio that could not be had meets nothing."""
        number = value if self.of == "value" else ratio
        if number is None:
            return False
        return number >= self.limit if self.at_least else number <= self.limit

    def __str__(self) -> str:
        return f"{'ratio ' if self.of == 'ratio' else ''}{'≥' if self.at_least else '≤'} {self.limit:g}"


@dataclass(frozen=True)
class Row:
    """One figure.

    Attributes:
        name: what was measured.
        value: in `unit`.
        unit: of `value` and `reference`.
        reference: the same of the peer, measured in the same run; None without one.
        ratio: `value` over `reference`.
        peer: who the reference is, "" for none.
        goal: in words, "" for none.
        met: whether the goal was reached, None without one.
        labels: for tables with a row per case and a column per `figure`.
        group: the benchmark that it belongs to.
    """

    name: str
    value: float
    unit: str
    reference: float | None = None
    ratio: float | None = None
    peer: str = ""
    goal: str = ""
    met: bool | None = None
    labels: Mapping[str, str] = field(default_factory=dict)
    group: str = ""


def row(name: str, value: float, unit: str, goal: Goal | None = None, **labels: str) -> Row:
    """A figure that stands alone."""
    met = goal.holds(value, None) if goal else None
    return Row(name, value, unit, goal=str(goal or ""), met=met, labels=labels)


def against(
    name: str, value: float, unit: str, peer: str, reference: float, goal: Goal | None = None, **labels: str
) -> Row:
    """A figure beside that of a peer."""
    ratio = value / reference if reference else None
    met = goal.holds(value, ratio) if goal else None
    return Row(name, value, unit, reference, ratio, peer, str(goal or ""), met, labels)


def save(rows: Sequence[Row], machine: Mapping[str, Any], path: Path) -> None:
    """Write the rows and the machine they were measured on as JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    document = {"machine": dict(machine), "rows": [asdict(each) for each in rows]}
    path.write_text(json.dumps(document, indent=2) + "\n")


def load(path: Path) -> tuple[list[Row], dict[str, Any]]:
    """What `save` has written: rows and machine."""
    document = json.loads(path.read_text())
    return [Row(**each) for each in document["rows"]], document["machine"]
