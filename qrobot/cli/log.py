"""`qrobot log`: what is in a log, its figures, its tables; and the recorder."""

from __future__ import annotations

import time
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from cyclopts import App, Parameter
from rich.table import Table

from qrobot.cli.console import note, out, print_table, write_json
from qrobot.cli.log_compare import compare
from qrobot.cli.logs import files_of_run, first_parts, read_and_warn
from qrobot.cli.option_types import (
    Gigabytes,
    Megabytes,
    OutputFilm,
    OutputFolder,
    OutputNewLog,
    OutputTable,
    Port,
    Range,
    Seconds,
    checked_folder,
)
from qrobot.errors import ConfigError, LogError
from qrobot.report import QueuedReport

if TYPE_CHECKING:
    from qrobot.config import DeployedArm, Robot
    from qrobot.log.header import LogHeader
    from qrobot.log.read import Log
    from qrobot.log.writer import LogWriter
    from qrobot.servo.memory.servo_memory import ServoInfo

MEGABYTE = 1_000_000
LIVE_PORT: Final = 8765  # viewers propose it
TABLE_EVENTS: Final = 20
FigureName = Literal["positions", "errors", "torques", "forces", "signals", "latency"]

HELP: Final = """
Look at the logs that servos, programs and the demo leave behind, or record a running servo.

A log is an MCAP file with a row for every cycle of the servo; tools for such files, Foxglove among them, open it too.
"""

app = App(name="log", help=HELP, help_format="plaintext", group_commands="Commands")


@app.command
def info(*files: Path, json: bool = False) -> None:
    """Tell what is in logs: which run, how well it tracked, how punctual it was, what is missing.

    Of a damaged log everything is read that is whole, and what is lost is told. Of several logs all are told that can
    be read; with one that cannot, the status is 1.

    Parameters
    ----------
    files
        First file of each log; the parts of a rotated one are found by themselves, and pass here for one log.
    json
        Print JSON: an object for one log, a list of them for several, in which one that cannot be read has its "error".
    """
    first, *others = first_parts(files)
    if not others:
        facts = _facts(*_read_now(first))
        write_json(facts) if json else _show_facts(first, facts)
        return
    found = [(file, _facts_or_error(file)) for file in (first, *others)]
    if json:
        write_json([facts for _, facts in found])
    else:
        _show_all(found)
    if refused := [facts["error"] for _, facts in found if "error" in facts]:
        raise LogError(f"{len(refused)} of {len(found)} logs cannot be read: {'; '.join(refused)}")


def _show_all(found: list[tuple[Path, dict[str, Any]]]) -> None:
    """A table for each log that could be read, with an empty line between them."""
    readable = [(file, facts) for file, facts in found if "error" not in facts]
    for number, (file, facts) in enumerate(readable):
        if number:
            out.print()
        _show_facts(file, facts)


def _facts_or_error(file: Path) -> dict[str, Any]:
    try:
        return _facts(*_read_now(file))
    except LogError as error:
        return {"files": [str(file)], "error": str(error)}


def _show_facts(file: Path, facts: dict[str, Any]) -> None:
    del facts["joint_units"]  # the errors have theirs behind them
    if facts.pop("being_written") and not facts["lost_to_damage"]:
        facts["complete"] = "not yet: its recorder still writes it"
    elif not facts["complete"] and not facts["lost_to_damage"]:
        facts["complete"] = "no: it breaks off, as where its recorder was killed or the disk was full"
    facts["law"] = ", then ".join(facts.pop("laws"))
    facts["events"] = _first_events(facts["events"], file)
    for error in ("max_abs_error", "rms_error"):
        facts[error] = _milli(facts[error])
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, value in facts.items():
        table.add_row(name.replace("_", " "), _plain(value))
    print_table(table)


def _milli(errors: list[float | None]) -> str:
    """Tracking errors of the joints, rad or m; None where no cycle had one."""
    told = ("-" if error is None else f"{1e3 * error:.3f}" for error in errors)
    return " ".join(told) + "  mrad (mm on a sliding joint)"


def _read_now(first: Path) -> tuple[Log, bool]:
    """A log, and whether its recorder still writes it; one whose recorder has just ended is read to its end."""
    from qrobot.log.read import read_log
    from qrobot.realtime.shared_memory import has_owner

    log = read_and_warn(first)
    being_written = log.torn and any(has_owner(path) for path in log.parts)
    return (read_log(first) if log.torn and not being_written else log), being_written


def _facts(log: Log, being_written: bool) -> dict[str, Any]:
    from qrobot.faultcodes import explain
    from qrobot.log.events import log_events
    from qrobot.log.flight import incidents_of
    from qrobot.log.summary import plain_numbers, sensed, tracking_summary, wall_clock

    header, summary = log.header, tracking_summary(log).to_dict()
    return {
        "files": [str(path) for path in log.parts],
        "robot": header.robot,
        "arm": header.arm,
        "joints": list(header.joint_names),
        "joint_units": ["m" if header.is_prismatic(joint) else "rad" for joint in range(header.n)],
        "rate_hz": header.rate_hz,
        "law": header.law,
        "laws": list(log.law_names),
        "velocity": header.velocity,
        "interpolation": header.interpolation,
        "clock": header.clock,
        "plant": header.plant,
        "duration_s": float(log.time_s[-1]) if log.rows.size else 0.0,
        "complete": not (log.torn or log.lost),
        "being_written": being_written,
        "lost_to_damage": [asdict(lost) | {"line": lost.line} for lost in log.lost],
        "disk_errors": log.status.disk_errors,
        "began": wall_clock(log),
        "sensed": sensed(log),
        **summary,
        "faults": [explain(code) for code in summary["faults"]],
        "incidents": [
            plain_numbers(incident.to_dict()) | {"line": incident.line(header.prismatic)}
            for incident in incidents_of(log)
        ],
        "setup": [asdict(step) for step in header.setup],
        "attachments": list(log.attachments),
        "events": [event.to_dict() for event in log_events(log)],
    }


def _first_events(events: list[dict[str, Any]], file: Path) -> list[dict[str, Any]]:
    """The first TABLE_EVENTS events, and a line that says where the others are."""
    more = len(events) - TABLE_EVENTS
    return [*events[:TABLE_EVENTS], {"line": f"and {more} more: qrobot log events {file}"}] if more > 0 else events


def _plain(value: Any) -> str:
    """One cell of the table."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, dict):
        return _plain_entry(value)
    if isinstance(value, list):
        words = [_plain(item) for item in value]
        sentences = any(isinstance(item, dict) or " " in word for item, word in zip(value, words, strict=True))
        return ("\n" if sentences else "  ").join(words) or "none"
    return str(value) if value not in ("", None) else "-"


def _plain_entry(value: dict[str, Any]) -> str:
    """An incident, an event, a step of the set-up, or any other group of facts."""
    if "line" in value:
        return str(value["line"])
    if "remedy" in value:
        return f"{value['name']}: {value['detail']}" + ("" if value["ok"] else " (refused)")
    return ", ".join(f"{key} {_plain(item)}" for key, item in value.items())


@app.command
def events(file: Path, *, json: bool = False) -> None:
    """List what happened, a line each: modes, faults, other laws, other gains; in seconds since the log's first cycle.

    Parameters
    ----------
    file
        First file of the log.
    json
        Print JSON.
    """
    from qrobot.log.events import log_events

    found = [event.to_dict() for event in log_events(read_and_warn(file))]
    if json:
        write_json(found)
        return
    for event in found:
        out.print(event["line"], soft_wrap=True, markup=False)


@app.command
def plot(
    *files: Path,
    output: OutputFolder | None = None,
    only: Annotated[tuple[FigureName, ...], Parameter(negative="")] = (),
) -> None:
    """Draw logs: desired positions, tracking errors, torques, forces, wake-up errors; one PNG each.

    Dashed lines mark other laws and gains, dotted ones faults.

    Parameters
    ----------
    files
        First file of each log; the parts of a rotated one are found by themselves, and pass here for one log.
    output
        Directory for the figures; beside each log if left out.
    only
        Which figures to draw; all that the log has numbers for if left out.
    """
    from qrobot.log.plot import FIGURES, figures_of, save_figure

    first = first_parts(files)
    if output is not None and len({each.stem for each in first}) < len(first):
        raise ConfigError("two of these logs have one name, and so would their figures: leave out --output")
    for each in first:
        checked_folder(output or each.parent)
    for each in first:
        log = read_and_warn(each)
        for name in only or figures_of(log):
            path = (output or each.parent) / f"{each.stem}-{name}.png"
            save_figure(FIGURES[name](log), path)
            out.print(str(path), markup=False)


@app.command
def animate(
    file: Path,
    *,
    output: OutputFilm | None = None,
    begin: Seconds = 0.0,
    end: Seconds | None = None,
    speed: Annotated[float, Parameter(validator=Range(0.01, 1000.0))] = 1.0,
    frames: Annotated[int, Parameter(name="--fps", validator=Range(1, 60))] = 12,
    width: Annotated[int, Parameter(validator=Range(240, 3840, "pixels"))] = 720,
) -> None:
    """Make a film of a log: the arm in three dimensions beside its tracking errors. No screen is needed.

    The orange line is the way of the tool; where the setpoint is elsewhere, an orange shadow of the arm stands there.
    Fences of the run are drawn by their edges: dashed where the arm stays inside.

      qrobot log animate out/demo/lockstep-1000-nominal-qrobot.mcap
      qrobot log animate run.mcap --begin 12 --end 20 --speed 0.25 --output stop.mp4

    Parameters
    ----------
    file
        First file of the log.
    output
        The film, `.gif`, or `.mp4` where ffmpeg is installed; beside the log if left out.
    begin
        Where to begin, in seconds from the log's first cycle.
    end
        Where to end; the log's end if left out.
    speed
        Seconds of the log in one second of the film.
    frames
        Pictures a second.
    width
        Of the film, in pixels; it is half as high.
    """
    from qrobot.cli.run_film import drawing_bar
    from qrobot.log.animation import Film, write_animation

    target = output or file.parent / f"{file.stem}.gif"
    checked_folder(target.parent)
    log = read_and_warn(file)
    with drawing_bar() as progress:
        write_animation(log, target, Film(begin, end, speed, frames, width), progress)
    out.print(str(target), markup=False, soft_wrap=True)


app.command(compare)


@app.command
def export(file: Path, target: OutputTable) -> None:
    """Turn a log into a table, one row per cycle.

    Examples:

      qrobot log export run.mcap run.csv
      qrobot log export run.mcap run.parquet     smaller, and quick to load as a data frame; needs pyarrow

    Parameters
    ----------
    file
        First file of the log.
    target
        File to write; its suffix chooses the format, .csv or .parquet.
    """
    from qrobot.log.export import export_csv, export_parquet

    writers = {".csv": export_csv, ".parquet": export_parquet}
    log = read_and_warn(file)
    writers[target.suffix.lower()](log, target)
    note(f"{log.rows.size} rows in {target}")


@app.command
def record(
    deployment: str = "emulator",
    *,
    arm: str | None = None,
    output: OutputNewLog | None = None,
    max_megabytes: Annotated[Megabytes, Parameter(name="--max-mb")] = 1000.0,
    keep_gigabytes: Annotated[Gigabytes | None, Parameter(name="--keep-gb")] = None,
    plant: str | None = None,
) -> None:
    """Record every cycle of a servo until Ctrl-C, from one servo process to the next.

    Each servo process gets a log of its own, named after the arm and the time. Starting late loses nothing that is
    still in the servo's memory (a minute, or `black_box_s` of the deployment file), and a full disk never
    disturbs the servo.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    output
        Directory for the logs, overriding the file; or a new file (.mcap) for the log of the first servo found.
    max_megabytes
        Size at which the next part of a log begins; a quarter of keep_gb where that is less.
    keep_gigabytes
        Remove the oldest files of the arm's logs when all together would be more, overriding the file's keep_gb.
    plant
        What the log of an emulated arm shall say of the plant, overriding the file.
    """
    from qrobot.cli.arms import choose_arm, robot_of_arm, tool_of_arm
    from qrobot.fences.told_fences import told_fences
    from qrobot.log.fences_of_log import fence_attachments
    from qrobot.log.follow import ServoFollower, follow, log_paths
    from qrobot.log.header import attach_files
    from qrobot.log.room import LogRoom
    from qrobot.log.writer import LogWriter
    from qrobot.realtime.signals import set_on_signals
    from qrobot.realtime.startup_order import await_turn

    chosen = choose_arm(deployment, arm)
    if plant is not None and bool(plant) != chosen.board.emulated:
        kind = (
            "an emulated arm, whose log names one" if chosen.board.emulated else "a real arm, whose log tells of none"
        )
        raise ConfigError(f"--plant {plant!r}: {chosen.name} is {kind}")
    robot = robot_of_arm(chosen)
    await_turn()
    attachments = attach_files(files_of_run(chosen, deployment))
    fences = told_fences(chosen, robot)
    attachments += fence_attachments(fences)
    tool = tool_of_arm(chosen)
    paths = log_paths(output or checked_folder(Path(chosen.log.directory or ".")), chosen.name)

    with QueuedReport(note) as told, set_on_signals() as stop:
        keep_gb = keep_gigabytes or chosen.log.keep_gb
        room = LogRoom(chosen.name, keep_gb, round(max_megabytes * MEGABYTE), told)

        def open_log(servo: ServoInfo, pid: int) -> LogWriter:
            header = recorded_header(chosen, robot, servo, pid)
            header = header if plant is None else replace(header, plant=plant)
            return LogWriter(next(paths), header, attachments, room.file_bytes, robot, tool, fences, room.make)

        told(f"waiting for the servo of {chosen.name}")
        follow(ServoFollower(chosen.name, open_log, told), stop)


@app.command
def live(
    deployment: str = "emulator",
    *,
    arm: str | None = None,
    port: Port = LIVE_PORT,
    rate: Annotated[int, Parameter(validator=Range(1, 1000, "Hz"))] = 100,
) -> None:
    """Show a servo live to Foxglove, Lichtblick and viewers like them, until Ctrl-C.

    They find what a log has: the rows, the arm in three dimensions with its tool, load and fences, its frames, the law
    in force. Choose *Open connection*, *Foxglove WebSocket*, `ws://127.0.0.1:8765`, and the layout
    `config/foxglove/arm.json`. Nobody can move anything by it; who may open connections on this machine may look.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    port
        Where to listen, on this machine's loopback interface only; 0 for any.
    rate
        Rows a second, at most as many as the servo makes.
    """
    from qrobot.cli.arms import choose_arm, robot_of_arm, tool_of_arm
    from qrobot.fences.told_fences import told_fences
    from qrobot.log.follow import ServoFollower, follow
    from qrobot.log.live import LiveServer
    from qrobot.realtime.signals import set_on_signals

    chosen = choose_arm(deployment, arm)
    robot, tool = robot_of_arm(chosen), tool_of_arm(chosen)
    fences = told_fences(chosen, robot)

    def open_server(servo: ServoInfo, pid: int) -> LiveServer:
        header = recorded_header(chosen, robot, servo, pid)
        return LiveServer(port, header, rate, robot, tool, fences)

    with QueuedReport(note) as told, set_on_signals() as stop:
        told(f"waiting for the servo of {chosen.name}")
        follow(ServoFollower(chosen.name, open_server, told, from_now=True), stop)


def recorded_header(arm: DeployedArm, robot: Robot, servo: ServoInfo, pid: int) -> LogHeader:
    """Header of the log of a running servo. Raises ConfigError when the deployment names another robot."""
    from qrobot.cli.arms import plant_of_arm
    from qrobot.log.header import header_for
    from qrobot.realtime.machine import machine_steps, observe_process

    if (servo.robot_name, servo.n) != (robot.name, robot.n):
        raise ConfigError(f"the servo runs {servo.robot_name!r}, the deployment file says {robot.name!r}")
    choices = {"velocity": servo.velocity, "interpolation": servo.interpolation}
    header = header_for(robot, servo.period_ns, servo.law, plant=plant_of_arm(arm), arm=arm.name, **choices)
    offset = time.time_ns() - time.monotonic_ns()
    return replace(header, wall_offset_ns=offset, setup=(*observe_process(pid), *machine_steps()))
