"""`qrobot calibrate`: exact counters from potentiometers and index pulses, and the tables that takes."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter
from rich.progress import BarColumn, Progress, TaskID, TextColumn
from rich.table import Table

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, insist_on_its_board, robot_of_arm, robot_of_servo
from qrobot.cli.console import SUCCESS, err, note, out, print_table, write_json
from qrobot.cli.option_types import Indexes, OutputCalibration
from qrobot.errors import ConfigError
from qrobot.report import Report
from qrobot.servo.calibration.table import TableFormat

if TYPE_CHECKING:
    from collections.abc import Callable

    from qrobot.config import Robot
    from qrobot.config.deployment import DeployedArm
    from qrobot.servo.memory.mailbox import CalibrationProgress
    from qrobot.servo.operator.calibration_client import CalibrationReport


def calibrate(
    deployment: str = DEFAULT_DEPLOYMENT,
    *,
    arm: str | None = None,
    indexes: Indexes = 5,
    make_table: OutputCalibration | None = None,
    table_format: Annotated[TableFormat, Parameter(name="--format")] = "qrobot",
    json: bool = False,
) -> int:
    """Calibrate an arm whose servo runs, or make the calibration table of an emulated arm.

    The joints creep one after the other over a few index pulses each, up to a turn of a motor more on either side:
    keep clear. The potentiometers tell which index pulse is which. Then the counters are loaded, and stay right until
    the board loses its supply, whatever is restarted meanwhile. A calibration that cannot be certain is refused, with
    its reason. Arm power is left as it was. A calibration that is under way already is followed to its end.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    indexes
        Index pulses of each joint that have to agree, 3 to 14. More travel, more certainty.
    make_table
        Write the table of the deployment's emulated arm to this file (.txt) instead, and move nothing. Name it in the
        file as `calibration_table`. Refused for a real arm: its table has to be measured on it. A table that does not
        say that it is an emulated arm's is not written over.
    table_format
        Of that file: `vendor` is the one that the board vendor's driver reads, without comments and checksum.
    json
        Print the result as JSON.
    """
    chosen = choose_arm(deployment, arm)
    if make_table is not None:
        return _make_table(chosen, make_table, table_format, json)
    report = calibrate_arm(chosen, indexes)
    if json:
        write_json(report.to_dict())
    elif report.was_calibrated:
        out.print(f"{chosen.name} is calibrated already: its board has kept the counters")
    else:
        print_table(_results(robot_of_arm(chosen), report))
    return SUCCESS


def calibrate_arm(
    arm: DeployedArm, indexes: int = 0, report: Report | None = None, look: Callable[[], None] = lambda: None
) -> CalibrationReport:
    """Have the running servo of an arm calibrate it; how far it is the terminal shows, or `report` is told.

    SIGTERM, and SIGHUP of a closed terminal, stop it as Ctrl-C does: no commander is left that could. `look` is called
    while it goes on; what it raises stops it too. From the main thread.

    Raises:
        LinkError: no servo runs, or it does not answer any more.
        LinkBusy: somebody else commands the arm.
        ConfigError: the servo drives another robot than the file tells of, or has another board.
        ConfigError, ServoFault: what `run_calibration` raises.
    """
    from qrobot.rig.interrupts import interrupted_by_signals
    from qrobot.servo.memory.commander_lock import Authority
    from qrobot.servo.memory.mailbox import ServoMailbox
    from qrobot.servo.memory.servo_memory import attach_servo_memory
    from qrobot.servo.operator.calibration_client import run_calibration

    def follow(now: CalibrationProgress) -> None:
        look()
        bars.show(now)

    insist_on_its_board(arm)
    memory, authority = attach_servo_memory(arm.name), Authority(arm.name)
    with interrupted_by_signals():
        try:
            mailbox = ServoMailbox(memory.words)
            robot = robot_of_servo(arm, mailbox.info.robot_name)
            authority.take("qrobot calibrate")
            with _Bars(robot, report) as bars:
                return run_calibration(mailbox, time.sleep, indexes, follow)
        finally:
            authority.release()
            memory.close()


class _Bars:
    """A bar per joint on the terminal; elsewhere, and for a `report`, a line when the next one begins."""

    def __init__(self, robot: Robot, report: Report | None = None) -> None:
        self._tell = note if report is None else report
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.0f} index pulses"))
        self._progress = Progress(*columns, console=err, disable=report is not None or not err.is_terminal)
        self._names, self._told = robot.joint_names, -1
        self._tasks: list[TaskID] = [self._progress.add_task(name, total=None) for name in robot.joint_names]

    def __enter__(self) -> _Bars:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def show(self, now: CalibrationProgress) -> None:
        """Fill the bars of the joints that are done, and of the one at work as far as it is."""
        if self._progress.disable and now.joint not in (self._told, len(self._names)):
            self._told = now.joint
            self._tell(f"{now.joint + 1} of {len(self._names)}: {self._names[now.joint]}")
        for joint, task in enumerate(self._tasks):
            done = now.wanted if joint < now.joint else now.found if joint == now.joint else 0
            self._progress.update(task, total=now.wanted, completed=done)


def _results(robot: Robot, report: CalibrationReport) -> Table:
    table = Table(title="calibrated", title_justify="left", box=None, padding=(0, 1, 0, 0))
    for heading in ("joint", "index pulses", "agree", "off the table", "next best place"):
        table.add_column(heading, justify="left" if heading == "joint" else "right")
    for name, misfit, margin, votes in zip(robot.joint_names, report.misfit, report.margin, report.votes, strict=True):
        table.add_row(name, str(report.indexes), str(votes), f"{misfit:.0f} units", f"{misfit + margin:.0f} units")
    return table


def _make_table(arm: DeployedArm, path: Path, form: TableFormat, as_json: bool) -> int:
    if not arm.board.emulated:
        raise ConfigError(
            f"{arm.name} is no emulated arm (kind = {arm.board.kind!r}): a real one's table has to be measured on it, "
            "as the board vendor's driver does; name that file as `calibration_table`"
        )
    from qrobot.rig.table_maker import make_table
    from qrobot.servo.calibration.table import EMULATED, is_emulated, write_table
    from qrobot.sim_board.deployed import board_options
    from qrobot.sim_board.emulator import Emulator

    if (kept := _text_of(path)).strip() and not is_emulated(kept):  # it may have been measured, and is the only one
        raise ConfigError(
            f"{path} does not say that it is an emulated arm's: it is not written over, name another file"
        )
    robot, choice = robot_of_arm(arm), arm.board
    options = board_options(choice, robot)
    emulator = Emulator(robot, options=options, seed=choice.seed, physics="rigid")
    with Progress(TextColumn("{task.description}"), BarColumn(), console=err, disable=not err.is_terminal) as progress:
        tasks = [progress.add_task(name, total=1.0) for name in robot.joint_names]
        table = make_table(emulator, lambda joint, share: progress.update(tasks[joint], completed=share))
    revision = "F" if options.revision_f else "E"
    write_table(path, table, f"{EMULATED} {robot.name}, board revision {revision}", form)
    if as_json:
        write_json({"file": str(path), "rows": [int(pots.size) for pots in table.pots]})
    else:
        note(f"table of the emulated {robot.name} written to {path}: name it as `calibration_table` in its deployment")
    return SUCCESS


def _text_of(path: Path) -> str:
    """Text of a file, "" where there is none. Raises ConfigError."""
    try:
        return path.read_text(encoding="ascii", errors="replace") if path.exists() else ""
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
