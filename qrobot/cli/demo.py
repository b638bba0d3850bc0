"""`qrobot demo`: the experiment of the QRobot paper, from nothing to two figures and a table."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import Parameter
from rich.table import Table
from rich.text import Text

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, LAW_NAMES
from qrobot.cli.console import FAILURE, SUCCESS, command_name, err, note, out, print_table, write_json
from qrobot.cli.option_types import OutputFolder, OutputSummary
from qrobot.config.deployment import DeployedArm, Interpolation, Velocity
from qrobot.errors import ConfigError, Stalled

if TYPE_CHECKING:
    from qrobot.rig.demo_criteria import Verdict
    from qrobot.rig.experiment import ExperimentRun, Result

_LAW: Final = f"Another control law: {LAW_NAMES}."
_PUNCTUALITY: Final = (
    "late: cycles that began more than half a period after their time; µs: how long after it half of them, 99 %, and "
    "all began at most"
)
_UNBOUNDED: Final = (
    "runs on the wall clock must not fault; no bound is set to their errors: they grow with late cycles of this machine"
)
COMPARED_LAW: Final = "pd"
"""Which the paper compares its own with."""


def demo(
    *,
    lockstep: bool = False,
    rate: Literal[1000, 2000, 4000] | None = None,
    plant: Literal["nominal", "mismatched"] | None = None,
    law: Annotated[str | None, Parameter(help=_LAW)] = None,
    velocity: Velocity | None = None,
    interpolation: Interpolation | None = None,
    deployment: str = DEFAULT_DEPLOYMENT,
    out_dir: OutputFolder = Path("out/demo"),
    json: OutputSummary | None = None,
) -> int:
    """Move an emulated PUMA 560 through the experiment of the QRobot paper and show how well it tracked.

    Board, servo, guardian and bridge run as processes; a program moves the arm from park to an end position at constant
    speed and back at triple speed, at 1, 2 and 4 kHz on the wall clock. The same is then repeated in lock-step, on the
    plant the controller believes in and on one with wrong friction, gravity, torque gain and stiction. Options choose
    single runs. The exit status is 0 when no run faulted and the lock-step runs stayed within their bounds.

    Parameters
    ----------
    lockstep
        Only runs on virtual time.
    rate
        Only this servo rate, Hz.
    plant
        Only this plant; mismatched means lock-step.
    velocity
        Another estimate of the velocity: the observer in place of the paper's difference.
    interpolation
        Another path between setpoints than the quintic.
    deployment
        Deployment file of the runs on the wall clock, with one emulated PUMA 560: its name, its port, its time-outs.
    out_dir
        Where logs and figures go.
    json
        Write a summary as JSON to this file, a `.json`, as well.
    """
    from qrobot.cli.arms import choose_arm, robot_of_arm
    from qrobot.cli.servo_settings import check_law
    from qrobot.rig.demo_criteria import judge
    from qrobot.rig.experiment import plan

    arm = choose_arm(deployment, None)
    law = None if law is None else check_law(law, robot_of_arm(arm))
    runs = plan(lockstep, rate, plant, law, velocity, interpolation)
    if any(run.clock == "realtime" for run in runs):
        _require_emulated(arm, deployment)
    results = _run_all(runs, deployment, out_dir)
    verdicts = judge(results)
    for table in results_tables(results):
        out.print()
        print_table(table)
    out.print(_PUNCTUALITY, soft_wrap=True)
    if any(result.run.clock == "realtime" for result in results):
        out.print(_UNBOUNDED, soft_wrap=True)
    out.print()
    for result in results:
        if result.made_again:
            out.print(f"made again: {_describe(result.run)}; at first: {result.made_again}", soft_wrap=True)
    for verdict in verdicts:
        mark = Text("holds", "green") if verdict.holds else Text("FAILS", "red")
        out.print(mark, f" {verdict.what}", soft_wrap=True)
    out.print()
    for path in _draw(results, out_dir):
        out.print(f"figure {path}")
    qrobot = command_name()
    out.print(f"logs   {out_dir}  (look at one with `{qrobot} log info FILE`)", soft_wrap=True)
    if results:
        out.print(f"replay {qrobot} pendant --show --log {results[0].log.path}", soft_wrap=True)
    if json is not None:
        write_json(_summary(results, verdicts), json)
    return SUCCESS if all(verdict.holds for verdict in verdicts) else FAILURE


def _require_emulated(arm: DeployedArm, deployment: str) -> None:
    """Raise ConfigError for an arm with a real board: the demo moves fast, and again by itself where a run stalled."""
    if not arm.board.emulated:
        raise ConfigError(
            f"{deployment}: the board of {arm.name} is no emulated one ({arm.board.kind}), and the demo moves at full "
            "speed: see it with --lockstep, and move a real arm by `qrobot up` and `qrobot run`"
        )


def _run_all(runs: list[ExperimentRun], deployment: str, directory: Path) -> list[Result]:
    from qrobot.realtime.interrupt import heed_interrupts
    from qrobot.rig.experiment import run_lockstep

    results: list[Result] = []
    realtime = [run for run in runs if run.clock == "realtime"]
    with err.status("starting") as status:

        def progress(what: str) -> None:
            status.update(what)
            if not err.is_terminal:
                note(what)

        if realtime:
            results += _run_on_the_wall_clock(realtime, len(runs), deployment, directory, progress)
        for number, run in enumerate(runs[len(realtime) :], len(realtime) + 1):
            progress(f"run {number} of {len(runs)}: {_describe(run)}")
            with heed_interrupts():
                results.append(run_lockstep(run, directory))
    return results


def _run_on_the_wall_clock(
    runs: list[ExperimentRun], of: int, deployment: str, directory: Path, progress: Callable[[str], None]
) -> list[Result]:
    from qrobot.cli.arms import choose_arm
    from qrobot.rig.deployed import ArmProcesses
    from qrobot.rig.experiment import run_realtime
    from qrobot.rig.processes import ProcessRig

    results, doing = [], "starting the board (a first start compiles for half a minute or more)"
    with ProcessRig(directory / "processes", told=lambda line: progress(f"{doing}; {line}")) as rig:
        processes = ArmProcesses(rig, deployment, choose_arm(deployment, None))
        progress(doing)
        processes.start("board", "bridge")
        for number, run in enumerate(runs, 1):
            doing = f"run {number} of {of}: {_describe(run)}"
            progress(doing)
            results.append(_tried_twice(partial(run_realtime, run, processes, directory), note))
    return results


def _tried_twice(attempt: Callable[[], Result], tell: Callable[[str], None]) -> Result:
    """Result of `attempt`, at the second try where the machine stalled at the first; the result says so."""
    try:
        return attempt()
    except Stalled as stall:
        tell(f"once more, as a busy or shared machine stalls now and then: {stall}")
        return replace(attempt(), made_again=str(stall))


def _describe(run: ExperimentRun) -> str:
    clock = "on the wall clock" if run.clock == "realtime" else "in lock-step"
    how = f"law {run.law}, velocity by {run.velocity}, {run.interpolation} interpolation"
    return f"{run.rate_hz} Hz {clock}, {run.plant} plant, {how}"


def results_tables(results: list[Result]) -> list[Table]:
    """Errors of each joint, largest and rms, and the punctuality of the cycles: one row per run."""
    names = results[0].log.header.joint_names if results else ()
    joints = [str(number) for number, _ in enumerate(names, 1)]  # the names are too long for a row
    largest = _table("largest tracking error of each joint, mrad (mm on a sliding joint)", joints)
    rms = _table("rms of the same, over all cycles in which a program commands the arm", joints)
    cycles = _table("punctuality of the cycles", ("cycles", "late", "p50/p99/max µs", "times real time", "fault"))
    for result in results:
        run, numbers = result.run, result.summary
        label = (str(run.rate_hz), run.clock, run.plant, run.law_label)
        largest.add_row(*label, *(f"{error * 1e3:.2f}" for error in numbers.max_abs_error))
        rms.add_row(*label, *(f"{error * 1e3:.2f}" for error in numbers.rms_error))
        cycles.add_row(*label, *_punctuality(result))
    return [largest, rms, cycles]


def _table(title: str, columns: Sequence[str]) -> Table:
    table = Table(title=title, title_justify="left", box=None, padding=(0, 1, 0, 0))
    for heading in ("Hz", "clock", "plant", "law"):
        table.add_column(heading, no_wrap=True)
    for heading in columns:
        table.add_column(heading, justify="right")
    return table


def _punctuality(result: Result) -> list[str]:
    numbers, late = result.summary, result.summary.wakeup_us
    realtime = result.run.clock == "realtime"
    wake_up = f"{late.p50:.2f}/{late.p99:.1f}/{late.max:.0f}" if realtime else "-"
    factor = "1" if realtime else f"{result.realtime_factor:.0f}"
    return [str(numbers.cycles), str(numbers.late_cycles), wake_up, factor, result.fault or "-"]


def _draw(results: list[Result], directory: Path) -> list[Path]:
    """The paper's two figures, of the first run; or of the one to which PD is compared, with the errors of PD below.

    They show the motion, which a run on the wall clock begins later than one in lock-step.
    """
    from qrobot.log.motion_span import around_motion
    from qrobot.log.plot import errors_of_runs_figure, positions_figure, save_figure

    if not results:
        return []
    of_pd = {result.run: result for result in results if result.run.law == COMPARED_LAW}
    pairs = [(each, of_pd.get(replace(each.run, law=COMPARED_LAW))) for each in results if each.run not in of_pd]
    pair = next(([each, pd] for each, pd in pairs if pd), results[:1])
    shown = around_motion([result.log for result in pair])
    figures = {"positions": positions_figure(shown[0]), "errors": errors_of_runs_figure(shown)}
    for name, figure in figures.items():
        save_figure(figure, directory / f"{name}.png")
    return [directory / f"{name}.png" for name in figures]


def _summary(results: list[Result], verdicts: list[Verdict]) -> dict[str, Any]:
    return {
        "runs": [result.to_dict() for result in results],
        "bounds": [verdict.to_dict() for verdict in verdicts],
    }
