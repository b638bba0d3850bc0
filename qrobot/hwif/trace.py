"""The trace: every DAC and DISCRETE write that a board has applied, with the board's own time stamp.

Of a board behind a gateway, every one that it has answered, with the time at which the gateway asked.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from qrobot.hwif.board_memory import N_LANES, TRACE_CAPACITY, BoardMemory, TraceRow
from qrobot.hwif.bus import REGISTER_MASK
from qrobot.hwif.operations import OP_WRITE
from qrobot.hwif.registers import DAC, DISCRETE, N_DACS
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.structure import columns_of

OWN_LANE: Final = N_LANES  # in the place of a lane: what a gateway writes by itself
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


@lean_kernel
def trace_operations(memory: BoardMemory, t_ns: int, lanes: Any, operations: Any) -> None:
    """Board side: record the DAC and DISCRETE writes among applied operations, int64[k, OP_FIELDS] from int64[k]."""
    for i in range(operations.shape[0]):
        if operations[i, 0] == OP_WRITE and operations[i, 1] % 2 == 0:
            trace_write(memory, t_ns, lanes[i], operations[i, 1], operations[i, 2] & REGISTER_MASK)


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
