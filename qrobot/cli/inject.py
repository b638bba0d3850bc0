"""`qrobot inject`: let something break in an emulated board that runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm
from qrobot.cli.console import out, print_table, write_json
from qrobot.errors import LinkError

if TYPE_CHECKING:
    from qrobot.hwif.board_memory import BoardMemory
    from qrobot.sim_board.faults import FaultKind
    from qrobot.sim_board.injection import Injected


def inject(
    *faults: str,
    deployment: str = DEFAULT_DEPLOYMENT,
    arm: str | None = None,
    clear: bool = False,
    list: bool = False,
    json: bool = False,
) -> None:
    """Let something break in an emulated board that runs, and see whether it acted.

    Without faults it prints those in the board, with the board's steps in which each was active, and in which it made a
    difference. Only an emulated board can be broken so. `qrobot board --fault` injects from the start.

    Parameters
    ----------
    faults
        A line for each fault: what breaks and whose joint, how, and perhaps how much, when, for how long. Joint 2's
        encoder stands still from 1.5 s to 2 s from now: "encoder:2 stuck @1.5s +0.5s". Amplifier 1 gives 80 % of its
        torque: "dac:1 gain 0.8". The emergency stop is pressed for a moment: "estop pressed +100ms".
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    clear
        First repair everything that was broken. Counts an encoder has lost stay lost.
    list
        Only print what can break and how.
    json
        Print JSON.
    """
    if list:
        _list_kinds(json)
        return
    from qrobot.hwif.board_memory import attach_board_memory
    from qrobot.sim_board.faults import FaultPlan
    from qrobot.sim_board.injection import FaultPanel

    chosen, plan = choose_arm(deployment, arm), FaultPlan.parse(faults)
    with attach_board_memory(chosen.name) as segment:
        require_emulator(segment.memory, chosen.name)
        panel = FaultPanel(segment.memory)
        if clear:
            panel.clear()
        panel.extend(plan)
        _show(panel.reports(), json)


def require_emulator(memory: BoardMemory, arm: str) -> None:
    """Raise LinkError for a board that is none of ours to break."""
    if memory.facts.now_ns == 0:
        raise LinkError(f"the board of {arm} is no emulated one: nothing can be broken in it from here")


def _show(reports: list[Injected], json: bool) -> None:
    if json:
        write_json([plain(report) for report in reports])
    elif reports:
        table = Table("fault", "state", "steps active", "steps it acted", box=None)
        for report in reports:
            state = "over" if report.over else "active" if report.steps else "waiting"
            table.add_row(Text(str(report.fault)), state, str(report.steps), str(report.acted))
        print_table(table)
    else:
        out.print("nothing is broken; `qrobot inject --list` tells what can be")


def plain(report: Injected) -> dict[str, Any]:
    """A report for JSON."""
    return {"fault": str(report.fault), "steps": report.steps, "acted": report.acted, "over": report.over}


def _list_kinds(json: bool) -> None:
    from qrobot.sim_board.faults import KINDS

    if json:
        write_json([kind._asdict() for kind in KINDS])
        return
    table = Table("what", "how", "value", "what happens", box=None)
    for kind in KINDS:
        table.add_row(Text(kind.address), kind.name, _value(kind), Text(f"it {kind.what}"))
    print_table(table)


def _value(kind: FaultKind) -> str:
    return "" if kind.default is None else f"{kind.default:g} {kind.unit}"
