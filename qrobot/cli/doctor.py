"""`qrobot doctor`: what this machine lacks, and how to fix it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rich.table import Table
from rich.text import Text

from qrobot.cli.checks import Finding, Weight, all_findings
from qrobot.cli.console import FAILURE, SUCCESS, out, print_table, write_json

MARKS = {Weight.NEEDED: ("✘", "bold red"), Weight.TIMING: ("!", "yellow"), Weight.OPTIONAL: ("·", "cyan")}


def doctor(deployment: str = "emulator", *, json: bool = False) -> int:
    """Look at this machine: software, shared memory, ports, and what real time needs.

    Exit status 0 when QRobot runs here, though perhaps with late cycles; 1 when something prevents it.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one, whose ports and cards are looked at.
    json
        Print JSON.
    """
    from qrobot.config import load_deployment

    arms = load_deployment(deployment).arm
    ports = {arm.name: (arm.bridge.host, arm.bridge.port) for arm in arms}
    bases = [arm.board.port.base for arm in arms if arm.board.port is not None]
    findings = list(all_findings(ports, bases))
    usable = not any(finding.prevents_running for finding in findings)
    if json:
        write_json({"usable": usable, "findings": [_plain(finding) for finding in findings]})
    else:
        print_table(_table(findings))
        out.print(_verdict(findings))
    return SUCCESS if usable else FAILURE


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
