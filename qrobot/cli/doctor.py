"""`qrobot doctor`: what this machine lacks, and how to fix it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

from qrobot.cli.checks import Finding, Weight, all_findings, running_servos
from qrobot.cli.console import FAILURE, SUCCESS, note, out, print_table, write_json
from qrobot.cli.fence_check import look_at_fences
from qrobot.realtime.runtime_folder import runtime_path
from qrobot.realtime.setup import SetupStep

if TYPE_CHECKING:
    from qrobot.config.deployment import DeployedArm

MARKS = {Weight.NEEDED: ("✘", "bold red"), Weight.TIMING: ("!", "yellow"), Weight.OPTIONAL: ("·", "cyan")}


def doctor(deployment: str = "emulator", *, rate: bool = False, json: bool = False) -> int:
    """Look at this machine: software, shared memory, ports, what real time needs, and at the fences of each arm.

    With --rate the servo's loop also runs here for some seconds, without a board, and it is told whether this machine
    keeps the rate of each arm, and which it would keep. That is not done beside a running arm.

    Exit status 0 when QRobot runs here, though perhaps with late cycles; 1 when something prevents it.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one, whose ports and cards are looked at.
    rate
        Try the rate of each arm.
    json
        Print JSON.
    """
    from qrobot.config import load_deployment

    arms = load_deployment(deployment).arm
    ports = {arm.name: (arm.bridge.host, arm.bridge.port) for arm in arms}
    bases = [arm.board.port.base for arm in arms if arm.board.port is not None]
    fences = [finding for arm in arms for finding in look_at_fences(arm, deployment)]
    findings = [*all_findings(ports, bases), *fences, *(_rates(arms) if rate else ())]
    usable = not any(finding.prevents_running for finding in findings)
    if json:
        write_json({"usable": usable, "findings": [_plain(finding) for finding in findings]})
    else:
        print_table(_table(findings))
        out.print(_verdict(findings))
        if not rate:
            out.print("qrobot doctor --rate tries which rate the servo would keep here", style="dim")
    return SUCCESS if usable else FAILURE


def _rates(arms: Sequence[DeployedArm]) -> Iterator[Finding]:
    """Whether this machine keeps the rate of each arm; a loop that is tried would disturb one that runs."""
    busy = running_servos(runtime_path())
    for arm in arms:
        steps = [_not_tried(busy)] if busy else _tried(arm)
        yield from (Finding(f"servo of {arm.name}", step, Weight.TIMING) for step in steps)


def _not_tried(busy: list[str]) -> SetupStep:
    detail = f"not tried beside {', '.join(busy)}: a servo tells at its start what its machine keeps"
    return SetupStep("rate", True, detail)


def _tried(arm: DeployedArm) -> list[SetupStep]:
    from qrobot.cli.arms import controlled_robot
    from qrobot.cli.servo_settings import servo_settings
    from qrobot.servo.process.daemon import warm_up
    from qrobot.servo.process.rate_trial import try_rate

    note(f"trying the rate of {arm.name} (a first time compiles for half a minute or more)")
    (robot, _), settings = controlled_robot(arm, None), servo_settings(arm)
    return try_rate(robot, settings, warm_up(robot, settings))


def _plain(finding: Finding) -> dict[str, Any]:
    return {"group": finding.group, "weight": finding.weight.value, **asdict(finding.step)}


def _table(findings: list[Finding]) -> Table:
    table = Table(box=None, show_header=False, padding=(0, 1, 0, 0))
    group = ""
    for finding in findings:
        if finding.group != group:
            group = finding.group
            table.add_row("", Text(group, style="bold"))
        step = finding.step
        mark, style = ("✔", "green") if step.ok else MARKS[finding.weight]
        table.add_row(Text(mark, style=style), Text(f"  {step.name}"), Text(step.detail))
        if not step.ok:
            table.add_row("", "", Text(f"→ {step.remedy}", style=style))
    return table


def _verdict(findings: list[Finding]) -> Text:
    if any(finding.prevents_running for finding in findings):
        return Text("QRobot cannot run here yet: fix what is marked ✘", style="bold red")
    late = sum(not finding.step.ok and finding.weight is Weight.TIMING for finding in findings)
    if late:
        return Text(f"QRobot runs here; {late} findings marked ! cost punctuality in real time", style="yellow")
    return Text("QRobot runs here, in real time as well", style="green")
