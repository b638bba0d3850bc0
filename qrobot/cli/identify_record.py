"""Recording for `qrobot identify`: an emulated arm in lock-step, or the running one over its bridge."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from qrobot import rccl
from qrobot.cli.arm_links import link_of
from qrobot.cli.arms import controlled_robot, insist_on_its_board
from qrobot.cli.console import err, note
from qrobot.cli.logs import read_and_warn
from qrobot.cli.option_types import require_new_log
from qrobot.cli.servo_settings import servo_settings
from qrobot.config import Robot
from qrobot.config.deployment import DeployedArm
from qrobot.errors import ConfigError, LinkError, LogError, MotionError, ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.ident.excitation import Excitation, FourierRun
from qrobot.ident.perform import MoveProgress as Told
from qrobot.ident.perform import perform
from qrobot.ident.plan import ExcitationPlan, Swing
from qrobot.log.header import LOCKSTEP, LogHeader, header_for
from qrobot.log.record import write_log
from qrobot.report import QueuedReport
from qrobot.servo.laws.names import law_label
from qrobot.servo.memory.telemetry import Rows
from qrobot.units import US_PER_MS
from qrobot.wire import RobotFlag

if TYPE_CHECKING:
    from qrobot.log.follow import ServoFollower
    from qrobot.log.read import Log
    from qrobot.log.writer import LogWriter
    from qrobot.rig.experiment import PlantName
    from qrobot.servo.memory.published_state import ServoSnapshot
    from qrobot.servo.memory.servo_memory import ServoInfo

_NOT_READY: Final = "the servo of {arm} is not ready: nothing would be recorded"


def record_emulated(
    arm: DeployedArm,
    robot: Robot,
    plan: ExcitationPlan | Excitation,
    output: Path,
    plant: PlantName | None,
    first: int,
    load_kg: float,
) -> None:
    """The moves of `plan` from number `first` on, in lock-step; their log goes to `output`."""
    from qrobot.realtime.interrupt import heed_interrupts
    from qrobot.rig.identify import record_lockstep
    from qrobot.sim_board.deployed import emulator_of_arm

    settings, emulator = servo_settings(arm), emulator_of_arm(arm, robot, plant=plant, payload_kg=load_kg)
    believed, _ = controlled_robot(arm, emulated=True)
    with heed_interrupts(), _bar(plan) as told:
        rows = record_lockstep(
            believed, arm.robot, settings, emulator, plan, told, round(arm.bridge.period_ms * US_PER_MS), first
        )
    header = header_for(
        robot,
        settings.period_ns,
        law_label(settings.law),
        LOCKSTEP,
        plant or arm.board.plant,
        settings.velocity,
        settings.interpolation,
        arm.name,
    )
    output.parent.mkdir(parents=True, exist_ok=True)
    path = write_log(output, rows, header, robot=robot)[0]
    option = "run.mcap --dynamic " if isinstance(plan, Excitation) else ""
    note(f"{rows.size} cycles in {path}: now `qrobot identify fit {option}{path} --output model.toml`")


def record_running(arm: DeployedArm, robot: Robot, plan: ExcitationPlan | Excitation, output: Path, first: int) -> None:
    """The same on the running arm: setpoints go over its bridge, the log is taken from its servo's memory.

    The log is begun when the arm is under control, and is a new one.

    Raises:
        LinkError: no servo runs, it is not ready, or somebody else commands the arm.
        ConfigError: it drives another robot than the file tells of, or `output` is a recording already.
        MotionError: it is to move more slowly than planned, or in a pause.
        LogError: the log cannot be written, or not any more: the arm makes no further move then.
    """
    refuse_recorded(output)
    with (
        _recording(arm, robot, output) as recorder,
        _bar(plan) as told,
        says_where_it_broke_off(told) as told_and_kept,
        rccl.use(link_of(arm)),
        rccl.control(arm.robot) as channel,
    ):

        def begun(number: int, move: Swing | FourierRun) -> None:
            recorder.check()
            told_and_kept(number, move)

        recorder.begin()
        perform(channel, robot, plan, begun, first)
        recorder.check()


def refuse_recorded(output: Path) -> None:
    """Raise ConfigError when `output` cannot be written, or is a recording already."""
    try:
        require_new_log(output)
    except ValueError as error:
        raise ConfigError(str(error)) from None


@contextmanager
def _recording(arm: DeployedArm, robot: Robot, output: Path) -> Iterator[_RecorderThread]:
    """A recorder of the running servo, whose log ends with the block. Raises what `record_running` does.

    What the servo did before is no part of the log: the arm may have carried something else.
    """
    from qrobot.cli.log import recorded_header
    from qrobot.log.follow import ServoFollower, log_paths
    from qrobot.log.writer import LogWriter

    _require_recordable(arm, robot)
    paths = log_paths(output, arm.name)
    writers: list[LogWriter] = []

    def open_log(servo: ServoInfo, pid: int) -> LogWriter:
        writers.append(LogWriter(next(paths), recorded_header(arm, robot, servo, pid)))
        return writers[-1]

    with QueuedReport(note) as told:
        recorder = _RecorderThread(ServoFollower(arm.name, open_log, told, from_now=True), arm.name)
        try:
            yield recorder
        finally:
            recorder.end()
        recorder.check()
    if not any(writer.status.rows for writer in writers):
        raise LogError(f"the servo of {arm.name} wrote no cycle meanwhile: nothing is recorded")
    if refused := [writer.last_error for writer in writers if writer.backlog]:
        raise LogError(f"the log is incomplete: {refused[0]}")


def _require_recordable(arm: DeployedArm, robot: Robot) -> None:
    """Raise LinkError: no servo runs, or it is not ready. ConfigError: it drives another robot.

    Raise MotionError: it would move too slowly to tell anything.
    """
    from qrobot.cli.log import recorded_header
    from qrobot.servo.memory.mailbox import ServoMailbox
    from qrobot.servo.memory.servo_memory import attach_servo_memory, servo_info

    insist_on_its_board(arm)
    with attach_servo_memory(arm.name) as memory:
        info = servo_info(memory.words)
        if not info.ready:
            raise LinkError(_NOT_READY.format(arm=arm.name))
        recorded_header(arm, robot, info, int(memory.header.owner_pid))
        _require_full_speed(arm.name, ServoMailbox(memory.words).snapshot())


def _require_full_speed(arm: str, told: ServoSnapshot) -> None:
    """Raise MotionError where the moves would be slower than planned."""
    slow = "the moves of a plan tell nothing where they are slower"
    if told.speed_limit < 1.0:
        raise MotionError(f"{arm} runs at reduced speed, and {slow}: start its servo without reduced speed")
    if told.flags & RobotFlag.PAUSED:
        raise MotionError(f"{arm} is in a pause: `qrobot ctl resume` first")
    if told.override < 1.0:
        raise MotionError(
            f"the speed override of {arm} is {told.override:.0%}, and {slow}: `qrobot ctl override 100` first"
        )


class _RecorderThread:
    """A follower in a thread of its own, and what has ended it."""

    def __init__(self, follower: ServoFollower, arm: str) -> None:
        self._follower, self._arm, self._stop = follower, arm, threading.Event()
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="recorder")

    def begin(self) -> None:
        """Open the log, which holds what the servo does from now on. Raises LinkError: the servo is away."""
        self._follower.step(0)
        if not self._follower.recording:
            raise LinkError(_NOT_READY.format(arm=self._arm))
        self._thread.start()

    def check(self) -> None:
        """Raise LogError when it has ended."""
        if self._error is not None:
            raise LogError(f"nothing is recorded any more: {self._error}") from self._error

    def end(self) -> None:
        """End the log, where there is one."""
        self._stop.set()
        if self._thread.ident is None:
            self._follower.close()
        else:
            self._thread.join()

    def _run(self) -> None:
        from qrobot.log.follow import follow

        try:
            follow(self._follower, self._stop)
        except Exception as error:  # who moves the arm is told, in another thread
            self._error = error


@contextmanager
def says_where_it_broke_off(told: Told) -> Iterator[Told]:
    """`told`, and a note of how to go on when the moves do not come to their end."""
    begun: list[tuple[int, str]] = []

    def kept(number: int, move: Swing | FourierRun) -> None:
        begun.append((number + 1, move.name))
        told(number, move)

    try:
        yield kept
    except BaseException as error:  # a stop by the operator too
        for number, name in begun[-1:]:
            said = f"it broke off in {name}: the same with --first"
            if _would_come_again(error):
                note(f"{said} {number + 1} and another --output leaves it out, if another move is left")
            else:
                note(f"{said} {number} and another --output goes on there")
        raise


def _would_come_again(error: BaseException) -> bool:
    """True where the move itself is what cannot be done."""
    return isinstance(error, MotionError) or (isinstance(error, ServoFault) and error.code == FaultCode.FENCE)


@contextmanager
def _bar(plan: ExcitationPlan | Excitation) -> Iterator[Told]:
    """A bar of the moves on the terminal, elsewhere a line for each."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    with Progress(*columns, console=err, disable=not err.is_terminal) as progress:
        task = progress.add_task("", total=len(plan.moves))

        def told(number: int, move: Swing | FourierRun) -> None:
            progress.update(task, completed=number, description=move.name)
            if progress.disable:
                note(f"{number + 1} of {len(plan.moves)}: {move.name}")

        yield told


def read_rows(
    logs: Sequence[Path], like: LogHeader | None = None, beside: Rows | None = None
) -> tuple[Rows, LogHeader]:
    """The rows of several logs of one robot at one rate, and the header of the first; `like` is that of others.

    A cycle that several logs have counts once, and not at all where it is among the rows `beside`.

    Raises:
        ConfigError: there is none.
        LogError: they do not belong together.
    """
    if not logs:
        raise ConfigError("name at least one log; `qrobot identify record` writes them")
    read = [read_and_warn(path) for path in logs]
    header = like or read[0].header
    header = replace(header, arm=header.arm or next((log.header.arm for log in read if log.header.arm), ""))
    for log in read:
        if log.torn:
            note(f"warning: {log.path} was not ended: the passes that it may have lost are not in the fit")
        if differs := _difference(log.header, header):
            raise LogError(f"{log.path} is of {differs} in {logs[0] if like is None else 'the others'}")
    kept: list[Rows] = [] if beside is None else [beside]
    for log in read:
        kept.append(_without(log, kept))
    return np.concatenate(kept if beside is None else kept[1:]), header


def _without(log: Log, others: Sequence[Rows]) -> Rows:
    """The rows of a log that `others` do not have; two cycles of a running servo are one when number and time agree.

    Virtual time begins anew in each log, so that it tells no cycles apart: there a log is the same as another one, or
    not. Two runs in lock-step are the same to the last bit, and the second tells nothing new.
    """
    if log.header.wall_offset_ns == 0:
        if not any(log.rows.tobytes() in rows.tobytes() for rows in others):
            return log.rows
        note(f"{log.path}: all of its cycles are in another log as well, and count once")
        return log.rows[:0]
    new = np.ones(log.rows.size, np.bool_)
    for rows in others:
        new &= ~np.isin(_cycles(log.rows), _cycles(rows))
    if new.all():
        return log.rows
    note(f"{log.path}: {new.size - np.count_nonzero(new)} of its cycles are in another log as well, and count once")
    return log.rows[new]


def _cycles(rows: Rows) -> Rows:
    """Number and time of each row, as one value to compare. Shape (m,)."""
    return np.stack([rows["tick"], rows["t_ns"]], axis=1).view("V16")[:, 0]


def _difference(header: LogHeader, other: LogHeader) -> str:
    """The first fact by which two logs do not belong together, with its value in the first; empty when they agree."""
    digests = {header.robot_digest, other.robot_digest} - {""}
    arms = {header.arm, other.arm} - {""}
    facts = (
        (header.robot != other.robot, f"robot {header.robot!r}, not {other.robot!r} as"),
        (
            header.joint_names != other.joint_names,
            f"joints {', '.join(header.joint_names)}, not {', '.join(other.joint_names)} as",
        ),
        (len(digests) > 1, f"a {header.robot} whose robot file has another geometry or transmission than"),
        (header.period_ns != other.period_ns, f"rate {header.rate_hz:g} Hz, not {other.rate_hz:g} as"),
        (len(arms) > 1, f"arm {header.arm!r}, not {other.arm!r} as"),
        (header.plant != other.plant, f"{_behind_board(header)}, not {_behind_board(other)} as"),
    )
    return next((fact for differs, fact in facts if differs), "")


def _behind_board(header: LogHeader) -> str:
    return f"an emulated arm (plant {header.plant!r})" if header.plant else "a real arm"
