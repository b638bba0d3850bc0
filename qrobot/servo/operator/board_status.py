"""Status of the board for the control interface: how old its image is, and what went wrong on the way to it."""

from __future__ import annotations

from collections.abc import Callable

from qrobot.errors import LinkError
from qrobot.hwif.board_memory import BoardMemory
from qrobot.hwif.bus import MemoryEndpoint
from qrobot.hwif.image import IMAGE_T_NS, make_image
from qrobot.servo.operator.messages import BoardStatus
from qrobot.units import NS_PER_MS


def board_status(memory: BoardMemory, clock: Callable[[], int]) -> BoardStatus:
    """Read a board memory whose time is that of `clock`, ns."""
    return BoardStatus(
        age_ms=_maybe_age_ms(memory, clock),
        losses=int(memory.facts.losses),
        dropped=int(memory.facts.dropped),
        illegal=int(memory.facts.illegal_ops),
        module_losses=int(memory.facts.module_losses),
        slipped_ms=int(memory.facts.slipped_ns) / NS_PER_MS,
    )


def _maybe_age_ms(memory: BoardMemory, clock: Callable[[], int]) -> float | None:
    image = make_image()
    try:
        MemoryEndpoint(memory).read_image(image)
    except LinkError:
        return None
    now_ns = clock()  # after the image: a machine that stalls in between makes it older, not younger than nothing
    return (now_ns - int(image[IMAGE_T_NS])) / NS_PER_MS if image[IMAGE_T_NS] else None
