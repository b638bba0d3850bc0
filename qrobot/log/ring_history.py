"""The newest cycles of a servo, read from its telemetry ring: windows of them, and the first one that meets a trigger.

The ring is only read: the servo notices no reader.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.errors import LogError
from qrobot.log.windows import QUANTITIES, Curves, quantities_of, thinned
from qrobot.servo.memory.telemetry import Rows, TelemetryReader
from qrobot.units import NS_PER_S

KEEP_CYCLES: Final = 120_000  # of a servo, half a minute at 4 kHz
EVENT: Final = "event"  # a trigger beside QUANTITIES: another mode, or a fault or warning
_MARKS: Final = ("tick", "t_ns", "mode", "fault", "event_joint")

Cycles = NDArray[Any]  # structured, one record per cycle: _MARKS, and `values` in the order of QUANTITIES


@dataclass(frozen=True)
class CycleTrigger:
    """A condition of one cycle, that a picture waits for.

    Attributes:
        quantity: one of QUANTITIES, or EVENT.
        joint: from 0; of no meaning for EVENT.
        rising: the quantity comes from below the level to it or beyond, else from above.
        level: SI units.
    """

    quantity: str
    joint: int = 0
    rising: bool = True
    level: float = 0.0

    def first_in(self, cycles: Cycles) -> int | None:
        """Place of the first cycle that meets it, from 1 on: the one before it counts; None when there is none."""
        found = np.flatnonzero(self._met(cycles))
        return int(found[0]) + 1 if found.size else None

    def _met(self, cycles: Cycles) -> NDArray[np.bool_]:
        if self.quantity == EVENT:
            faults = cycles["fault"]
            begun = (np.diff(faults) != 0) & (faults[1:] != 0)
            return np.asarray(begun | (np.diff(cycles["mode"]) != 0))
        values = cycles["values"]
        n = values.shape[1] // len(QUANTITIES)
        if self.quantity not in QUANTITIES or not 0 <= self.joint < n:
            raise LogError(f"no trigger by {self.quantity!r} of joint {self.joint + 1}: the arm has {n} joints")
        column = values[:, QUANTITIES.index(self.quantity) * n + self.joint]
        beyond = column >= self.level if self.rising else column <= self.level
        return np.asarray(beyond[1:] & ~beyond[:-1])


class RingHistory:
    """Cycles read from one ring, the newest `keep` of them without a gap.

    Args:
        reader: of the ring.
        keep: cycles.
    """

    def __init__(self, reader: TelemetryReader, keep: int = KEEP_CYCLES) -> None:
        self._reader, self._keep = reader, keep
        self._blocks: deque[Cycles] = deque()

    def take(self) -> None:
        """Read what has been written since the last time, as far as it is kept."""
        behind = self._reader.waiting - self._keep
        if behind > 0:
            self._reader.next_row += behind
            self._blocks.clear()
        while (rows := self._reader.read()).size:
            self._append(_cycles_of(rows))

    @property
    def newest_s(self) -> float:
        """Time of the newest cycle, s on the servo's clock; 0 when there is none."""
        return float(self._blocks[-1]["t_ns"][-1]) / NS_PER_S if self._blocks else 0.0

    @property
    def newest_tick(self) -> int:
        """Number of the newest cycle, -1 when there is none."""
        return int(self._blocks[-1]["tick"][-1]) if self._blocks else -1

    def cycles(self, begin_s: float, end_s: float) -> Cycles:
        """Cycles from `begin_s` to `end_s`, s on the servo's clock; a copy, shape (m,)."""
        begin_ns, end_ns = round(begin_s * NS_PER_S), round(end_s * NS_PER_S)
        blocks = [block for block in self._blocks if block["t_ns"][-1] >= begin_ns and block["t_ns"][0] <= end_ns]
        whole = self._joined(blocks)
        return np.asarray(whole[(whole["t_ns"] >= begin_ns) & (whole["t_ns"] <= end_ns)])

    def since(self, tick: int) -> Cycles:
        """Cycles from number `tick` on, shape (m,)."""
        whole = self._joined([block for block in self._blocks if block["tick"][-1] >= tick])
        return np.asarray(whole[whole["tick"] >= tick])

    def _append(self, cycles: Cycles) -> None:
        if self._blocks and cycles["tick"][0] != self.newest_tick + 1:
            self._blocks.clear()
        self._blocks.append(cycles)
        while sum(block.size for block in self._blocks) - self._blocks[0].size >= self._keep:
            self._blocks.popleft()

    def _joined(self, blocks: list[Cycles]) -> Cycles:
        return np.concatenate(blocks) if blocks else _cycles_of(self._reader.layout.empty(0))


def curves_of(cycles: Cycles, points: int) -> Curves:
    """Quantities of cycles at `points` instants at most, s on the servo's clock; no peak is lost."""
    t_s, values = cycles["t_ns"] / NS_PER_S, cycles["values"]
    whole = Curves(t_s, values, values, values)
    return thinned(whole, t_s[0], t_s[-1], points) if t_s.size > points else whole


def _cycles_of(rows: Rows) -> Cycles:
    values = quantities_of(rows)
    fields: list[Any] = [(name, "<i8") for name in _MARKS] + [("values", "<f8", (values.shape[1],))]
    cycles = np.zeros(rows.size, dtype=np.dtype(fields))
    for name in _MARKS:
        cycles[name] = rows[name]
    cycles["values"] = values
    return cycles
