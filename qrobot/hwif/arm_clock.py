"""The clock of an arm: CLOCK_MONOTONIC, less the time an emulated board was kept from running while nobody wrote to it.

A machine that stops all processes of an emulated arm for a while stops its world as well: nobody could control the arm
meanwhile, and no hardware went on without them. So the board's process lets the arm's time stand still for as long,
and says so in `facts.slipped_ns`, from which servo, guardian and bridge take the same time. A real board goes on
whoever is stopped: on its arm nothing slips, and that field, whatever it holds, is not read.

Who wakes up first after a stall cannot know yet what the board's process will say. `await_board` waits for it;
`may_slip_ns` tells how much it may be.
"""

from __future__ import annotations

from typing import Final

from qrobot.hwif.board_memory import BoardMemory
from qrobot.hwif.lanes import newest_post_ns
from qrobot.realtime.atomics import load_acquire
from qrobot.realtime.clock import monotonic_ns, sleep_until_ns
from qrobot.realtime.jit import lean_kernel

STALL_NS: Final = 3_000_000  # a process that comes later than this was kept from running [A]
POLL_NS: Final = 100_000
PATIENCE_NS: Final = 50_000_000  # with a board that wakes up after its servo did [A]
MAY_SLIP_NS: Final = 1_000_000_000  # a board that sleeps for longer is taken for dead: nothing more will slip [A]


@lean_kernel
def slipped_ns(board: BoardMemory, slips: int) -> int:
    """Nanoseconds by which the arm's time lies behind CLOCK_MONOTONIC; 0 without `slips`, as with every real board."""
    if slips == 0:
        return 0
    return max(0, load_acquire(board.facts, "slipped_ns"))


@lean_kernel
def arm_time_ns(board: BoardMemory, slips: int) -> int:
    """The arm's time now; a process that was stopped between its two readings takes the clock's again."""
    slipped, now_ns = slipped_ns(board, slips), monotonic_ns()
    newest = slipped_ns(board, slips)
    return (now_ns if newest == slipped else monotonic_ns()) - newest


@lean_kernel
def may_slip_ns(board: BoardMemory, slips: int, now_ns: int) -> int:
    """Nanoseconds at the end of the arm's time until `now_ns` that an emulated board may still take back.

    That is since its newest sample, or the newest write, while its process is kept from running; `MAY_SLIP_NS` at most.
    0 without `slips`, and beside a board that runs.
    """
    if slips == 0:
        return 0
    asleep_ns = now_ns - max(load_acquire(board.facts, "now_ns"), newest_post_ns(board))
    return min(asleep_ns, MAY_SLIP_NS) if asleep_ns > STALL_NS else 0


@lean_kernel
def await_board(board: BoardMemory, slips: int, due_ns: int) -> tuple[int, int]:
    """(nanoseconds slipped, the arm's time), once an emulated board's process runs again after a stall.

    Returns at once unless the caller comes more than `STALL_NS` after `due_ns`, the arm's time at which it wanted to
    run, and the board's newest sample is as old; after looks for `PATIENCE_NS` at the latest. Time and slip belong
    together: who read the clock again, and was stopped before that, would be ahead of an arm that has not told of it.
    """
    slipped = slipped_ns(board, slips)
    now_ns = monotonic_ns()
    if slips != 0 and now_ns - slipped - due_ns > STALL_NS:
        looks = PATIENCE_NS // POLL_NS  # not a time: another stall may come meanwhile
        while now_ns - slipped - load_acquire(board.facts, "now_ns") > STALL_NS and looks > 0:
            sleep_until_ns(now_ns + POLL_NS)
            slipped = slipped_ns(board, slips)
            now_ns = monotonic_ns()
            looks -= 1
    return slipped, now_ns - slipped
