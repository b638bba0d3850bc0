"""`python -m benchmarks`: measure, print a table, write out/bench.json. Keep the machine quiet meanwhile."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks import lockstep, wakeup
from benchmarks.rows import Row, machine, save

OUTPUT = Path("out/bench.json")


def main() -> None:
    """Run everything, or the groups named on the command line (lockstep, wakeup)."""
    groups = {"lockstep": lockstep.rows, "wakeup": wakeup.rows}
    chosen = sys.argv[1:] or list(groups)
    console, rows = Console(), list[Row]()
    for name in chosen:
        if name not in groups:
            sys.exit(f"no benchmark {name!r}; there are: {', '.join(groups)}")
        for row in groups[name]():
            console.print(f"{row.name}: {row.value:.4g} {row.unit}", style="dim")
            rows.append(row)
    table = Table(title=machine(), title_justify="left")
    for heading in ("figure", "value", "unit", "reference", "ratio"):
        table.add_column(heading)
    for row in rows:
        peer = ("", "") if row.ratio is None else (f"{row.reference:.4g}", f"{row.ratio:.3g}")
        table.add_row(row.name, f"{row.value:.4g}", row.unit, *peer)
    console.print(table)
    save(rows, OUTPUT)
    console.print(f"written to {OUTPUT}")


if __name__ == "__main__":
    main()
