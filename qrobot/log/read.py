"""Read logs back: whole ones, rotated ones, and those whose writer was killed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from qrobot.errors import LogError
from qrobot.log.damage import DamagedPlace
from qrobot.log.header import LogHeader
from qrobot.log.mcap_scan import Contents, is_begun, scan_file
from qrobot.log.status import LogStatus
from qrobot.log.topics import part_beside
from qrobot.servo.memory.law_history import LawInForce
from qrobot.servo.memory.telemetry import Rows, TelemetryLayout


@dataclass(frozen=True)
class LostCycles:
    """Cycles that a damaged place in a file has cost; None where there is nothing to know it by.

    Attributes:
        cycles: how many.
        begin_s, end_s: time of the first and last of them, seconds since the log's first row.
    """

    cycles: int | None
    begin_s: float | None
    end_s: float | None

    @property
    def line(self) -> str:
        """One line for people."""
        number = "an unknown number of cycles" if self.cycles is None else f"{self.cycles} cycles"
        if self.begin_s is None or self.end_s is None:
            return f"{number} at an unknown time"
        return f"{number} from {self.begin_s:.4f} s to {self.end_s:.4f} s"


@dataclass(frozen=True)
class Log:
    """Everything in a log.

    Attributes:
        path: file of its first part.
        header: facts of the log, see `LogHeader`.
        rows: one record per cycle, dtype `header.layout.dtype`, shape (rows,).
        status: the newest count of what was lost.
        attachments: files carried in the log, by name.
        torn: the writer did not end the log; everything up to its last flush is here.
        parts: the files read.
        lost: what damage to the files has cost; empty when nothing.
        laws: laws and gains in force, from those at the first row on; empty when the log tells the name alone.
    """

    path: Path
    header: LogHeader
    rows: Rows
    status: LogStatus = field(default_factory=LogStatus)
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    torn: bool = False
    parts: tuple[Path, ...] = ()
    laws: tuple[LawInForce, ...] = ()
    lost: tuple[LostCycles, ...] = ()

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Seconds since the first row, shape (rows,)."""
        t_ns = self.rows["t_ns"]
        return np.asarray((t_ns - t_ns[:1]) * 1e-9, dtype=np.float64)

    @property
    def tracking_error(self) -> NDArray[np.float64]:
        """Desired minus measured position, rad or m, shape (rows, n)."""
        return np.asarray(self.rows["q_ref"] - self.rows["q"], dtype=np.float64)

    @property
    def law_names(self) -> tuple[str, ...]:
        """Names of the laws in force, one after the other."""
        names = [self.header.law, *(law.law for law in self.laws)]
        return (names[0], *(after for before, after in pairwise(names) if after != before))

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Names of the first columns of `rows["signals"]`; none when laws of the log do not agree about them."""
        names = {law.signals for law in self.laws}
        return tuple(names.pop().split()) if len(names) == 1 else ()

    @property
    def program_signal_names(self) -> tuple[str, ...]:
        """Names of the first columns of `rows["program_signals"]`; none when programs of the log do not agree.

        A program names its numbers one by one: a list agrees with the longer ones that begin with it.
        """
        names = sorted({tuple(law.program_signals.split()) for law in self.laws}, key=len)
        agree = all(longer[: len(one)] == one for one, longer in pairwise(names))
        return names[-1] if names and agree else ()

    def maybe_law_at(self, tick: int) -> LawInForce | None:
        """Law and gains in cycle number `tick`; None when the log does not tell."""
        return next((law for law in reversed(self.laws) if law.tick <= tick), None)


def read_log(path: Path | str) -> Log:
    """Read a log and all parts that follow `path`; of damaged ones what is whole.

    Raises:
        LogError: the file is missing, is no log of this program, or its format or layout is another version's.
    """
    first = Path(path)
    files, parts = _scan_parts(first)
    header = parts[0].header
    if header is None:
        raise LogError(f"{path} is not a log of this program, or was cut off before its header")
    rows = _join([block for part in parts for block in part.rows], header.layout)
    begin = int(rows["tick"][0]) if rows.size else 0
    laws = _laws_since(list(dict.fromkeys(law for part in parts for law in part.laws)), begin)
    return Log(
        path=first,
        header=replace(header, law=laws[0].law) if laws and laws[0].tick <= begin else header,
        rows=rows,
        status=next((part.status for part in reversed(parts) if part.status.rows), LogStatus()),
        attachments=parts[0].attachments,
        torn=not all(part.ended for part in parts),
        parts=tuple(files),
        laws=laws,
        lost=_lost_cycles(parts, rows, header),
    )


def _lost_cycles(parts: Sequence[Contents], rows: Rows, header: LogHeader) -> tuple[LostCycles, ...]:
    """Cycles that each damaged place has cost; a place that cost none is left out."""
    lost, before = [], 0
    for part in parts:
        lost += [_lost_at(place, before + place.rows, rows, header) for place in part.damage]
        before += sum(block.size for block in part.rows)
    return tuple(dict.fromkeys(each for each in lost if each.cycles != 0))


def _lost_at(place: DamagedPlace, at: int, rows: Rows, header: LogHeader) -> LostCycles:
    """Cycles lost at one place, by the numbers of the rows around it, or by what the damaged chunk says of itself."""
    period_ns, offset_ns = header.period_ns, header.wall_offset_ns
    if 0 < at < rows.size:
        gap = rows[at - 1 : at + 1]
        cycles = int(gap["tick"][1] - gap["tick"][0]) - 1
        begin_ns, end_ns = int(gap["t_ns"][0]) + period_ns, int(gap["t_ns"][1]) - period_ns
    elif place.begin_ns is not None and place.end_ns is not None:
        begin_ns, end_ns = place.begin_ns - offset_ns, place.end_ns - offset_ns
        begin_ns = begin_ns if at == 0 else max(begin_ns, int(rows["t_ns"][-1]) + period_ns)
        cycles = max(0, round((end_ns - begin_ns) / period_ns) + 1)
    else:
        return LostCycles(None, None, None)
    origin = int(rows["t_ns"][0]) if rows.size else begin_ns
    return LostCycles(cycles, (begin_ns - origin) * 1e-9, (end_ns - origin) * 1e-9)


def _laws_since(laws: Sequence[LawInForce], tick: int) -> tuple[LawInForce, ...]:
    """Laws, out of `laws`, that were in force in or after cycle number `tick`."""
    return tuple(law for k, law in enumerate(laws) if not any(later.tick <= tick for later in laws[k + 1 :]))


def _scan_parts(first: Path) -> tuple[list[Path], list[Contents]]:
    files, parts = [first], [scan_file(first)]
    own = parts[0].header
    begin = 1 if own is None else own.part
    while (following := part_beside(first, begin, begin + len(parts))).exists():
        part = scan_file(following) if is_begun(following) else Contents()
        if part.header is not None and replace(part.header, part=begin) != own:
            raise LogError(f"{following} does not belong to {first}: move one of them")
        files.append(following)
        parts.append(part)
    return files, parts


def _join(blocks: list[Rows], layout: TelemetryLayout) -> Rows:
    """One array of all rows. NumPy joins words several times faster than records."""
    if not blocks:
        return layout.empty(0)
    return layout.complete(np.concatenate([block.view(np.int64) for block in blocks]).view(blocks[0].dtype))
