"""Lanes: how operations get from a controller to its board, and nowhere else, in order.

A lane is a ring with one producer, a controller, and one consumer, the board; neither waits for the other. The producer
has its words on one cache line, the consumer on another.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.arrays import Words
from qrobot.hwif.board_memory import LANE_CAPACITY, N_LANES, BoardMemory, LaneBlock
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import lean_kernel

LONGEST_WAIT_NS: Final = 200_000_000  # an operation further ahead than this has a damaged time: it counts at once [A]


@lean_kernel
def post_operations(memory: BoardMemory, lane: int, operations: Any, n: int, t_ns: int = 0) -> bool:
    """Controller side: append `operations[:n]` (int64[:, OP_FIELDS]) to a lane, all or none; False when it is full.

    `t_ns` is the time from which they count for a board that catches up, on the arm's clock; 0 is at once.

    A head that somebody has damaged to a negative number begins again where the board is.
    """
    block = memory.lanes[lane]
    head, tail = block.head, load_acquire(block, "tail")
    if head < 0:
        head = max(0, tail)
        memory.facts.dropped += 1
    if head + n - tail > LANE_CAPACITY:
        return False
    for i in range(n):
        slot = block.ring[(head + i) % LANE_CAPACITY]
        slot.kind, slot.offset, slot.value = operations[i, 0], operations[i, 1], operations[i, 2]
        slot.counts_ns = t_ns
    store_release(block, "head", head + n)
    return True


@lean_kernel
def _done_with(lane: LaneBlock, head: Any) -> Any:
    """Position up to which a lane whose head is at `head` is done with: taken by the board, or forgotten by the
    sender."""
    tail, forget = lane.tail, load_acquire(lane, "forget")
    return forget if tail < forget <= head else tail


@lean_kernel
def _next_operation(memory: BoardMemory, lane: LaneBlock) -> Any:
    """Position of the oldest operation the board may take, or -1.

    A lane that is out of step is taken up again where its head is: somebody damaged it, or a new board owner zeroed the
    memory under a producer that was just posting. What lay in it counts as one operation that was dropped.
    """
    head = load_acquire(lane, "head")
    if head < 0:
        return -1  # whoever posts next puts it right
    tail = _done_with(lane, head)
    if 0 < head - tail <= LANE_CAPACITY:
        return tail
    if head != tail:
        memory.facts.dropped += 1
    store_release(lane, "tail", head)
    return -1


@lean_kernel
def take_operation(memory: BoardMemory, lane: int, operation: Any) -> bool:
    """Board side: move the oldest operation of a lane into `operation` (int64[OP_FIELDS]); False when there is none."""
    block = memory.lanes[lane]
    position = _next_operation(memory, block)
    if position < 0:
        return False
    slot = block.ring[position % LANE_CAPACITY]
    operation[0], operation[1], operation[2] = slot.kind, slot.offset, slot.value
    store_release(block, "tail", position + 1)
    return True


@lean_kernel
def operation_is_early(memory: BoardMemory, lane: int, t_ns: int) -> bool:
    """True when the oldest operation of a lane counts from a time after `t_ns` on."""
    block = memory.lanes[lane]
    position = _next_operation(memory, block)
    if position < 0:
        return False
    counts_ns = block.ring[position % LANE_CAPACITY].counts_ns
    return bool(t_ns < counts_ns <= t_ns + LONGEST_WAIT_NS)


@lean_kernel
def newest_post_ns(memory: BoardMemory) -> int:
    """Time of the newest operation in any lane, taken or not; 0 where there is none, or none with a time."""
    newest = 0
    for lane in range(N_LANES):
        block = memory.lanes[lane]
        head = load_acquire(block, "head")
        newest = max(newest, block.ring[(head - 1) % LANE_CAPACITY].counts_ns)
    return newest


def take_all_operations(memory: BoardMemory, operations: Words, lanes: Words) -> int:
    """Board side: move what every lane holds into `operations` (int64[k, OP_FIELDS]), lane by lane, as much as fits.

    Returns:
        How many were taken; `lanes` (int64[k]) tells where from.
    """
    return int(_take_lanes(memory, operations, lanes))


@lean_kernel
def _take_lanes(memory: BoardMemory, operations: Any, lanes: Any) -> int:
    n = 0
    for lane in range(N_LANES):
        while n < operations.shape[0] and take_operation(memory, lane, operations[n]):
            lanes[n] = lane
            n += 1
    return n


@lean_kernel
def pending_operations(memory: BoardMemory, lane: int) -> int:
    """Operations posted to a lane that the board has not applied yet."""
    block = memory.lanes[lane]
    head = load_acquire(block, "head")
    return int(max(0, head - _done_with(block, head)))


@lean_kernel
def posted_so_far(memory: BoardMemory, lane: int) -> int:
    """Position in a lane behind the newest operation posted; a memory that is made anew begins at 0 again."""
    return int(memory.lanes[lane].head)


@lean_kernel
def taken_so_far(memory: BoardMemory, lane: int) -> int:
    """Position in a lane behind the newest operation that the board has taken, or that was forgotten."""
    block = memory.lanes[lane]
    return int(_done_with(block, load_acquire(block, "head")))


@lean_kernel
def discard_operations(memory: BoardMemory, lane: int) -> None:
    """Controller side after a restart: forget what a dead predecessor posted and the board has not applied.

    Safe beside a running board: at worst it is just applying one of the old operations. What is posted from now on is
    never lost, so the caller posts safe outputs right after.
    """
    block = memory.lanes[lane]
    store_release(block, "forget", block.head)
