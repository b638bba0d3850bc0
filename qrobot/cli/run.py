"""`qrobot run`: a robot program, against the bridge of a running arm or in lock-step without one."""

from __future__ import annotations

import io
import os
import runpy
import sys
import traceback as python_traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Parameter

from qrobot.cli import run_options as options
from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arms, inside_fences, place_of_arm, robot_of_arm
from qrobot.cli.console import FAILURE, complain, err, note
from qrobot.cli.option_types import checked_folder
from qrobot.cli.program_errors import own_place, own_traceback
from qrobot.config.start_place import start_place
from qrobot.errors import ConfigError, QRobotError
from qrobot.realtime.signals import ends_as_ctrl_c
from qrobot.units import US_PER_MS

if TYPE_CHECKING:
    from qrobot.c_transport.memory import ProgramMemory
    from qrobot.c_transport.program_link import CallDispatcher, ProgramLink
    from qrobot.cli.arm_links import ArmLinks
    from qrobot.config.deployment import DeployedArm
    from qrobot.rci import LinkFactory
    from qrobot.wire import Hello

NO_PROGRAMS: Final = {
    ".c": "a source: compile it with `qrobot cc {program} -o {program.stem}`, and run that",
    ".toml": "a deployment file, not a program: `qrobot run --deployment {program} PROGRAM`",
    ".v2": "a program in VAL II: `qrobot val run {program}`",
    ".csv": "a table, not a program: `qrobot replay {program}` sends its setpoints to an arm",
    ".parquet": "a table, not a program: `qrobot replay {program}` sends its setpoints to an arm",
    ".mcap": "a log, not a program: look at it with `qrobot log info {program}`",
}
"""What is given in place of a program of Python, or one that was compiled, and what to do."""


def run(
    program: Path,
    *arguments: Annotated[str, Parameter(allow_leading_hyphen=True)],
    deployment: str = DEFAULT_DEPLOYMENT,
    arm: options.ArmOption = None,
    lockstep: options.LockstepOption = False,
    offline: options.OfflineOption = False,
    start: options.StartOption = None,
    output: options.OutputOption = None,
    plant: options.PlantOption = None,
    scene: options.SceneOption = None,
    law: options.LawOption = None,
    model: options.ModelOption = None,
    rate: options.RateOption = None,
    log: options.LogOption = None,
    record: options.RecordOption = None,
    traceback: options.TracebackOption = False,
) -> int:
    """Run a program that moves arms by `qrobot.rccl`, `multi_rccl`, `rci` or `arcl`, or one in C that `qrobot cc` made.

    The program is an ordinary one; it finds the arm by itself. With --lockstep it needs no running arm: an emulated
    one runs inside this process on virtual time, the same way every time, and as fast as the machine allows. With
    --offline there is no servo and no board either: an ideal arm follows every setpoint, and what the program asked for
    and sent is written down: a trace of its requests, a setpoint file for `qrobot replay`, figures of joints and path;
    of an ARCL program the stream, for `qrobot arcl`.
    With --output that is done for the other kinds of run too; the path then has the measured one beside it.

      qrobot run examples/01_park_and_return.py
      qrobot run --lockstep examples/01_park_and_return.py
      qrobot run --lockstep --deployment two_arms examples/22_two_hands.py
      qrobot run --offline examples/02_four_corners.py
      qrobot run --output out/box examples/12_box.py
      qrobot run --offline ./four_corners
      qrobot run --lockstep --record box.gif examples/12_box.py

    Parameters
    ----------
    program
        Path of the script, or of the executable.
    arguments
        Its own command-line arguments.
    deployment
        Deployment file, or the name of a packaged one: tells where the bridge is.
    """
    emulated = {"plant": plant, "scene": scene, "law": law, "model": model, "rate": rate, "log": log}
    _check(program, [f"--{name}" for name, value in emulated.items() if value is not None], lockstep, offline, start)
    arms = choose_arms(deployment, arm)
    _check_one_arm(arms, {"--record": record, "--start": start})
    begin = partial(_start, program, arguments, arms[0].robot)
    folder = checked_folder(Path("out") / "offline" / program.stem) if offline and output is None else output

    def perform() -> int:
        if lockstep:
            from qrobot.cli.run_lockstep import LockstepRun

            rig = LockstepRun(arms, program, plant, scene, law, model, rate, start)
            return rig.perform(partial(run_virtual, start=begin, output=folder), deployment, log, record)
        with _filmed(arms, program, record) as heard:
            if offline:
                return _run_ideal(arms, begin, folder, start, heard)
            _tell_scene(program)
            return run_live(arms, begin, folder, heard)

    def perform_as_chosen() -> int:
        with machine_of(arms, "offline" if offline else "bridge", folder, start), _fences(arms):
            return perform()

    with nullcontext() if lockstep or offline else ends_as_ctrl_c():
        return _told(perform_as_chosen, traceback)


def machine_of(
    arms: Sequence[DeployedArm], ami: str, folder: Path | None, start: str | None = None
) -> AbstractContextManager[None]:
    """Block in which programs of ARCL have that machine; what the file says is said where it is about a single arm."""
    from qrobot.cli.teach_pendant import terminal_pendant
    from qrobot.rci.machine_choice import MachineChoice, use_machine

    if len(arms) != 1:
        return use_machine(MachineChoice(ami, folder, pendant=terminal_pendant))
    (arm,) = arms
    choice = MachineChoice(
        ami, folder, robot_of_arm(arm), arm.named_signals, terminal_pendant, arm.analog_ranges, start_place(start, arm),
        frozenset(each.output for each in arm.board.lines), place_of_arm(arm),
    )  # fmt: skip
    return use_machine(choice)


def _fences(arms: Sequence[DeployedArm]) -> AbstractContextManager[None]:
    """Block in which motions keep off the fences of a single arm; those of several are their servos' alone."""
    return inside_fences(arms[0]) if len(arms) == 1 else nullcontext()


@contextmanager
def _filmed(
    arms: Sequence[DeployedArm], program: Path, record: Path | None
) -> Iterator[Callable[[LinkFactory], LinkFactory]]:
    """Block whose links are listened to for a film, which is made when it has ended, well or not; None for none."""
    if record is None:
        yield lambda links: links
        return
    from qrobot.cli.run_film import Heard, film_heard, filmed

    heard = Heard()
    with filmed(lambda: film_heard(heard, program.name, arms[0], record)):
        yield heard.links


def _check(program: Path, emulated: Sequence[str], lockstep: bool, offline: bool, start: str | None) -> None:
    """Raise ConfigError for no program, or options that do not go together; `emulated` needs an emulated arm."""
    if start is not None and not (lockstep or offline):
        raise ConfigError("--start: only with --lockstep or --offline; a running arm stands where it is")
    if not program.is_file():
        raise ConfigError(f"no program {program}")
    if program.suffix in NO_PROGRAMS:
        raise ConfigError(f"{program} is {NO_PROGRAMS[program.suffix].format(program=program)}")
    if offline and (lockstep or emulated):
        raise ConfigError(f"--offline knows no servo and no board: leave out {', '.join(emulated) or '--lockstep'}")
    if emulated and not lockstep:
        raise ConfigError(f"{', '.join(emulated)}: only with --lockstep; a running arm has what it was started with")


def _check_one_arm(arms: Sequence[DeployedArm], options: dict[str, object]) -> None:
    """Raise ConfigError for an option that was given, and is about one arm, where there are several."""
    for option in [name for name, value in options.items() if value is not None]:
        if len(arms) > 1:
            raise ConfigError(f"{option} is about one arm; choose it with --arm")


def _tell_scene(program: Path) -> None:
    """Note which scene the program is made for: nothing can be put round an arm that runs."""
    from qrobot.cli.program_settings import settings_of

    if scene := settings_of(program).scene:
        note(f"{program.name} is made for the scene {scene!r}: something of the kind has to stand around the arm")


def _told(perform: Callable[[], int], everything: bool) -> int:
    """Run it, and tell an exception of the program by the user's own lines; one of ours is one line, with the place."""
    try:
        return perform()
    except QRobotError as error:
        if not everything:
            complain(f"{error}{own_place(error)}")
            return FAILURE
        python_traceback.print_exc()
    except Exception as error:  # whatever a user's program raises
        if everything:
            python_traceback.print_exc()
        else:
            err.print(own_traceback(error), end="", markup=False, soft_wrap=True)
    return FAILURE


def run_virtual(links: ArmLinks, start: Callable[[], int], output: Path | None = None, ideal: bool = False) -> int:
    """`run_through` on virtual time, which tasks of RCI have to be told; they end with the program."""
    from qrobot import rci
    from qrobot.cli.arm_links import the_only

    with rci.use(links):
        try:
            return run_through(the_only(links), start, output, ideal)
        finally:
            rci.rci_close()


def _run_ideal(
    arms: Sequence[DeployedArm],
    begin: Callable[[], int],
    folder: Path | None,
    start: str | None,
    heard: Callable[[LinkFactory], LinkFactory],
) -> int:
    """`run_through` ideal arms, that begin at `start`; `heard` may listen to their links."""
    from qrobot.cli.arm_links import links_of

    links = links_of(arms, lambda arm: heard(offline_links(arm, start)))
    return run_virtual(links, begin, folder, ideal=True)


def run_live(
    arms: Sequence[DeployedArm],
    start: Callable[[], int],
    output: Path | None = None,
    heard: Callable[[LinkFactory], LinkFactory] = lambda links: links,
) -> int:
    """`run_through` the bridge of an arm, or those of several, which the program names; `heard` may listen to one."""
    if len(arms) == 1:
        return run_through(heard(bridge_links(arms[0])), start, output)
    from qrobot import rci
    from qrobot.cli.arm_links import link_of, links_of, the_only
    from qrobot.rci.tcp import insist_on_arm
    from qrobot.realtime.startup_order import await_turn

    await_turn()
    for arm in arms:  # now: a generator in a process of its own knows the address of its bridge alone
        insist_on_arm((arm.bridge.host, arm.bridge.port), arm.name)
    links = links_of(arms, link_of)
    with rci.use(links, virtual_time=False):
        return run_through(the_only(links), start, output)


def run_through(factory: LinkFactory, start: Callable[[], int], output: Path | None = None, ideal: bool = False) -> int:
    """Run the program over links of `factory`; what it did is written to `output`, if there is one."""
    if output is not None:
        from qrobot.cli.traced import run_traced

        return run_traced(start, factory, output, ideal)
    from qrobot import rccl

    with rccl.use(factory):
        return start()


def _start(program: Path, arguments: Sequence[str], robot: str) -> int:
    """Run the program; its exit status. One in C does not say itself which robot it wants."""
    from qrobot.c_transport.program import is_executable, run_served
    from qrobot.rccl.program import ending

    if is_executable(program):
        from qrobot.rccl.c.program import rccl_dispatcher

        return run_served(program, arguments, [rccl_dispatcher(robot), _arcl_dispatcher, _manip_dispatcher])
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)  # behind a pipe too: what the arm does is told when it does it
    sys.argv = [str(program), *arguments]
    sys.path.insert(0, str(program.resolve().parent))
    with ending(), _arcl_ending():
        runpy.run_path(str(program), run_name="__main__")
    return 0


def _arcl_dispatcher(memory: ProgramMemory, places: Sequence[int], link: ProgramLink) -> CallDispatcher:
    """Dispatcher of a program in C of ARCL: its part of the package is not loaded for others."""
    from qrobot.arcl.c.dispatcher import ArclDispatcher

    return ArclDispatcher(memory, places, link)


def _manip_dispatcher(memory: ProgramMemory, places: Sequence[int], link: ProgramLink) -> CallDispatcher:
    """Dispatcher of a program in C of Multi-RCCL, loaded as that of ARCL is."""
    from qrobot.multi_rccl.c.dispatcher import ManipDispatcher

    return ManipDispatcher(memory, places, link)


@contextmanager
def _arcl_ending() -> Iterator[None]:
    """An ARCL program runs in this block: when it ends well its motions are done first; all robots are let go."""
    from qrobot.rccl.arm_session import ended_well

    error: BaseException | None = None
    try:
        yield
    except BaseException as raised:
        error = raised
        raise
    finally:
        if "qrobot.arcl.program" in sys.modules:
            sys.modules["qrobot.arcl.program"].end_all(ended_well(error))


def bridge_links(arm: DeployedArm) -> LinkFactory:
    """Links to the arm of the deployment file; whatever else looks for a bridge in this program gets that one too.

    A bridge that the environment names may be another arm's, whose fences and outputs are not these: it is told, and
    does not count.

    Raises ConfigError: another arm's bridge is at that address.
    """
    from qrobot.cli.arm_links import link_of
    from qrobot.rci.tcp import BRIDGE_VARIABLE, insist_on_arm
    from qrobot.realtime.startup_order import await_turn

    await_turn()
    named, own = os.environ.get(BRIDGE_VARIABLE), place_of_arm(arm)
    if named and not _leads_to(named, own):
        note(f"{BRIDGE_VARIABLE} is {named}, but the bridge of {arm.name} is {own}, as its deployment file says")
    os.environ[BRIDGE_VARIABLE] = own
    # Here, for programs that come to the arm by the address alone.
    insist_on_arm((arm.bridge.host, arm.bridge.port), arm.name)
    return link_of(arm)


def _leads_to(named: str, place: str) -> bool:
    """True when `named` is the address `place`, in full or not; False for what is no address."""
    from qrobot.rci.tcp import address_text

    with suppress(ConfigError):
        return address_text(named) == place
    return False


def offline_links(arm: DeployedArm, start: str | None = None) -> LinkFactory:
    """Links to an ideal arm as in the deployment file; a program that names another packaged one gets that, parked.

    Raises ConfigError: there is no such place to `start` at (`start_place`).
    """
    from qrobot.rccl.offline import OfflineLink

    robot, place, period_us = robot_of_arm(arm), start_place(start, arm), round(arm.bridge.period_ms * US_PER_MS)

    def link(hello: Hello) -> OfflineLink:
        known = hello.robot == robot.name
        return OfflineLink(hello, robot if known else None, place if known else None, period_us)

    return link
