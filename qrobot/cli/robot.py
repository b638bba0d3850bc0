"""`qrobot robot`: look at robot files, and exchange them with other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Final, Literal

from cyclopts import App, Parameter

from qrobot.cli.console import note, out, plain_table, print_table, write_json
from qrobot.cli.option_types import FileOfKind, OutputFile, OutputRobot
from qrobot.config import Robot, load_robot
from qrobot.config.document import packaged_names
from qrobot.config.kinds import FileKind
from qrobot.errors import ConfigError, error_text
from qrobot.units import DEG_PER_RAD
from qrobot.whole_file import replace_file

HELP: Final = """
Look at robot files, and exchange them with other programs.

For example:

  qrobot robot show puma560
  qrobot robot export puma560 --format urdf --output puma560.urdf
  qrobot robot import arm.urdf --like puma560 --output arm.toml
"""

app = App(name="robot", help=HELP, help_format="plaintext", group_commands="Commands")

MJCF_STEP_S = 0.25e-3  # [A] that of the emulator at 4 kHz
Format = Literal["urdf", "mjcf", "dh", "toml"]
_KINDS: Final[dict[str, FileOfKind]] = {
    "urdf": FileOfKind("a URDF", (".urdf", ".xml"), kind=FileKind.URDF),
    "mjcf": FileOfKind("an MJCF model", (".xml", ".mjcf"), kind=FileKind.MJCF),
    "dh": FileOfKind("a table of rows", (".csv",)),
    "toml": FileOfKind("a robot file", (".toml",), kind=FileKind.ROBOT),
}


@app.command(name="list")
def list_robots(*, json: bool = False) -> None:
    """List the packaged robots.

    Parameters
    ----------
    json
        Print a JSON object: what each is, by its name.
    """
    robots = {name: load_robot(name).about for name in packaged_names("robots")}
    if json:
        write_json(robots)
        return
    table = plain_table("", "robot", "what it is", words=["what it is"])
    for name, about in robots.items():
        table.add_row(name, about)
    print_table(table)


@app.command
def show(robot: str, *, json: bool = False) -> None:
    """Check a robot file and show what it says of the arm: geometry, ranges, speeds, weights.

    Parameters
    ----------
    robot
        Name of a packaged robot, or a robot file.
    json
        Print the whole file as a JSON object.
    """
    from qrobot.exchange.robot_document import robot_document

    loaded = load_robot(robot)
    if json:
        write_json(robot_document(loaded))
        return
    _show(loaded)


def _show(robot: Robot) -> None:
    from qrobot.exchange.tables import COLUMNS, table_rows

    geometry = robot.geometry
    out.print(f"{robot.name}: {robot.about}" if robot.about else robot.name, soft_wrap=True)
    out.print(
        f"{geometry.family} kinematics; frame 0 is {geometry.base_height_m:g} m over the floor, "
        f"the flange {geometry.flange_m:g} m along the last axis; payload {robot.limits.payload_kg:g} kg",
        soft_wrap=True,
    )
    headings = (*COLUMNS[:1], *COLUMNS[2:], "v_max /s", "tau_max", "mass kg")
    table = plain_table("modified Denavit-Hartenberg rows", *headings, words=["unit"])
    for i, row in enumerate(table_rows(robot)):
        speed = robot.limits.v_max[i] * (1.0 if robot.prismatic[i] else DEG_PER_RAD)
        values = f"{speed:g}", f"{robot.guard.tau_max[i]:g}", f"{robot.links.mass[i]:g}"
        table.add_row(row[0], *row[2:], *values)
    print_table(table)


@app.command
def export(
    robot: str,
    *,
    to: Annotated[Format, Parameter(name="--format")] = "urdf",
    output: Annotated[OutputFile | None, Parameter(name=("--output", "-o"))] = None,
) -> None:
    """Write a robot for another program.

    A URDF has the link frames of the robot file, masses, friction and cylinders to look at. MJCF is the model that the
    emulator steps, with coupled motors. Coupling, gears, encoders and gains have no place in a URDF and are left out.

    Parameters
    ----------
    robot
        Name of a packaged robot, or a robot file.
    to
        `urdf`, `mjcf` (MuJoCo), `dh` (the modified Denavit-Hartenberg rows as CSV) or `toml` (the robot file itself).
    output
        File to write, with a suffix that its format has; standard output when it is left out.
    """
    text = _text(load_robot(robot), to)
    if output is None:
        out.print(text.rstrip("\n"), soft_wrap=True, markup=False, highlight=False)
        return
    _insist_on_kind(output, to, text)
    try:
        replace_file(output, text)
    except OSError as error:
        raise ConfigError(f"cannot write {output}: {error_text(error)}") from None
    note(f"wrote {output}")


def _insist_on_kind(output: Path, to: Format, text: str) -> None:
    """Raise ConfigError for a file of another suffix, or one that is there and is something else: somebody's work."""
    try:
        _KINDS[to](output)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    if to == "dh" and output.is_file() and output.stat().st_size:
        with output.open(encoding="utf-8", errors="replace") as file:
            if file.readline().rstrip() != text.partition("\n")[0].rstrip():
                raise ConfigError(f"cannot write {output}: it is no table of such rows; name another file")


def _text(robot: Robot, to: Format) -> str:
    if to == "mjcf":
        from qrobot.sim_board.mujoco_plant import mjcf_text

        return mjcf_text(robot, MJCF_STEP_S)
    from qrobot.exchange.robot_document import robot_document, robot_text
    from qrobot.exchange.tables import csv_text
    from qrobot.exchange.urdf_export import urdf_text

    if to == "toml":
        return robot_text(robot_document(robot))
    return urdf_text(robot) if to == "urdf" else csv_text(robot)


@app.command(name="import")
def import_(
    file: Path,
    *,
    output: Annotated[OutputRobot, Parameter(name=("--output", "-o"))],
    tip: str | None = None,
    like: str | None = None,
    beside: Annotated[Path | None, Parameter(name="--with")] = None,
    json: bool = False,
) -> None:
    """Make a robot file of a URDF.

    The arm may be any chain of joints that turn or slide; what is bolted on is merged into its links. A URDF does not
    tell gears, encoders, converters, gains and the guard's limits: they are taken from a robot like it, each marked as
    borrowed, or from a file that you write; without both, the command names what is missing.

    Parameters
    ----------
    file
        The URDF. Expand one with macros before: `xacro FILE > robot.urdf`.
    output
        The robot file to write, `.toml`.
    tip
        Link at the end of the arm; may be left out when only one link carries no other.
    like
        A packaged robot or a robot file with joints of the same kinds, for what the URDF does not tell.
    beside
        A TOML file with sections of a robot file, which win over the URDF and over `--like`.
    json
        Print the notes as a JSON object.
    """
    from qrobot.exchange.robot_document import write_robot
    from qrobot.exchange.urdf_import import import_urdf

    imported = import_urdf(file, tip, like, beside)
    write_robot(output, imported.document)
    result: dict[str, Any] = {"robot": imported.robot.name, "joints": imported.robot.n, "notes": list(imported.notes)}
    if json:
        write_json(result)
        return
    for line in imported.notes:
        note(f"note: {line}")
    out.print(
        f"wrote {output}: {imported.robot.n} joints; look at it with `qrobot robot show {output}`", soft_wrap=True
    )
