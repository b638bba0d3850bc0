"""The board's clock beside ours: speeds, and every limit of speed, are counts by the time stamps of its images.

A clock that goes k times as fast shows a k-th of the speed, and a k-th of the damping. A board behind a gateway stamps
its images itself, and may stamp them in another unit; what a card or an emulated board here shows has our own clock.
One that goes too slowly shows too much speed, and is stopped by that.
"""

from __future__ import annotations

from typing import Final

from qrobot.realtime.jit import lean_kernel
from qrobot.servo.state import ServoState

WINDOW_NS: Final = 1_000_000_000  # [A]
FAST: Final = 1.25  # [A] times ours; counts and limits are good to some per cent
WINDOWS: Final = 2  # in a row: what an emulated board was kept from doing, it may do within one


@lean_kernel
def follow_clock(state: ServoState, since_ns: int) -> None:
    """Add what has passed since the image before, `since_ns` by the board's clock."""
    state.clock_board_ns += since_ns
    state.clock_own_ns += state.image_taken_ns - state.clock_taken_ns
    state.clock_taken_ns = state.image_taken_ns
    if state.clock_own_ns < WINDOW_NS:
        return
    state.clock_fast = state.clock_fast + 1 if state.clock_board_ns > FAST * state.clock_own_ns else 0
    state.clock_board_ns, state.clock_own_ns = 0, 0


@lean_kernel
def forget_clock(state: ServoState) -> None:
    """Begin anew, with the first image of a board."""
    state.clock_board_ns, state.clock_own_ns, state.clock_fast = 0, 0, 0
    state.clock_taken_ns = state.image_taken_ns


@lean_kernel
def clock_is_fast(state: ServoState) -> bool:
    """Whether the board's clock goes too fast for its speeds to be believed."""
    return bool(state.clock_fast >= WINDOWS)
