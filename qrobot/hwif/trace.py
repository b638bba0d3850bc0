"""The trace: every DAC and DISCRETE write that a board has applied, with the board's own time stamp."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.hwif.board_memory import TRACE_CAPACITY, BoardMemory, TraceRow
from qrobot.hwif.registers import DAC, DISCRETE, N_DACS
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.structure import columns_of

_FIELDS: Final = len(columns_of(TraceRow))


@lean_kernel
def trace_write(memory: BoardMemory, t_ns: int, lane: int, offset: int, value: int) -> None:
    """Board side: record an applied DAC or DISCRETE write."""
    if offset != DISCRETE and not DAC <= offset < DAC + 2 * N_DACS:
        return
    trace = memory.traced
    head = trace.head
    row = trace.rows[head % TRACE_CAPACITY]
    row.t_ns, row.lane, row.offset, row.value = t_ns, lane, offset, value
    store_release(trace, "head", head + 1)


def read_trace(memory: BoardMemory, first: int = 0) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """The recorded DAC and DISCRETE writes from number `first` on, oldest first.

    Shape (k, 4): t_ns, lane, offset, value.

    Takes a copy; a board that runs meanwhile may overwrite the oldest rows while they are copied, so rows that the
    writer reached during the copy are dropped.
    """
    head = int(load_head(memory))
    first = max(first, head - TRACE_CAPACITY)
    rows: np.ndarray[tuple[int, int], np.dtype[np.int64]] = (
        memory.traced.rows[np.arange(first, head) % TRACE_CAPACITY].view(np.int64).reshape(-1, _FIELDS)
    )
    overwritten = max(0, int(load_head(memory)) + 1 - TRACE_CAPACITY - first)  # + 1: the row just being written
    return rows[overwritten:]


@lean_kernel
def load_head(memory: BoardMemory) -> int:
    """Number of writes traced since the board started."""
    return load_acquire(memory.traced, "head")
