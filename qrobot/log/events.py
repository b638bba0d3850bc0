"""Events of a log besides motion: modes, faults, laws and gains, in the order of time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.faultcodes import explain, fault_name
from qrobot.log.read import Log
from qrobot.modecodes import mode_name
from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.telemetry import Rows

LogEventKind = Literal["law", "gains", "fault", "mode"]
GAINS: Final = (("Kp", "kp"), ("Kv", "kv"), ("inertia", "inertia"))  # for people, in `LawInForce`


@dataclass(frozen=True)
class LogEvent:
    """One thing that happened.

    Attributes:
        t_s: time of the first cycle after it, seconds since the first row.
        tick: number of that cycle.
        kind: what changed; a fault is any code worth knowing, also one that stopped nothing.
        short: a word or two, for a mark in a figure.
        text: one line for people.
    """

    t_s: float
    tick: int
    kind: LogEventKind
    short: str
    text: str

    @property
    def line(self) -> str:
        """One line for people, with the time."""
        return f"{self.t_s:.3f} s: {self.text}"

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self) | {"line": self.line}


def log_events(log: Log) -> list[LogEvent]:
    """Everything that happened in a log. Of one cycle: laws and gains, then faults, then the mode they led to."""
    events = [*_law_events(log), *row_events(log.rows, log.time_s)]
    return sorted(events, key=lambda event: event.tick)


def row_events(rows: Rows, t_s: Floats) -> list[LogEvent]:
    """Faults and modes of rows, shape (m,), with their times; those of a cycle as `log_events` has them.

    A fault that stands at the first row is told there.
    """
    return sorted([*_fault_events(rows, t_s), *_mode_events(rows, t_s)], key=lambda event: event.tick)


def _law_events(log: Log) -> Iterator[LogEvent]:
    for before, after in pairwise(log.laws if log.rows.size else ()):
        if _names_alone(before, after):
            continue
        t_s = (after.t_ns - int(log.rows["t_ns"][0])) * 1e-9
        if after.told != before.told:
            yield LogEvent(t_s, after.tick, "law", after.law, f"law {before.told} -> {after.told}")
        if text := _gains_told(before, after):
            yield LogEvent(t_s, after.tick, "gains", "gains", text)
        elif after.told == before.told:  # a law in a file may have another text now
            yield LogEvent(t_s, after.tick, "law", after.law, f"law {after.told} anew")


def _names_alone(before: LawInForce, after: LawInForce) -> bool:
    """Whether the names of a program's numbers are all that changed."""
    same = replace(after, t_ns=before.t_ns, tick=before.tick, program_signals=before.program_signals) == before
    return same and before.program_signals != after.program_signals


def _gains_told(before: LawInForce, after: LawInForce) -> str:
    """The rows of gains that changed, such as "Kv 10 20 -> 12 20"; empty when none did."""
    rows = ((told, getattr(before, name), getattr(after, name)) for told, name in GAINS)
    return ", ".join(f"{told} {_listed(old)} -> {_listed(new)}" for told, old, new in rows if old != new)


def _listed(row: tuple[float, ...]) -> str:
    return " ".join(f"{value:g}" for value in row)


def _fault_events(rows: Rows, t_s: Floats) -> Iterator[LogEvent]:
    for k in _changes(rows["fault"], first=0):
        if code := int(rows["fault"][k]):
            text = explain(code, int(rows["event_joint"][k]))
            yield LogEvent(t_s[k].item(), int(rows["tick"][k]), "fault", fault_name(code), text)


def _mode_events(rows: Rows, t_s: Floats) -> Iterator[LogEvent]:
    modes = rows["mode"]
    for k in _changes(modes, first=modes[:1]):
        before, after = mode_name(int(modes[k - 1])), mode_name(int(modes[k]))
        yield LogEvent(t_s[k].item(), int(rows["tick"][k]), "mode", after, f"{before} -> {after}")


def _changes(column: NDArray[np.int64], first: Any) -> NDArray[np.int64]:
    """Rows that differ from the one before; the one before the first is `first`."""
    return np.flatnonzero(np.diff(column, prepend=first))
