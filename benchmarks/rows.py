"""One figure and how it is kept."""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter


@dataclass(frozen=True)
class Row:
    """`value` in `unit`; `reference` is the same of the peer named in `name`, `ratio` their quotient, or None."""

    name: str
    value: float
    unit: str
    reference: float | None = None
    ratio: float | None = None


def against(name: str, value: float, unit: str, reference: float) -> Row:
    """A row with its peer."""
    return Row(name, value, unit, reference, value / reference)


def best_of(repeats: int, work: Callable[[], object]) -> float:
    """Shortest of several durations of `work`, s: the one with least disturbance by others."""
    durations = []
    for _ in range(repeats):
        began = perf_counter()
        work()
        durations.append(perf_counter() - began)
    return min(durations)


def machine() -> str:
    """The machine in a few words."""
    model = platform.processor()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        names = [line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line]
        model = f"{len(names)} x {names[0]}" if names else model
    return f"{model}, Linux {platform.release()}, Python {platform.python_version()}"


def save(rows: Sequence[Row], path: Path) -> None:
    """Write the rows as JSON."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"machine": machine(), "rows": [asdict(row) for row in rows]}, indent=2) + "\n")
