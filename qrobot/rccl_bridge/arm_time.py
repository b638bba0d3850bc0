"""The arm's time as another process of this machine reads it, from what the servo tells of its slip.

Kernels read it from the board (`hwif.arm_clock.arm_time_ns`), in the same steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable


def read_arm_time_ns(slipped_ns: Callable[[], int]) -> int:
    """CLOCK_MONOTONIC less what `slipped_ns` tells; the clock is read again where that has grown meanwhile.

    After a stall of which the arm has not told yet this lies in the future, by as much as the stall was long; it never
    lies in the past by a stall that the arm shared.
    """
    slipped, now_ns = slipped_ns(), time.monotonic_ns()
    newest = slipped_ns()
    return (now_ns if newest == slipped else time.monotonic_ns()) - newest
