"""`qrobot board replay`: what a recording of a board's registers holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from qrobot.cli.console import print_table, write_json

if TYPE_CHECKING:
    from qrobot.hwif.replay import BusRecording


def replay(file: Path, *, json: bool = False) -> None:
    """Tell what a recording of `qrobot board --record` holds, and check that it can be played back.

    Every line is read and every access decoded. A test plays it with `qrobot.hwif.replay.Replay`, a bus that answers as
    the board did and names the first access that differs.

    Parameters
    ----------
    file
        The recording.
    json
        Print JSON.
    """
    from qrobot.hwif.replay import load_recording

    facts = _facts(load_recording(file))
    if json:
        write_json(facts)
        return
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 0))
    for name, value in facts.items():
        table.add_row(name.replace("_", " "), _in_words(value))
    print_table(table)


def _in_words(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{register} {count}" for register, count in value.items()) or "none"
    return ", ".join(value) if isinstance(value, list) else str(value)


def _facts(recording: BusRecording) -> dict[str, Any]:
    from qrobot.hwif.replay import BoardFound

    boards = [event.facts for event in recording.events if isinstance(event, BoardFound)]
    return {
        "boards": sorted({f"revision {facts.revision}, {facts.joints} joints" for facts in boards}),
        "connections": len(boards),
        "exchanges": len(recording.exchanges),
        "failed": sum(each.image is None for each in recording.exchanges),
        "duration_s": round(recording.duration_s, 6),
        "torn": recording.torn,
        "accesses": recording.accesses(),
    }
