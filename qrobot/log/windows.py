"""A log of any length by windows: exact rows of a short stretch, smallest and largest values of a long one.

The log is read once from its beginning, a chunk at a time. What stays in memory of a chunk is its place in the file and
the range of each quantity in it; rows are read again when they are shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import LogError
from qrobot.log.events import LogEvent, log_events
from qrobot.log.header import LogHeader
from qrobot.log.mcap_scan import PartScan, is_begun
from qrobot.log.read import Log
from qrobot.log.topics import part_beside
from qrobot.servo.memory.telemetry import Rows
from qrobot.units import NS_PER_S

QUANTITIES: Final = ("error", "position", "setpoint", "velocity", "torque")
EXACT_ROWS: Final = 120_000  # of a window that is read row by row, half a minute at 4 kHz
MOST_EXPORTED: Final = 100_000  # rows, 25 s at 4 kHz


class Curves(NamedTuple):
    """Quantities over time, joint by joint of each of QUANTITIES.

    Attributes:
        t_s: seconds since the log's first row, ascending. Shape (m,).
        low, high, first: over the rows since that instant, SI units. Shape (m, 5n).
    """

    t_s: Floats
    low: Floats
    high: Floats
    first: Floats


class _ChunkPlace(NamedTuple):
    part: int
    at: int
    rows: int
    begin_s: float
    low: Floats
    high: Floats
    first: Floats


class LogWindows:
    """A log with all its parts, read a piece at a time by `read_on`.

    Args:
        path: file of its first part.

    Attributes:
        header: facts of the log.
        end_s: time of the newest row read so far, seconds since the first one.
        damaged: places so far that could not be read.
        whole: the writer has ended the log; only known when everything is read.

    Raises:
        LogError: the file is missing, or is no log of this program.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._parts = [PartScan(path)]
        self._chunks: list[_ChunkPlace] = []
        self._events: list[LogEvent] = []
        self._before: Rows | None = None  # the newest row
        self._first: Rows | None = None
        self.end_s, self.damaged, self.whole = 0.0, 0, True
        self._ended = False
        self._parts[0].take_head()
        if self._parts[0].found.header is None:
            raise LogError(f"{path} is not a log of this program, or was cut off before its header")
        self.header: LogHeader = self._parts[0].found.header

    @property
    def share(self) -> float:
        """Share of the newest part that has been read, 1 when everything is."""
        return 1.0 if self._ended else min(self._parts[-1].share, 0.999)

    @property
    def log(self) -> Log:
        """The log with its first row alone, and what it carries."""
        found = self._parts[0].found
        rows = self.header.layout.empty(0) if self._first is None else self._first
        laws = tuple(dict.fromkeys(law for part in self._parts for law in part.found.laws))
        return Log(self.path, self.header, rows, attachments=found.attachments, laws=laws)

    @property
    def events(self) -> list[LogEvent]:
        """Events in what was read so far, in the order of time."""
        laws = [] if self._first is None else log_events(self.log)
        told = [event for event in laws if event.kind in ("law", "gains") and event.t_s >= 0]
        return sorted([*told, *self._events], key=lambda event: event.tick)

    def read_on(self) -> bool:
        """Read one more record; False when there is no more. Raises LogError: a part belongs to another log."""
        part = self._parts[-1]
        at, damage = part.at, len(part.found.damage)
        if self._ended or not part.step():
            return not self._ended and self._begin_part()
        self.damaged += len(part.found.damage) - damage
        rows, part.found.rows = part.found.rows, []
        for block in rows:
            self._take(block)
        if rows and at is not None:
            self._note_place(at, rows)
        return True

    def curves(self, begin_s: float, end_s: float, points: int) -> Curves:
        """Quantities from `begin_s` to `end_s` at `points` instants at most."""
        chosen = self._chunks_of(begin_s, end_s)
        if sum(chunk.rows for chunk in chosen) <= EXACT_ROWS:
            rows = self._rows_of(chosen, begin_s, end_s)
            values = quantities_of(rows)
            return thinned(Curves(self._time_s(rows), values, values, values), begin_s, end_s, points)
        t_s = np.array([chunk.begin_s for chunk in chosen])
        stacked = [np.array([getattr(chunk, name) for chunk in chosen]) for name in ("low", "high", "first")]
        return thinned(Curves(t_s, *stacked), begin_s, end_s, points)

    def rows(self, begin_s: float, end_s: float) -> Rows:
        """Rows from `begin_s` to `end_s`, shape (m,). Raises LogError: they are too many at a time."""
        chosen = self._chunks_of(begin_s, end_s)
        if sum(chunk.rows for chunk in chosen) > MOST_EXPORTED:
            seconds = MOST_EXPORTED / self.header.rate_hz
            more = f"more than {MOST_EXPORTED} cycles"
            raise LogError(f"{more}: show less than {seconds:.0f} s, or use `qrobot log export`")
        return self._rows_of(chosen, begin_s, end_s)

    def _begin_part(self) -> bool:
        self.whole = self.whole and self._parts[-1].found.ended
        following = part_beside(self.path, self.header.part, self.header.part + len(self._parts))
        if not following.exists():
            self._ended = True
            return False
        part = PartScan(following) if is_begun(following) else None
        if part is not None:
            part.take_head()
        if part is None or part.found.header is None:  # it was cut off before that
            self.whole, self._ended = False, True
            return False
        if replace(part.found.header, part=self.header.part) != self.header:
            raise LogError(f"{following} does not belong to {self.path}: move one of them")
        self._parts.append(part)
        return True

    def _take(self, rows: Rows) -> None:
        """Note the time and the events of rows that follow those before."""
        rows = self.header.layout.complete(rows)
        if self._first is None:
            self._first = rows[:1].copy()
        before = rows[:1] if self._before is None else self._before
        seen = np.concatenate([before, rows]) if self._before is not None else rows
        shift_s = float(self._time_s(before)[0])
        for event in log_events(Log(self.path, self.header, seen)):
            if self._before is None or event.tick > int(before["tick"][0]):
                self._events.append(replace(event, t_s=event.t_s + shift_s))
        self._before = rows[-1:].copy()
        self.end_s = float(self._time_s(self._before)[0])

    def _note_place(self, at: int, blocks: Sequence[Rows]) -> None:
        rows = self.header.layout.complete(np.concatenate(blocks))
        values = quantities_of(rows)
        ranges = (np.fmin.reduce(values), np.fmax.reduce(values), values[0])  # NaN hides nothing
        begin_s = float(self._time_s(rows[:1])[0])
        self._chunks.append(_ChunkPlace(len(self._parts) - 1, at, rows.size, begin_s, *ranges))

    def _chunks_of(self, begin_s: float, end_s: float) -> list[_ChunkPlace]:
        begins = np.array([chunk.begin_s for chunk in self._chunks])
        first = max(int(np.searchsorted(begins, begin_s, side="right")) - 1, 0)
        return self._chunks[first : int(np.searchsorted(begins, end_s, side="right"))]

    def _rows_of(self, chosen: Sequence[_ChunkPlace], begin_s: float, end_s: float) -> Rows:
        layout = self.header.layout
        blocks = [layout.complete(rows) for chunk in chosen for rows in self._parts[chunk.part].rows_at(chunk.at)]
        rows = np.concatenate(blocks) if blocks else layout.empty(0)
        t_s = self._time_s(rows)
        return rows[(t_s >= begin_s) & (t_s <= end_s)]

    def _time_s(self, rows: Rows) -> Floats:
        origin = int(self._first["t_ns"][0]) if self._first is not None else 0
        return np.asarray((rows["t_ns"] - origin) / NS_PER_S, dtype=np.float64)


def quantities_of(rows: Rows) -> Floats:
    """QUANTITIES of rows, one after the other, SI units. Shape (m, 5n)."""
    return np.concatenate([rows["q_ref"] - rows["q"], rows["q"], rows["q_ref"], rows["v"], rows["tau"]], axis=1)


def thinned(curves: Curves, begin_s: float, end_s: float, points: int) -> Curves:
    """The same with at most `points` instants, each with the range of those up to the next one."""
    if curves.t_s.size <= points:
        return curves
    starts = np.unique(np.searchsorted(curves.t_s, np.linspace(begin_s, end_s, points + 1)[:-1]))
    starts = starts[starts < curves.t_s.size]
    low, high = np.fmin.reduceat(curves.low, starts), np.fmax.reduceat(curves.high, starts)
    return Curves(curves.t_s[starts], low, high, curves.first[starts])
