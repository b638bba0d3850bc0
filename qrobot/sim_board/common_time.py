"""One time of the emulated arms of a deployment file: their boards let the same time pass unlived, and stay in step.

Each board's process takes for itself what it was kept from running for (`hwif.arm_clock`). Two arms would so be apart,
by seconds when a busy machine starts them, and tear what they hold. So the board that has let pass less stands still
for most of the time, until it has let pass as much.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Final

from qrobot.errors import ConfigError, LinkError
from qrobot.hwif.board_memory import attach_board_memory
from qrobot.realtime.jit import lean_kernel

HELD_PERCENT: Final = 75  # [A] of each period: the arm goes on slowly, and who waits for it is not left without word


@lean_kernel
def held_ns(slipped_ns: int, beside_ns: int, period_ns: int) -> int:
    """Time to let pass unlived in this period of a board that has let pass `slipped_ns`, and another `beside_ns`."""
    return max(0, min(beside_ns - slipped_ns, period_ns * HELD_PERCENT // 100))


def slipped_beside_ns(arms: Sequence[str], now_ns: int) -> int:
    """The most that the living boards of these arms have let pass; 0 where there is none.

    What is more than all the time until `now_ns` is damaged, and passed over.
    """
    return max((ns for ns in map(_slipped_ns, arms) if ns < now_ns), default=0)


def _slipped_ns(arm: str) -> int:
    """Time that a living board has let pass; 0 for what is gone, of another version or no board."""
    with contextlib.suppress(ConfigError, LinkError, OSError), attach_board_memory(arm) as board:
        return max(0, int(board.memory.facts.slipped_ns)) if board.owner_alive else 0
    return 0
