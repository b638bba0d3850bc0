"""`qrobot study`: what holds for one emulated arm, tried on many that are not what the robot file says."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import App, Parameter
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from qrobot.cli.console import err, note, out, print_table, write_json
from qrobot.cli.option_types import ArmCount, Factors, OutputFigure, OutputResults, PosesOption, Range, RateHz, Workers
from qrobot.errors import ConfigError

if TYPE_CHECKING:
    from rich.table import Table

    from qrobot.cli.study_tables import View
    from qrobot.study.campaign import Told
    from qrobot.study.results import Results
    from qrobot.study.study import Study

HELP: Final = """
Try something on many emulated arms, each off the robot file in its own way, on all processors or on many hosts.

How well are they identified? Which gains serve all of them? What came of it, also while it runs:

  qrobot study identify --arms 50 --output out/arms.jsonl
  qrobot study gains --arms 20 --output out/gains.jsonl
  qrobot study show out/arms.jsonl --plot arms.png

An arm is drawn by its number, so it is the same everywhere. Each outcome is kept as it comes in: after an interruption
the same command goes on, and one with more --arms adds to what is there.
"""

Arms = Annotated[ArmCount, Parameter(help="How many arms; number 0, 1, 2 and so on.")]
Plot = Annotated[OutputFigure | None, Parameter(help="Draw the outcome into this file (.png, .pdf, .svg).")]
Json = Annotated[bool, Parameter(help="Print the summary as JSON.")]
Stiction = Annotated[float, Parameter(validator=Range(1.0, 3.0))]
"""Friction at rest, times Coulomb friction."""
app = App(name="study", help=HELP, help_format="plaintext", group_commands="Commands")


@Parameter(name="*")
@dataclass(frozen=True)
class Campaign:
    """Options that all studies have."""

    output: Annotated[OutputResults, Parameter(help="Results file: gone on with when it exists (.jsonl).")]
    robot: Annotated[
        str, Parameter(help="Robot whose kind the arms are: a packaged one, or a file that every host has.")
    ] = "puma560"
    rate: Annotated[RateHz, Parameter(help="Of the servo, Hz.")] = 1000.0
    workers: Annotated[
        Workers | None,
        Parameter(help="Processes on this machine; default one for each processor; 1 is this one."),
    ] = None
    scheduler: Annotated[
        str | None, Parameter(help="Dask scheduler whose workers do it in place of those, as tcp://host:8786.")
    ] = None
    plot: Plot = None
    json: Json = False


@app.command
def identify(
    *,
    arms: Arms = 50,
    campaign: Campaign,
    poses: PosesOption = 24,
    torque: Literal["known", "unknown"] = "unknown",
    tracking: Annotated[bool, Parameter(negative="--no-tracking")] = True,
    stiction: Stiction = 1.0,
    dynamic: bool = False,
) -> None:
    """Identify arms that are up to 30 % off their file in masses, centres and friction, and hold up to 2.5 kg.

    Each makes the motions of a plan, is identified from them, and is judged by what only an emulator knows: the truth.

    Parameters
    ----------
    poses
        Of the plan, besides the sweeps.
    torque
        Motors give up to a fifth more or less than they are asked for. Known: somebody measured it, and wrote it into
        the robot file.
    tracking
        Also track the paper's experiment with the robot file, with the model found, and with the exact one.
    stiction
        Friction at rest over Coulomb friction; 1 is none, the mismatched plant has 1.3.
    dynamic
        Also make the fast runs, and identify inertia.
    """
    from qrobot.study.identification import IdentificationStudy

    study = IdentificationStudy(campaign.robot, campaign.rate, poses, torque, tracking, stiction, dynamic)
    _run(study, arms, campaign)


@app.command
def gains(
    *,
    arms: Arms = 20,
    campaign: Campaign,
    law: str = "qrobot",
    velocity: str = "difference",
    bandwidth: Factors = (0.5, 0.7, 1.0, 1.4, 2.0),
    damping: Factors = (0.5, 1.0),
) -> None:
    """Track the paper's experiment with a grid of gains on each of many arms, none as the robot file has it.

    Parameters
    ----------
    law
        Of the servo.
    velocity
        How it estimates velocities.
    bandwidth
        Factors on the natural frequency of the joints: Kp grows by the square, Kv in proportion.
    damping
        Factors on Kv beside.
    """
    from qrobot.cli.servo_settings import check_law
    from qrobot.config import load_robot
    from qrobot.study.gains import GainStudy

    law = check_law(law, load_robot(campaign.robot))
    _run(GainStudy(campaign.robot, campaign.rate, law, velocity, bandwidth, damping), arms, campaign)


@app.command
def show(results: Path, *, plot: Plot = None, json: Json = False) -> None:
    """Show what a study has found so far.

    Parameters
    ----------
    results
        Its results file.
    """
    from qrobot.study.results import read_results

    found = read_results(results)
    try:
        _told(found)
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise ConfigError(f"results of another version, or damaged: {type(error).__name__}: {error}") from error
    _report(found, plot, json)


def _run(study: Study, arms: int, campaign: Campaign) -> None:
    from qrobot.study.campaign import carry_out
    from qrobot.study.engine import engine

    count = campaign.workers if campaign.workers is not None else len(os.sched_getaffinity(0))
    try:
        with engine(min(count, arms), campaign.scheduler) as made, _bar(study.kind, made.workers) as told:
            results = carry_out(study, arms, made, campaign.output, told)
    except KeyboardInterrupt:
        note(f"interrupted; what had come in is in {campaign.output}, and the same command goes on from there")
        raise
    _report(results, campaign.plot, campaign.json)


@contextmanager
def _bar(kind: str, workers: int) -> Iterator[Told]:
    """Arms done and the time that the others will take; a line for each arm where there is no terminal."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    remaining = TextColumn("to go"), TimeRemainingColumn()
    with Progress(*columns, *remaining, console=err, disable=not err.is_terminal) as progress:
        task = progress.add_task(f"{kind}, {workers} worker{'s' * (workers != 1)}", total=None)

        def told(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)
            if not err.is_terminal:
                note(f"{done} of {total} arms")

        yield told


def _view(results: Results) -> View:
    from qrobot.cli.study_tables import VIEWS

    view = VIEWS.get(results.terms["study"])
    if view is None:
        raise ConfigError(f"this version knows no study {results.terms['study']!r}; it knows {', '.join(VIEWS)}")
    return view


def _told(results: Results) -> tuple[Any, dict[str, Any], list[Table], list[str]]:
    """Summary of results, and what is told of it: as plain values, in tables, and in sentences."""
    view = _view(results)
    summary = view.summarise(results)
    return summary, summary.to_dict(), list(view.tables(summary)), list(view.lines(summary))


def _report(results: Results, plot: Path | None, as_json: bool) -> None:
    from qrobot.log.plot import save_figure

    summary, plain, tables, lines = _told(results)
    if plot is not None:
        save_figure(_view(results).figure(summary), plot)
        note(f"figure {plot}")
    if as_json:
        write_json({"terms": results.terms} | plain)
        return
    for table in tables:
        print_table(table)
        out.print()
    for line in lines:
        out.print(line, soft_wrap=True)
    for seed, reason in summary.failed.items():
        out.print(f"arm {seed}: {reason}", style="red", soft_wrap=True)
