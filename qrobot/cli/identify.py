"""`qrobot identify`: from a plan of motion over a recording to a model of gravity, friction and inertia."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from cyclopts import App
from rich.table import Table

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, fences_of_arm, robot_of_arm
from qrobot.cli.console import note, out, plain_table, print_table, write_json
from qrobot.cli.identify_options import FitOptions, KnownTorque, PlanOptions, RobotFile
from qrobot.cli.option_types import LoadKg, MoveNumber, OutputLog, OutputModel, OutputPage
from qrobot.config.collision import NO_TORQUES
from qrobot.errors import ConfigError
from qrobot.realtime.signals import ends_as_ctrl_c

if TYPE_CHECKING:
    from collections.abc import Sequence

    from qrobot.arrays import Floats
    from qrobot.config import Robot
    from qrobot.config.identified import IdentifiedModel
    from qrobot.fences.fence_set import FenceSet
    from qrobot.ident.base import BaseParameters
    from qrobot.ident.excitation import Excitation, FourierRun
    from qrobot.ident.plan import ExcitationPlan, Swing

UNTOLD: Final = 2.0  # a factor within which a speed is known, at most
HELP: Final = """
Find what an arm weighs, how it rubs and how strong its motors are, and make a model of it that the servo uses.

Step by step, from a look at what the arm would do to a servo that uses the numbers:

  qrobot identify plan
  qrobot identify record --lockstep --output run.mcap    on an emulated arm
  qrobot identify fit run.mcap --output model.toml       with uncertainties
  qrobot identify report run.mcap --output model.html    a page to look at
  qrobot identify friction run.mcap                      near standstill
  qrobot servo --model model.toml

Inertia takes fast motion besides: `record --dynamic --output fast.mcap`, then `fit run.mcap --dynamic fast.mcap`.
A running arm is recorded with --go in place of --lockstep. Keep clear of it: it moves through most of its range.
"""

app = App(name="identify", help=HELP, help_format="plaintext", group_commands="Commands")


@app.command
def plan(
    deployment: str = DEFAULT_DEPLOYMENT,
    *,
    arm: str | None = None,
    options: PlanOptions | None = None,
    json: bool = False,
) -> None:
    """Show what an arm would do to be identified, and what of it can be told. Nothing moves.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    json
        Print the plan as JSON, positions in rad.
    """
    chosen = choose_arm(deployment, arm)
    robot = robot_of_arm(chosen)
    made, base = _made(robot, options or PlanOptions(), fences_of_arm(chosen))
    if json:
        write_json(made.to_dict() | {"parameters": _combinations(base), "untold": list(base.unseen)})
        return
    _show_plan(robot, made)
    table = Table(title=f"what of {_told_of(made)} can be told", title_justify="left", box=None, padding=(0, 2, 0, 0))
    for name, combination in _combinations(base).items():
        table.add_row(name, combination)
    print_table(table)
    out.print(f"cannot be told, and does not matter: {', '.join(base.unseen)}", soft_wrap=True)


@app.command
@ends_as_ctrl_c()
def record(
    deployment: str = DEFAULT_DEPLOYMENT,
    *,
    output: OutputLog,
    arm: str | None = None,
    lockstep: bool = False,
    go: bool = False,
    first: MoveNumber = 1,
    plant: Literal["nominal", "mismatched"] | None = None,
    load_kg: LoadKg = 0.0,
    options: PlanOptions | None = None,
) -> None:
    """Let an arm make the moves of its plan, and write the servo's log of it.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    output
        The log to write (.mcap); with --go a new one, and with --lockstep none of a running arm.
    arm
        Which arm of the file; may be left out when there is only one.
    lockstep
        On an emulated arm inside this process, on virtual time.
    go
        On the running arm of the deployment, which moves through most of its range.
    first
        Swing or run to begin with, to go on where a recording broke off; give `fit` both logs.
    plant
        With --lockstep: overrides the deployment file.
    load_kg
        With --lockstep: what the emulated arm holds at its flange, 0 to 2.5 kg.
    """
    from qrobot.ident.physical_gravity import LOAD_KG

    chosen = choose_arm(deployment, arm)
    if chosen.board.position_drives:
        raise ConfigError(f"{chosen.name} cannot be identified: {NO_TORQUES}")
    robot = robot_of_arm(chosen)
    made, _ = _made(robot, options or PlanOptions(), fences_of_arm(chosen))
    if output.suffix != ".mcap":
        raise ConfigError(f"the log {output} must end in .mcap")
    if not 1 <= first <= len(made.moves):
        raise ConfigError(f"--first {first}: the plan has moves 1 to {len(made.moves)}")
    if load_kg and not lockstep:
        raise ConfigError("--load-kg is for an emulated arm: put the load into the running one's hand")
    if not 0.0 <= load_kg <= LOAD_KG:
        raise ConfigError(f"--load-kg {load_kg:g}: an emulated arm holds 0 to {LOAD_KG:g} kg")
    if lockstep == go:
        _show_plan(robot, made)
        raise ConfigError("nothing has moved: choose --lockstep for an emulated arm, or --go for the running one")

    from qrobot.cli.identify_record import record_emulated, record_running

    if lockstep:
        record_emulated(chosen, robot, made, output, plant, first - 1, load_kg)
    else:
        record_running(chosen, robot, made, output, first - 1)


@app.command
def fit(
    *logs: Path,
    output: OutputModel,
    options: FitOptions | None = None,
    json: bool = False,
) -> None:
    """Find gravity, friction, torque scales and inertia in the logs of one arm, and write its model.

    Steady passes are looked for in the logs; it does not matter what program moved the arm. Where a hand led it, or a
    joint was driven by torque, nothing is taken. What the logs do not tell is an error that names it, and so are a bad
    recording and a model that predicts worse than the robot file.

    Parameters
    ----------
    logs
        First files of one or more logs of the arm.
    output
        The model to write (.toml).
    json
        Print the model as JSON.
    """
    from qrobot.cli.identify_fit import IdentificationTask
    from qrobot.ident.result import require_gravity_everywhere, write_model

    request = IdentificationTask(logs, options or FitOptions())
    found, model = request.identified()
    require_gravity_everywhere(found)
    write_model(output, model)
    _report(found.robot, model, json)
    outliers = found.fit.outliers
    passes = np.unique(found.observations.passed[outliers]).size
    for warning in found.warnings:
        note(warning)
    if (told_kg := request.told_kg) > 0.0:
        note(
            f"the servo was told {told_kg:g} kg while this was recorded: what the hand held is in the model now, "
            "and is not to be told again"
        )
    note(f"{len(found.observations)} observations, of which {outliers.size} in {passes} passes hardly count")
    note(f"model written to {output}: name it as `model` in [arm.servo], or start `qrobot servo --model {output}`")


@app.command
def report(
    *logs: Path,
    output: OutputPage,
    previous: Path | None = None,
    options: FitOptions | None = None,
) -> None:
    """Fit the same, and write a page for people: measured against predicted torque, what is left, all parameters.

    Parameters
    ----------
    logs
        First files of one or more logs of the arm.
    output
        The page to write (.html); its figures come beside it (.png).
    previous
        Another model of the robot (.toml), to compare with on the same passes.
    """
    from qrobot.cli.identify_fit import IdentificationTask
    from qrobot.config.identified import load_model
    from qrobot.ident.report import write_report

    found, model = IdentificationTask(logs, options or FitOptions()).identified()
    old = None if previous is None else load_model(previous, found.robot)
    for file in write_report(output, found, model, old):
        note(f"written: {file}")


@app.command
def friction(*logs: Path, robot: RobotFile = None, known_torque: KnownTorque = False, json: bool = False) -> None:
    """Show how friction falls with speed: what is added to Coulomb friction at rest, and where it fades.

    The servo compensates viscous and Coulomb friction alone. A recording made with --slow tells the rest.

    Parameters
    ----------
    logs
        First files of one or more logs of the arm.
    json
        Print it as JSON, in N m (N) and rad/s (m/s).
    """
    from qrobot.cli.identify_fit import IdentificationTask, friction_table
    from qrobot.ident.stribeck import friction_of

    request = IdentificationTask(logs, FitOptions(robot=robot, known_torque=known_torque))
    (found, _), (rows, header) = request.identified(), request.recorded
    fitted = friction_of(found, rows, header.period_ns * 1e-9)
    if json:
        write_json({"motors": found.robot.joint_names} | fitted.to_dict())
        return
    print_table(friction_table(found.robot, fitted))
    if (fitted.speed_factor > UNTOLD).any():
        note("where it fades is hardly told: record with --slow")


@app.command
def show(model: Path, deployment: str = DEFAULT_DEPLOYMENT, *, arm: str | None = None, json: bool = False) -> None:
    """Show an identified model: values with their 95 % intervals, beside the robot file's, and how well it predicts.

    Parameters
    ----------
    model
        The file (.toml).
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file it is for; may be left out when there is only one.
    json
        Print it as JSON.
    """
    from qrobot.config.identified import load_model

    robot = robot_of_arm(choose_arm(deployment, arm))
    _report(robot, load_model(model, robot), json)


def _made(
    robot: Robot, options: PlanOptions, fences: FenceSet | None
) -> tuple[ExcitationPlan | Excitation, BaseParameters]:
    from qrobot.ident.link_lines import stands_upright

    if not stands_upright(robot):
        note(
            f"{robot.name} does not stand upright, by gravity in its file: its moves keep off the floor, but of what "
            "carries the arm nothing is known. Tell it by fences"
        )
    return (_excited if options.dynamic else _planned)(robot, options, fences)


def _planned(robot: Robot, options: PlanOptions, fences: FenceSet | None) -> tuple[ExcitationPlan, BaseParameters]:
    from qrobot.ident.base import base_of_robot
    from qrobot.ident.plan import make_plan
    from qrobot.ident.regressor import gravity_regressor

    regressor = gravity_regressor(robot)
    base = base_of_robot(robot, regressor)
    return make_plan(robot, regressor, base, options.poses, options.seed, options.slow, fences), base


def _excited(robot: Robot, options: PlanOptions, fences: FenceSet | None) -> tuple[Excitation, BaseParameters]:
    from qrobot.ident.base import base_of_robot
    from qrobot.ident.excitation import make_excitation
    from qrobot.ident.regressor import inertial_regressor

    regressor = inertial_regressor(robot)
    base = base_of_robot(robot, regressor)
    return make_excitation(robot, regressor, base, seed=options.seed, fences=fences), base


def _told_of(made: ExcitationPlan | Excitation) -> str:
    from qrobot.ident.plan import ExcitationPlan

    return "gravity" if isinstance(made, ExcitationPlan) else "inertia and gravity"


def _combinations(base: BaseParameters) -> dict[str, str]:
    return {name: base.combination(index) for index, name in enumerate(base.leaders)}


def _show_plan(robot: Robot, made: ExcitationPlan | Excitation) -> None:
    scale = _people_scale(robot)
    table = Table(title=f"plan for {robot.name}, deg (mm)", title_justify="left", box=None, padding=(0, 2, 0, 0))
    for heading in ("", "move", *robot.joint_names):
        table.add_column(heading, justify="left" if heading == "move" else "right", no_wrap=heading == "move")
    moves: Sequence[Swing | FourierRun] = made.moves
    for number, move in enumerate(moves, 1):
        cells = [
            f"{centre:.0f} ± {half:.0f}" if half else f"{centre:.0f}"
            for centre, half in zip(move.centre * scale, move.half * scale, strict=True)
        ]
        table.add_row(str(number), move.name, *cells)
    print_table(table)
    out.print(
        f"takes {made.seconds / 60.0:.1f} minutes; condition of the parameters of {_told_of(made)} {made.condition:.1f}"
    )


def _people_scale(robot: Robot) -> list[float]:
    from qrobot.units import DEG_PER_RAD, MM_PER_M

    return [MM_PER_M if slides else DEG_PER_RAD for slides in robot.prismatic]


def _report(robot: Robot, model: IdentifiedModel, as_json: bool) -> None:
    if as_json:
        write_json(model.to_dict())
        return
    headings = "parameter", "value", "95 %", "robot file", "unit"
    table = plain_table(f"{model.robot}, {model.date}", *headings, words=["unit"])
    for value in model.value:
        numbers = f"{value.value:.4f}", f"± {value.half_width:.4f}", f"{value.before:.4f}"
        table.add_row(value.name, *numbers, value.unit)
    print_table(table)
    columns = _errors(model)
    errors = plain_table("error of predicted torque, N m (N)", "joint", *columns)
    for name, *each in zip(robot.joint_names, *columns.values(), strict=True):
        errors.add_row(name, *(f"{error:.3f}" for error in each))
    print_table(errors)


def _errors(model: IdentifiedModel) -> dict[str, Floats]:
    """Rms errors of each joint, by predictor; in fast motion the robot file has the model's gravity and friction."""
    quality = model.quality
    columns = {"model": quality.held_back_rms, "robot file": quality.before_rms}
    if quality.motion_rms is not None and quality.motion_before_rms is not None:
        columns |= {"fast, model": quality.motion_rms, "fast, file's inertia": quality.motion_before_rms}
    return columns
