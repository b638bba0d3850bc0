"""`qrobot pendant`: look at arms, and drive them, from a browser."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Final

from cyclopts import Parameter

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm, robot_of_arm, tool_of_arm
from qrobot.cli.console import note, out
from qrobot.cli.option_types import OutputFile, Range, checked_file
from qrobot.config.deployment import DeployedArm, deployment_path, load_deployment
from qrobot.report import QueuedReport, ReportHandler

if TYPE_CHECKING:
    from qrobot.pendant.floor import DriveFloor
    from qrobot.pendant.log_shelf import LogShelf
    from qrobot.pendant.program_runner import ProgramRunner

DEFAULT_PORT: Final = 8560
PortOption = Annotated[int, Parameter(validator=Range(0, 65535))]


def pendant(
    *,
    deployment: str = DEFAULT_DEPLOYMENT,
    arm: str | None = None,
    port: PortOption = DEFAULT_PORT,
    taught: OutputFile | None = None,
    programs: Path | None = None,
    log: Path | None = None,
    show: bool = False,
) -> None:
    """Serve a page that shows the arms of a deployment live, and drives them: jog, power, places, curves, programs.

    It prints the address to open. Start the arms with `qrobot up`, before or after: the pendant finds them when they
    come, and again when they come back. STOP and the key Esc stop every arm, and so does the space bar, but in a field
    with text in it. This is no safety function: keep the emergency stop at hand.

    One page drives an arm at a time, and two pages may drive two arms. Everybody who was given the address may look.
    The server listens on this machine alone, and nothing is encrypted; from elsewhere come through a tunnel (ssh -L
    8560:127.0.0.1:8560).

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; all of them if left out.
    port
        Where to listen; 0 takes a free one.
    taught
        File of places by name, as `qrobot teach` has it; `taught.db` if left out. Where the deployment has several arms
        each has its own beside it, such as `taught-left.db`.
    programs
        Folder of programs (.py, .c, .v2) that pages list and start, beside what the arm was led through; no others.
    log
        Replay this log, without an arm: the page has the tab of logs alone.
    show
        Open the page in the browser of this machine.
    """
    import webbrowser

    from qrobot.pendant.floor import DriveFloor
    from qrobot.pendant.free_path import led_name
    from qrobot.pendant.program_folder import ProgramFolder
    from qrobot.pendant.program_runner import ProgramRunner
    from qrobot.pendant.server import address_of, make_app, make_token, open_port, serve

    floor, token = DriveFloor(), make_token()

    def runner_of(arm: DeployedArm) -> ProgramRunner:
        folder = ProgramFolder(programs, Path(arm.log.directory or "out"), led_name(arm.name))
        return ProgramRunner(arm.name, folder, str(deployment_path(deployment).resolve()), floor.changed)

    arms = () if log is not None else _arms(deployment, arm)
    several = log is None and len(_arms(deployment, None)) > 1
    if arms:
        places = taught or checked_file(Path("taught.db"))
        for each in arms:
            _add_station(floor, each, _places_of(each, places) if several else places, runner_of(each))
    shelf = _shelf_of_arms(arms) if log is None else _shelf_of(log)
    listener = open_port(port)
    address = address_of(listener, token)

    def began() -> None:
        out.print(address, soft_wrap=True)
        shown = f"It replays {log}" if log else f"Arms: {', '.join(each.name for each in arms)}"
        told(f"open it in a browser; Ctrl-C ends. {shown}")
        if show:
            webbrowser.open(entry.as_uri())

    with QueuedReport(note) as told, entry_file(address) as entry:
        logging.basicConfig(format="%(message)s", handlers=[ReportHandler(told)])  # STOP waits for no terminal
        serve(make_app(floor, token, shelf), listener, began)


@contextmanager
def entry_file(address: str) -> Iterator[Path]:
    """A page that goes on to `address`, for this account alone: what a browser is started with everybody can read."""
    with TemporaryDirectory(prefix="qrobot-pendant-") as folder:  # 0700
        page = Path(folder, "pendant.html")
        page.write_text(f'<!doctype html><meta http-equiv="refresh" content="0; url={escape(address)}">\n')
        yield page


def _shelf_of_arms(arms: Iterable[DeployedArm]) -> LogShelf:
    """The logs of some arms."""
    from qrobot.pendant.log_shelf import LogShelf

    return LogShelf([Path(arm.log.directory) for arm in arms if arm.log.directory])


def _shelf_of(log: Path) -> LogShelf:
    """The log that is to be replayed. Raises LogError: it cannot be opened."""
    from qrobot.log.windows import LogWindows
    from qrobot.pendant.log_shelf import LogShelf

    LogWindows(log)
    return LogShelf(files=[log])


def _arms(deployment: str, arm: str | None) -> tuple[DeployedArm, ...]:
    return load_deployment(deployment).arm if arm is None else (choose_arm(deployment, arm),)


def _places_of(arm: DeployedArm, taught: Path) -> Path:
    """The file of places of one of several arms: its numbers are in the base of that arm."""
    return taught.with_name(f"{taught.stem}-{arm.name}{taught.suffix}")


def _add_station(floor: DriveFloor, arm: DeployedArm, taught: Path, programs: ProgramRunner) -> None:
    """Give an arm its place at the pendant."""
    from qrobot.pendant.arm_station import ArmStation

    number, robot = len(floor.arms), robot_of_arm(arm)
    tell = lambda state: floor.sampled(number, state)  # noqa: E731
    floor.arms.append(ArmStation(arm, robot, tool_of_arm(arm), taught, tell, floor.changed, programs))
