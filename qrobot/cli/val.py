"""`qrobot val`: the monitor of VAL II; programs checked and run."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal, TypeAlias

from cyclopts import App, Parameter

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, fences_of_arm, inside_fences, robot_of_arm
from qrobot.cli.console import FAILURE, SUCCESS, complain, note, out, write_json
from qrobot.cli.option_types import OutputFolder, OutputLog, Range
from qrobot.cli.run import bridge_links, offline_links, run_through, run_virtual
from qrobot.cli.run_options import LockstepOption, OfflineOption, StartOption
from qrobot.errors import ConfigError, ProgramError
from qrobot.printable import printable
from qrobot.realtime.signals import ends_as_ctrl_c

if TYPE_CHECKING:
    from qrobot.cli.arm_links import ArmLinks
    from qrobot.config.deployment import DeployedArm
    from qrobot.val.arm import ValArm
    from qrobot.val.interpreter import Interpreter

HELP: Final = """
VAL II, the language that PUMA arms came with: its monitor, and programs checked and run.
"""
CycleCount = Annotated[int, Parameter(validator=Range(1))]
MonitorSpeed = Annotated[float, Parameter(validator=Range(0.1, 100.0, "%"))]
Library: TypeAlias = Literal["rccl", "arcl"]

app = App(name="val", help=HELP, help_format="plaintext", group_commands="Commands")


@app.command
def check(file: Path, *, deployment: str = DEFAULT_DEPLOYMENT, arm: str | None = None, json: bool = False) -> int:
    """Look for mistakes in a file before anything moves: status 1 when there are some.

    Structures and labels, programs that are missing, constant places that the arm cannot reach or that are too near to
    a fence of the deployment, signals that there are not.

    Parameters
    ----------
    file
        Programs and locations (.v2).
    deployment
        Deployment file, or the name of a packaged one: tells which robot, and its fences.
    arm
        Which arm of the file; may be left out when there is only one.
    json
        Print a list of mistakes as JSON.
    """
    return _check(file, choose_arm(deployment, arm), board=True, json=json)


def _check(file: Path, chosen: DeployedArm, board: bool, json: bool = False) -> int:
    """Tell the mistakes of a file; without a `board`, as off line, every signal is there."""
    from dataclasses import asdict

    from qrobot.val.check import check_text
    from qrobot.val.signal_lines import signal_lines_of
    from qrobot.val.source import source_text

    lines = signal_lines_of(chosen) if board else None
    mistakes = check_text(source_text(file), robot_of_arm(chosen), fences_of_arm(chosen), lines)
    if json:
        write_json([asdict(mistake) for mistake in mistakes])
    for mistake in [] if json else mistakes:
        where = f"line {mistake.line}, column {mistake.column}: " if mistake.line else ""
        out.print(f"{file.name}, {where}{mistake.what}", markup=False, highlight=False, soft_wrap=True)
    if not mistakes:
        note(f"{file.name}: no mistakes")
    return FAILURE if mistakes else SUCCESS


@app.default
def monitor(
    *,
    load: Path | None = None,
    deployment: str = DEFAULT_DEPLOYMENT,
    arm: str | None = None,
    library: Library = "rccl",
    lockstep: LockstepOption = False,
    offline: OfflineOption = False,
    start: StartOption = None,
) -> int:
    """Command an arm by VAL II's monitor, in the terminal or from a pipe; ? lists the commands.

    Commands may be abbreviated. Ctrl-C stops the arm on its path, and PROCEED goes on. Monitor speed is 50 % at first.

      qrobot val --offline --load examples/val/07_pause_and_proceed.v2
      echo "DO READY" | qrobot val --lockstep

    Parameters
    ----------
    load
        Programs and locations (.v2) to begin with.
    deployment
        Deployment file, or the name of a packaged one: tells where the bridge is.
    arm
        Which arm of the file; may be left out when there is only one.
    library
        What moves the arm below the interpreter.
    """
    _check_kind(lockstep, offline, start)
    chosen = choose_arm(deployment, arm)
    control = partial(_control, library, chosen, offline, None, start)
    with ends_as_ctrl_c() as ended:
        begin = partial(_start, load, "monitor", control, partial(_serve, ended=ended), None if offline else chosen)
        status = _perform(chosen, begin, load or Path(__file__), deployment, lockstep, offline, None, None, start)
        if ended():
            raise KeyboardInterrupt
        return status


def _check_kind(lockstep: bool, offline: bool, start: str | None) -> None:
    if lockstep and offline:
        raise ConfigError("--offline knows no servo and no board: leave out --lockstep")
    if start is not None and not (lockstep or offline):
        raise ConfigError("--start: only with --lockstep or --offline; a running arm stands where it is")


@app.command
def run(
    file: Path,
    *,
    execute: str = "",
    cycles: CycleCount = 1,
    speed: MonitorSpeed = 50.0,
    deployment: str = DEFAULT_DEPLOYMENT,
    arm: str | None = None,
    library: Library = "rccl",
    lockstep: LockstepOption = False,
    offline: OfflineOption = False,
    start: StartOption = None,
    output: OutputFolder | None = None,
    log: OutputLog | None = None,
) -> int:
    """Run a program of a file: on a running arm, in lock-step on an emulated one, or off line on an ideal one.

    The file is checked first, and nothing moves when it has a mistake. At a PAUSE, return goes on.

      qrobot val run --offline examples/val/01_pick_and_place.v2
      qrobot val run --lockstep --speed 100 examples/val/03_light_curtain.v2

    Parameters
    ----------
    file
        Programs and locations (.v2).
    execute
        Name of the program; when left out main, or the only one of the file.
    cycles
        How often.
    speed
        Monitor speed in percent, a factor of every speed of the program.
    deployment
        Deployment file, or the name of a packaged one: tells where the bridge is.
    arm
        Which arm of the file; may be left out when there is only one.
    library
        What moves the arm below the interpreter.
    output
        Folder for what is written down of the run: requests, setpoints, figures.
    log
        With --lockstep: log of every cycle to write.
    """
    _check_kind(lockstep, offline, start)
    if log is not None and not lockstep:
        raise ConfigError("--log: only with --lockstep; a running arm has its own")
    chosen = choose_arm(deployment, arm)
    if (status := _check(file, chosen, board=not offline)) != SUCCESS:
        return status
    control = partial(_control, library, chosen, offline, output, start)
    act = partial(_execute, program=execute.lower(), cycles=cycles, speed=speed)
    begin = partial(_start, file, file.name, control, act, None if offline else chosen)
    with ends_as_ctrl_c():
        return _perform(chosen, begin, file, deployment, lockstep, offline, output, log, start)


def _perform(
    chosen: DeployedArm, begin: Callable[[], int], file: Path, deployment: str, lockstep: bool, offline: bool,
    output: Path | None, log: Path | None, start: str | None,
) -> int:  # fmt: skip
    """Call `begin` where the arm is, inside its fences."""
    with inside_fences(chosen):
        if offline:
            return run_virtual(offline_links(chosen, start), begin, output, ideal=True)
        if not lockstep:
            return run_through(bridge_links(chosen), begin, output)
        from qrobot.cli.run_lockstep import LockstepRun

        def perform(links: ArmLinks) -> int:
            return run_virtual(links, begin, output)

        return LockstepRun((chosen,), file, start=start).perform(perform, deployment, log)


def _start(
    file: Path | None,
    name: str,
    control: Callable[[], AbstractContextManager[ValArm]],
    act: Callable[[Interpreter], int],
    wired: DeployedArm | None,
) -> int:
    """Take control of the arm, as `name`, load the file, and `act`; `wired` tells where outputs lead."""
    from qrobot.val.interpreter import Interpreter
    from qrobot.val.signal_lines import signal_lines_of
    from qrobot.val.source import load_source

    source = None if file is None else load_source(file)
    sys.argv[0] = f"val: {name}"  # how it greets the bridge
    with control() as arm:
        interpreter = Interpreter(arm, _say, _ask)
        interpreter.machine.lines = None if wired is None else signal_lines_of(wired)
        if source is not None:
            interpreter.machine.load(source)
        return act(interpreter)


@contextmanager
def _control(
    library: Library, chosen: DeployedArm, offline: bool, output: Path | None, start: str | None
) -> Iterator[ValArm]:
    """Control of the arm by a library; a stream of ARCL goes to `output`."""
    if library == "rccl":
        from qrobot.rccl import control
        from qrobot.val.rccl_arm import RcclArm

        with control(chosen.robot) as channel:
            yield RcclArm(channel)
        return
    from qrobot.cli.run import machine_of
    from qrobot.val.arcl_arm import arcl_arm

    with (
        machine_of((chosen,), "offline" if offline else "bridge", output, start),
        arcl_arm(robot_of_arm(chosen), chosen.bridge.period_ms if offline else None) as arm,
    ):
        yield arm


def _serve(interpreter: Interpreter, ended: Callable[[], bool]) -> int:
    from qrobot.val.monitor import ValMonitor
    from qrobot.val.terminal import serve

    serve(ValMonitor(interpreter), _say, ended)
    return SUCCESS


def _execute(interpreter: Interpreter, program: str, cycles: int, speed: float) -> int:
    from qrobot.val.interpreter import RunState
    from qrobot.val.terminal import forget_typed

    interpreter.machine.arm.override = speed
    try:
        state = interpreter.execute(_chosen(program, list(interpreter.machine.programs)), cycles)
        while state is RunState.PAUSED:
            forget_typed()
            _ask(f"{interpreter.message}; return goes on ")
            state = interpreter.proceed()
    except KeyboardInterrupt:
        if interpreter.state is RunState.FAILED:  # in the same turn
            complain(interpreter.message)
        elif interpreter.task is not None:
            complain("interrupted in program {}, line {}: the arm stands".format(*interpreter.task.at))
        raise
    if state is RunState.COMPLETED:
        return SUCCESS
    complain(interpreter.message)
    return FAILURE


def _chosen(name: str, programs: list[str]) -> str:
    """The program to be run: of that name, or `main`, or the only one. Raises ProgramError: there is none."""
    wanted = name or (programs[0] if len(programs) == 1 else "main")
    if wanted not in programs:
        there = ", ".join(programs) or "none"
        raise ProgramError(f"there is no program {printable(wanted)} in the file; name one by --execute: {there}")
    return wanted


def _say(line: str) -> None:
    out.print(line, markup=False, highlight=False, soft_wrap=True)


def _ask(question: str) -> str:
    try:
        return input(question)
    except EOFError:
        raise ConfigError("the program waits for an answer, and there is no more input") from None
