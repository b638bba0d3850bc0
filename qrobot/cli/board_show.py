"""`qrobot board show` and `force`: what a board shows now; the panel of an emulated one worked by hand."""

from __future__ import annotations

import json as plain_json
import time
from typing import TYPE_CHECKING, Any, Final

from rich.text import Text

from qrobot.cli.arms import DEFAULT_DEPLOYMENT, choose_arm
from qrobot.cli.console import out, plain_table, print_table, write_json
from qrobot.errors import ConfigError, LinkLost

if TYPE_CHECKING:
    from qrobot.hwif.board_memory import BoardMemory

LOOK_S: Final = 0.1


def show(
    deployment: str = DEFAULT_DEPLOYMENT, *, arm: str | None = None, follow: bool = False, json: bool = False
) -> None:
    """Show every register of a board that runs, emulated or real, with its bits by name, and change nothing.

    Registers that cannot be read, DAC and DISCRETE, show what was last written to them. On an emulated board what is
    broken in it is shown too.

    Parameters
    ----------
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    follow
        Look again ten times a second until Ctrl-C, as one line of JSON each.
    json
        Print JSON.
    """
    from qrobot.hwif.board_look import BoardLooker
    from qrobot.hwif.board_memory import attach_board_memory

    chosen = choose_arm(deployment, arm)
    with attach_board_memory(chosen.name) as segment:
        looker = BoardLooker(segment.memory, chosen.board)

        def look() -> dict[str, Any]:
            return looker.look() | {"faults": _faults(segment.memory)}

        if not follow:
            write_json(look()) if json else _print(look())
            return
        out.print(plain_json.dumps({"kinds": _kinds()}), soft_wrap=True)
        while segment.owner_alive:
            out.print(plain_json.dumps(look()), soft_wrap=True)
            time.sleep(LOOK_S)
    raise LinkLost(f"the board of {chosen.name} has gone")


def force(*lines: str, deployment: str = DEFAULT_DEPLOYMENT, arm: str | None = None) -> None:
    """Work the panel of an emulated board that runs, as somebody who stands beside it would.

    A real board has its panel, and is refused. `qrobot board show` tells what came of it.

      qrobot board force "estop on"
      qrobot board force "input:3 on" "analog:7 1.5" "push:1 -20"
      qrobot board force clear

    Parameters
    ----------
    lines
        What to do: `estop on|off`, `power press`, `input:N on|off`, `analog:CHANNEL VOLT`, `push:JOINT N_M`, `clear`.
        What stays until it is taken back: everything but the press.
    deployment
        Deployment file, or the name of a packaged one.
    arm
        Which arm of the file; may be left out when there is only one.
    """
    from qrobot.cli.inject import require_emulator
    from qrobot.hwif.board_memory import attach_board_memory, local_board_memory
    from qrobot.sim_board.panel_lines import force_panel

    if not lines:
        raise ConfigError("what is to be done? `qrobot board force 'estop on'`, for example; `--help` has them all")
    chosen = choose_arm(deployment, arm)
    with attach_board_memory(chosen.name) as segment:
        require_emulator(segment.memory, chosen.name)
        trial = local_board_memory()
        trial.facts.joints = segment.memory.facts.joints
        for memory in (trial, segment.memory):  # all of them, or none
            for line in lines:
                force_panel(memory, line)


def _faults(memory: BoardMemory) -> list[dict[str, Any]]:
    """Faults injected into an emulated board; a real one has none of those."""
    from qrobot.cli.inject import plain
    from qrobot.sim_board.injection import FaultPanel

    return [plain(report) for report in FaultPanel(memory).reports()] if memory.facts.now_ns else []


def _kinds() -> list[dict[str, Any]]:
    from qrobot.sim_board.faults import KINDS

    return [kind._asdict() | {"address": kind.address} for kind in KINDS]


def _print(seen: dict[str, Any]) -> None:
    table = plain_table("registers", "register", "offset", "word", "value")
    for row in seen["registers"]:
        word = "" if row["word"] is None else f"{row['word']:#06x}"
        table.add_row(row["name"], f"{row['offset']:#04x}", word, row["told"])
    print_table(table)
    for register in ("STATUS", "DISCRETE"):
        on = [bit["name"] for bit in seen["bits"] if bit["register"] == register and bit["on"]]
        out.print(f"{register}: {'; '.join(on) or 'no bit is set'}", soft_wrap=True)
    for module in seen["modules"]:
        out.print(Text(f"{module['name']}: {'; '.join(module['lines'])}"), soft_wrap=True)
    told = ", ".join(f"{value:g} {name}" for name, value in seen["counters"].items())
    out.print(f"image {seen['count']}, revision {seen['revision']}: {told}", soft_wrap=True)
    for fault in seen["faults"]:
        out.print(Text(f"broken: {fault['fault']}"), soft_wrap=True)
