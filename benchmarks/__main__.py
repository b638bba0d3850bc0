"""`python -m benchmarks`: measure, print a table, write out/bench.json. Keep the machine quiet meanwhile."""

from __future__ import annotations

import json as json_format
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from cyclopts import App
from rich.console import Console
from rich.table import Table

from benchmarks import page
from benchmarks.machine import described, machine
from benchmarks.rows import Row, load, save
from benchmarks.timing import FULL, QUICK, Effort

OUTPUT: Final = Path("out/bench.json")
# Wake-ups last: they pin this process to processors and lock its memory.
GROUPS: Final = (
    "laws",
    "models",
    "kinematics",
    "trajectory",
    "servo",
    "fences",
    "lockstep",
    "transports",
    "logs",
    "identification",
    "startup",
    "c_programs",
    "move_requests",
    "multi_rccl",
    "rci",
    "wakeup",
)

app = App(name="python -m benchmarks", help="How fast QRobot is on this machine, and against whom.")
console = Console(width=None if sys.stdout.isatty() else 140)


@app.default
def bench(*groups: str, quick: bool = False, write_docs: bool = False, output: Path = OUTPUT) -> int:
    """Measure, print a table and write it as JSON. A full run takes half an hour of a quiet machine.

    Parameters
    ----------
    groups
        Only these: laws, models, kinematics, trajectory, servo, fences, lockstep, transports, logs, identification,
        startup, c_programs, move_requests, multi_rccl, rci, wakeup.
    quick
        A few seconds: shows that everything runs, not how fast.
    write_docs
        Put the tables into docs/performance.md as well: of all benchmarks, or of those with a part of their own there.
    output
        The JSON file.
    """
    unknown = [name for name in groups if name not in GROUPS]
    if unknown:
        console.print(f"no benchmark {unknown[0]!r}; there are: {', '.join(GROUPS)}")
        return 2
    own = page.own_parts(page.PAGE.read_text())
    if write_docs and groups and (shared := set(groups) - own):
        console.print(
            f"{', '.join(sorted(shared))}: shares its part of the page with others, and they are measured together; "
            f"with --write-docs name none, or of {', '.join(sorted(own))}"
        )
        return 2
    facts, rows = machine(), list[Row]()
    for row in measured(groups or GROUPS, QUICK if quick else FULL):
        console.print(f"{row.name}: {page.number(row.value)} {row.unit}", style="dim", highlight=False)
        rows.append(row)
    console.print(results_table(rows, described(facts)))
    save(rows, facts, output)
    console.print(f"written to {output}")
    if write_docs:
        write_page(output)
    return 0


@app.command
def docs(source: Path = OUTPUT) -> int:
    """Put the tables of an earlier run into docs/performance.md.

    Parameters
    ----------
    source
        The JSON file of that run.
    """
    write_page(source)
    return 0


@app.command
def soak(*, hours: float = 1.0, seed: int = 0, rigid: bool = False, json: Path | None = None) -> int:
    """Hours of emulated operation in lock-step at 4 kHz: random moves, every cycle logged and counted.

    Parameters
    ----------
    hours
        Robot time; an hour takes five to ten minutes.
    seed
        Of the moves and of the board's noise.
    rigid
        The rigid plant instead of MuJoCo.
    json
        Write the result to this file as well.
    """
    from benchmarks.soak import Soak
    from benchmarks.soak import soak as run

    with console.status("starting") as status:

        def progress(so_far: Soak) -> None:
            status.update(f"{so_far.robot_s:.0f} of {hours * 3600:.0f} s, {so_far.fault or 'no fault'}")

        result = run(hours, seed, "rigid" if rigid else "mujoco", progress=progress)
    _report(result.to_dict(), json)
    return 1 if result.failures else 0


@app.command
def stalls(deployment: Path, *, times: int = 100, seed: int = 0, json: Path | None = None) -> int:
    """Stop all processes of a moving emulated arm at once, for 5 to 500 ms, again and again: nothing may come of it.

    Parameters
    ----------
    deployment
        File with one emulated arm; nobody else may run it.
    times
        How often.
    seed
        Of lengths and pauses.
    json
        Write the result to this file as well.
    """
    from dataclasses import asdict
    from tempfile import TemporaryDirectory

    from benchmarks.stalls import stalls as run

    with TemporaryDirectory() as folder, console.status("stalling"):
        result = run(deployment, Path(folder), times, seed)
    _report(asdict(result), json)
    return 1 if result.events else 0


@app.command
def busy(deployment: Path, *, minutes: float = 10.0, json: Path | None = None) -> int:
    """Swing an emulated arm beside one program a processor that computes all the time: is it stopped?

    Parameters
    ----------
    deployment
        File with one emulated arm; nobody else may run it.
    minutes
        For how long.
    json
        Write the result to this file as well.
    """
    from dataclasses import asdict
    from tempfile import TemporaryDirectory

    from benchmarks.busy import Busy
    from benchmarks.busy import busy as run

    with TemporaryDirectory() as folder, console.status("starting") as status:

        def progress(now: Busy) -> None:
            status.update(f"{now.seconds:.0f} of {60.0 * minutes:.0f} s, {now.late_cycles} late cycles")

        result = run(deployment, Path(folder), 60.0 * minutes, progress)
    _report(asdict(result), json)
    return 1 if result.events else 0


@app.command
def guardian(deployment: Path, *, times: int = 20, seed: int = 0, json: Path | None = None) -> int:
    """Kill the servo of an emulated arm in motion, again and again: how soon is it without torque and power?

    Parameters
    ----------
    deployment
        File with one emulated arm; nobody else may run it. The guardian's bound stands there.
    times
        How often.
    seed
        Of the moments.
    json
        Write the result to this file as well.
    """
    from dataclasses import asdict
    from tempfile import TemporaryDirectory

    from benchmarks.guardian import Reactions, reactions

    with TemporaryDirectory() as folder, console.status("starting") as status:

        def progress(now: Reactions) -> None:
            status.update(f"{len(now.safe_ms)} of {times}, {max(now.safe_ms):.1f} ms at most")

        result = reactions(deployment, Path(folder), times, seed, progress)
    _report(asdict(result), json)
    return 1 if result.late else 0


@app.command
def pendant(deployment: str = "two_arms", *, seconds: float = 15.0, json: Path | None = None) -> int:
    """Two arms in motion with and without a pendant of four pages, in turns: servo, server, age of what a page gets.

    Parameters
    ----------
    deployment
        File with emulated arms, or the name of a packaged one; nobody else may run them.
    seconds
        Of each of the four turns.
    json
        Write the result to this file as well.
    """
    from dataclasses import asdict
    from tempfile import TemporaryDirectory

    from benchmarks.pendant import pendant as run

    with TemporaryDirectory() as folder, console.status("measuring"):
        result = run(deployment, Path(folder), seconds)
    _report(asdict(result), json)
    return 1 if result.ended else 0


@app.command
def c_moves(*, moves: int = 100_000, json: Path | None = None) -> int:
    """So many moves of a program in C, off line: memory and descriptors of program and engine must not grow.

    Parameters
    ----------
    moves
        How many; a thousand take some seven seconds.
    json
        Write the result to this file as well.
    """
    from benchmarks.c_moves import Held
    from benchmarks.c_moves import c_moves as run

    with console.status("starting") as status:

        def progress(now: Held) -> None:
            status.update(f"{now.samples} samples, {now.engine_bytes >> 10} KiB and {now.program_bytes >> 10} KiB")

        result = run(moves, progress)
    _report(result.to_dict(), json)
    return 1 if result.failures else 0


def _report(found: dict[str, Any], path: Path | None) -> None:
    report = json_format.dumps(found, indent=2)
    console.print(report, highlight=False)
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(report + "\n")


def measured(groups: tuple[str, ...], effort: Effort) -> Iterator[Row]:
    """All rows of these groups."""
    for name in groups:
        rows: Callable[[Effort], Iterator[Row]] = import_module(f"benchmarks.{name}").rows
        yield from (replace(each, group=name) for each in rows(effort))


def results_table(rows: list[Row], title: str) -> Table:
    """The rows for people; of those with a table of their own only those with a goal."""
    table = Table(title=title, title_justify="left")
    for heading in ("figure", "value", "against", "ratio", "goal", "met"):
        table.add_column(heading)
    for row in rows:
        if not row.labels or row.met is not None:
            peer = f"{page.number(row.reference)} {row.peer}" if row.reference is not None else ""
            ratio = page.number(row.ratio) if row.ratio is not None else ""
            met = "" if row.met is None else "[green]yes[/]" if row.met else "[red]no[/]"
            table.add_row(row.name, f"{page.number(row.value)} {row.unit}", peer, ratio, row.goal, met)
    return table


def write_page(source: Path) -> None:
    """Rewrite the measured part of the page."""
    rows, facts = load(source)
    page.PAGE.write_text(page.rewrite(page.PAGE.read_text(), rows, facts))
    console.print(f"written to {page.PAGE}")


if __name__ == "__main__":
    sys.exit(app())
