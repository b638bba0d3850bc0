"""`qrobot board check`: walk through a board that nobody has driven yet."""

from __future__ import annotations

import sys
from contextlib import closing
from dataclasses import asdict
from typing import TYPE_CHECKING, Final

from rich.text import Text

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, card_of_arm, choose_arm, robot_of_arm
from qrobot.cli.console import FAILURE, SUCCESS, err, out, write_json
from qrobot.errors import ConfigError, LinkBusy, LinkError

if TYPE_CHECKING:
    from qrobot.config.deployment import DeployedArm
    from qrobot.hwif.bus import Bus
    from qrobot.rig.board_check import StepResult

PATIENCE_S: Final = 2.0
MARKS: Final = {True: ("✔", "green"), False: ("✘", "bold red"), None: ("·", "cyan")}


def check(
    deployment: str = DEFAULT_DEPLOYMENT,
    *,
    arm: str | None = None,
    read_only: bool = False,
    power: bool = False,
    yes: bool = False,
    json: bool = False,
) -> int:
    """Walk through a board that nobody has driven yet, and tell what is in order.

    In the order in which mistakes do least harm: what only reads, then what writes without arm power, then, with
    --power, power for an instant and a short push on each joint. The walk ends at the first step that fails, and leaves
    torque and power off, also when Ctrl-C, SIGTERM or a terminal that is closed ends it. Counters and the calibration
    keep their values; a walk that is broken off while counters take loads leaves the board uncalibrated.

    `qrobot board` must run, unless the board is a card on this machine's own bus, and no servo. Exit status 0 when
    nothing was found amiss, 1 otherwise.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    read_only
        Write nothing at all: the first thing to do with a real board.
    power
        Make the steps with arm power too: which way each joint goes, and whether its motor follows. THE ARM MAY SINK:
        support it, and keep a hand on the emergency stop.
    yes
        Ask nobody: leave out what needs hands or eyes, and take the questions of the steps with power as answered yes:
        not with an arm connected that nobody watches.
        Nobody then sees which way joints with a brake go: a mirrored one is not found.
    json
        Print JSON.
    """
    from qrobot.rig.board_check import Permissions, check_board
    from qrobot.rig.board_walk import Walk
    from qrobot.rig.interrupts import interrupted_by_signals
    from qrobot.servo.process.sole_servo import sole_servo

    if not yes and not read_only and not sys.stdin.isatty():
        raise ConfigError("nobody is there to answer: use a terminal, or --yes, or --read-only")
    chosen = choose_arm(deployment, arm)
    _refuse_to_write_to_what_is_read_only(chosen, read_only)
    _refuse_beside_a_servo(chosen.name)
    walk = Walk(
        _transport_to(chosen, read_only),
        robot_of_arm(chosen),
        (lambda _question: True) if yes else _ask,
        None if chosen.board.drives is None else chosen.board.drives.mode,
        lambda line: err.print(Text(f"  {line}"), soft_wrap=True),
    )
    findings = []
    permissions = Permissions(read_only, power, hands=not yes and not read_only)
    with interrupted_by_signals(), sole_servo(chosen.name), closing(check_board(walk, permissions)) as made:
        for finding in made:
            findings.append(finding)
            if not json:
                _tell(finding)
    good = all(finding.ok is not False for finding in findings)
    if json:
        write_json({"good": good, "findings": [asdict(finding) for finding in findings]})
    return SUCCESS if good else FAILURE


def _transport_to(arm: DeployedArm, read_only: bool) -> Bus:
    """The memory of the board process; a card on this machine's own bus has none, and is met at its ports."""
    from qrobot.hwif.isa.bus import PortBus
    from qrobot.hwif.memory_bus import board_memory_bus

    if arm.board.kind == "port":
        return PortBus(card_of_arm(arm, read_only), robot_of_arm(arm).n)
    return board_memory_bus(arm.name, timeout_s=PATIENCE_S)


def _refuse_to_write_to_what_is_read_only(arm: DeployedArm, read_only: bool) -> None:
    """Raise ConfigError where nothing of what such a walk writes would arrive."""
    if arm.board.port is not None and arm.board.port.read_only and not read_only:
        raise ConfigError(f"{arm.name}: read_only = true in [arm.board.port]: walk with --read-only, then take it out")


def _refuse_beside_a_servo(arm: str) -> None:
    """Two who write torques are one too many. Raises LinkBusy."""
    from qrobot.servo.memory.servo_memory import attach_servo_memory

    try:
        with attach_servo_memory(arm) as segment:
            alive = segment.owner_alive
    except LinkError:
        return
    if alive:
        raise LinkBusy(f"the servo of {arm} runs: end it first, for the walk writes to the board itself")


def _ask(question: str) -> bool:
    err.print(Text(f"  {question} [y/N] "), end="")
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _tell(finding: StepResult) -> None:
    mark, style = MARKS[finding.ok]
    out.print(Text(f"{mark} {finding.step}: ", style=style) + Text(finding.detail, style=""), soft_wrap=True)
    if finding.remedy:
        out.print(Text(f"  → {finding.remedy}", style=style), soft_wrap=True)
