"""`python -m tests.fault_matrix`: faults under many conditions, as a table of the worst of each.

Every fault is injected at 0.02 to 1.5 rad/s, at rest and in motion, with and without a load nobody knows, while the
frames of the stream come evenly, late, with gaps, or to a servo that is kept from running now and then. Without a fault
nothing may stop the arm; with one no joint may go further from its path than the bound while it has torque.

    python -m tests.fault_matrix                 everything, some ten minutes
    python -m tests.fault_matrix --quick         a slice of it
    python -m tests.fault_matrix --json FILE     every single result
    python -m tests.fault_matrix --show          every single result that is out of its bounds

Ends with 0 when every result is within its bounds.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Final

from tests.fault_matrix.campaign import FAULTS, Row, conditions, run, table

QUICK: Final = 23  # one of so many conditions


def main() -> int:
    """Run the campaign as the command line asks for; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m tests.fault_matrix", description=__doc__.split("\n\n", 1)[0])
    parser.add_argument("--quick", action="store_true", help="a slice of the conditions")
    parser.add_argument("--show", action="store_true", help="list what is out of its bounds")
    parser.add_argument("--json", type=Path, help="write every single result to this file")
    parser.add_argument("--fault", help="only faults whose name contains this")
    options = parser.parse_args()
    rows: list[Row] = []
    for fault in FAULTS:
        if options.fault is None or options.fault in fault.name:
            rows += run(fault, conditions(QUICK if options.quick else 1))
            print(f"{fault.name}: {sum(row.fault is fault for row in rows)} trials", file=sys.stderr)
    print(table(rows))
    wrong = [row for row in rows if row.wrong]
    for row in wrong if options.show else ():
        print(f"{row.fault.name}, {row.conditions}: {row.wrong}")
    if options.json:
        options.json.write_text(json.dumps([_plain(row) for row in rows], indent=1))
    print(f"{len(rows)} trials, {len(wrong)} out of bounds")
    return 1 if wrong else 0


def _plain(row: Row) -> dict[str, object]:
    result = asdict(row.result) | {key: getattr(row.result, key).name for key in ("code", "ends", "mode")}
    return {"fault": row.fault.name, "wrong": row.wrong, **asdict(row.conditions), **result}


if __name__ == "__main__":
    sys.exit(main())
