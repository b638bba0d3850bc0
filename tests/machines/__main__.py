"""`python -m tests.machines [ROW ...] [--times N] [FILE ...]`: do the tests pass on any machine, without reruns?

Each row of `rows.py` is a machine made out of this one: quiet, busy, one processor, half a processor, a wall clock that
goes ten times as fast or as slow. Without a row all of them, without a file the whole suite: some two hours. With half
a processor a test on the wall clock may be run again, and is named then.
Ends with a table, and with 1 when a test failed anywhere.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from tests.machines.rows import ROWS, VIRTUAL, Place

NO_TESTS: Final = 5  # of pytest: none of the files has one for this part


@dataclass(frozen=True)
class Run:
    """One part of the suite in one row."""

    row: str
    part: str
    passed: bool
    seconds: float
    last_line: str


def run_part(row: str, part: Sequence[str], place: Place, files: Sequence[str]) -> Run:
    """Run a part of the suite and show what it says."""
    command = [sys.executable, "-m", "pytest", "-q", "--no-header", *part, *files]
    if part == VIRTUAL and place.workers > 1 and not files:
        command += ["--numprocesses", str(place.workers), "--dist", "loadfile", "--no-loadscope-reorder"]
    environment = os.environ | {"QROBOT_RERUNS": "0"} | place.environment
    began = time.monotonic()
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    last = ""
    with process:
        assert process.stdout is not None
        for line in process.stdout:
            print(line, end="", flush=True)
            last = line.strip(" =\n") or last
    return Run(row, " ".join(part), process.returncode in (0, NO_TESTS), time.monotonic() - began, last)


def run_row(name: str, files: Sequence[str]) -> list[Run]:
    """Run all parts of a row."""
    row = ROWS[name]
    print(f"--- {name}: {row.what}", flush=True)
    with ExitStack() as stack:
        place = row.make(stack)
        return [run_part(name, part, place, files) for part in row.parts]


def tell(runs: Sequence[Run]) -> int:
    """Print the table; the status of this program."""
    print()
    for run in runs:
        verdict = "passed" if run.passed else "FAILED"
        print(f"{run.row:6} {run.part:16} {verdict} {run.seconds:6.0f} s  {run.last_line}")
    return 0 if runs and all(run.passed for run in runs) else 1


def main() -> int:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(prog="python -m tests.machines", description=(__doc__ or "").partition("\n\n")[0])
    parser.add_argument("what", nargs="*", help=f"rows ({', '.join(ROWS)}) and files or tests")
    parser.add_argument("--times", type=int, default=1, help="so many times each row")
    options = parser.parse_args()
    rows = [word for word in options.what if word in ROWS] or list(ROWS)
    files = [word for word in options.what if word not in ROWS]
    for file in files:
        if not Path(file.partition("::")[0]).exists():
            parser.error(f"{file} is neither a row ({', '.join(ROWS)}) nor a file")
    return tell([run for name in rows for _ in range(options.times) for run in run_row(name, files)])


if __name__ == "__main__":
    sys.exit(main())
