"""The safety gate, timing: cycles that come too late too often, and cycles that take too long.

As in `servo.checks.limit_checks`: every check answers with a fault code, 0 for all well, and allocates nothing.
"""

from __future__ import annotations

from typing import Final

from qrobot.faultcodes import FaultCode
from qrobot.realtime.jit import lean_kernel

NONE: Final = int(FaultCode.NONE)
OVERRUN: Final = int(FaultCode.OVERRUN)
LAW_SLOW: Final = int(FaultCode.LAW_SLOW)

# One slow cycle is an interrupt or the scheduler; several in a row are the cycle itself.
SLOW_CYCLES: Final = 3


@lean_kernel
def skipped_points(dt_ns: int, period_ns: int) -> int:
    """Points of the time grid passed over between two cycles `dt_ns` apart."""
    if 2 * dt_ns < 3 * period_ns:  # a division costs as much as the rest of the watch
        return 0
    return (2 * dt_ns + period_ns) // (2 * period_ns) - 1


@lean_kernel
def check_overrun(in_a_row: int, most_in_a_row: int, missed: int, most_missed: int) -> int:
    """Cycles may be late, but fewer than `most_in_a_row` one after the other (0: any number), and few in a window."""
    if most_in_a_row != 0 and not in_a_row < most_in_a_row:
        return OVERRUN
    if not missed <= most_missed:
        return OVERRUN
    return NONE


@lean_kernel
def own_ns(took_ns: int, before: tuple[int, int], after: tuple[int, int]) -> int:
    """Time by which a cycle that took `took_ns` is to be judged, with its thread's `thread_time` before and after.

    That is the processor time used, whatever the kernel or the host of a virtual machine has taken away meanwhile; a
    law that waits, for a lock or a disk, gives the processor away itself and has taken all the time.
    """
    used_ns, given = after[0] - before[0], after[1] - before[1]
    return took_ns if given > 0 else min(took_ns, used_ns)


@lean_kernel
def grown_row(row: int, busy_ns: int, allowed_ns: int) -> int:
    """Number of cycles in a row that have taken longer than `allowed_ns`, with one more of `busy_ns`."""
    return 0 if busy_ns <= allowed_ns else row + 1


@lean_kernel
def check_slowness(row: int) -> int:
    """A cycle may take too long now and then, but not `SLOW_CYCLES` times in a row."""
    return NONE if row < SLOW_CYCLES else LAW_SLOW
