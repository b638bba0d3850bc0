"""The transport to a board that is met through its memory: the emulated one, or whatever a gateway has found.

A controller that lives in the cycle uses the board memory itself (board_memory.py). This is for those who want to wait
for an answer: the walk through a new board, programs of other languages, a recorder.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from qrobot.arrays import Words
from qrobot.errors import LinkBusy, LinkLost, LinkTimeout
from qrobot.hwif.board_memory import IMAGES_TO_SHOW, BoardMemory, BoardSegment, Lane, command_board_memory
from qrobot.hwif.bus import BoardFacts, MemoryEndpoint, Operations, check_image
from qrobot.hwif.image import IMAGE_COUNT, make_image
from qrobot.hwif.lanes import discard_operations, pending_operations
from qrobot.realtime.deadline import Deadline, comes_true

TIMEOUT_S: Final = 0.1
POLL_S: Final = 100e-6


class MemoryBus:
    """Near end of a transport that is shared memory.

    Args:
        attach: maps the memory; raises LinkError when nobody serves it.
        name: for messages.
        lane: of the board; nobody else may post to it.
        timeout_s: patience with a board that takes nothing or shows nothing new; may be changed.
    """

    def __init__(
        self, attach: Callable[[], BoardSegment], name: str, lane: Lane = Lane.TOOL, timeout_s: float = TIMEOUT_S
    ) -> None:
        self.name = name
        self._attach, self._lane, self.timeout_s = attach, lane, timeout_s
        self._segment: BoardSegment | None = None
        self._newest = make_image()

    def connect(self) -> BoardFacts:
        """Map the memory and forget what a predecessor had posted.

        Raises:
            LinkBusy: the board has another controller.
            LinkError: no board serves it.
        """
        self.close()
        segment = self._segment = self._attach()
        if not segment.owner_alive:
            self.close()
            raise LinkLost(f"the board at {self.name} has ended")
        discard_operations(segment.memory, int(self._lane))
        return MemoryEndpoint(segment.memory, self._lane).facts()

    def exchange(self, operations: Operations, image: Words) -> None:
        """Exchange as `Bus.exchange` does, until the board has shown two images since it took the operations.

        Raises:
            LinkLost: also when a gateway has lost its board meanwhile, or dropped what was posted, and found it again.
        """
        memory = self._memory()
        before = _gone_astray(memory)
        end = MemoryEndpoint(memory, self._lane)
        deadline = Deadline(self.timeout_s)
        try:
            end.apply(operations)
            self._wait(lambda: pending_operations(memory, int(self._lane)) == 0, deadline, "takes no operations")
            end.read_image(self._newest)
            seen, fresh = int(self._newest[IMAGE_COUNT]), IMAGES_TO_SHOW if len(operations) else 1
            # a count that falls is that of a board started anew
            self._wait(lambda: not 0 <= self._count(end) - seen < fresh, deadline, "shows nothing new")
        except (LinkTimeout, LinkBusy):
            discard_operations(memory, int(self._lane))  # nobody may act on them later
            raise
        if _gone_astray(memory) != before:
            raise LinkLost(f"the board at {self.name} was lost for a moment, and is safe since: ask again")
        check_image(self._newest)
        image[:] = self._newest

    def close(self) -> None:
        """Unmap the memory."""
        if self._segment is not None:
            self._segment.close()
            self._segment = None

    def _memory(self) -> BoardMemory:
        if self._segment is None:
            raise LinkLost(f"not connected to {self.name}")
        return self._segment.memory

    def _count(self, end: MemoryEndpoint) -> int:
        end.read_image(self._newest)
        return int(self._newest[IMAGE_COUNT])

    def _wait(self, done: Callable[[], bool], deadline: Deadline, complaint: str) -> None:
        if not comes_true(done, deadline, POLL_S):
            raise LinkTimeout(f"the board at {self.name} {complaint}: does it still run?")


def _gone_astray(memory: BoardMemory) -> tuple[int, int]:
    """Count of losses of the board, and of operations that may never have acted."""
    return int(memory.facts.losses), int(memory.facts.dropped)


def board_memory_bus(arm: str, lane: Lane = Lane.TOOL, timeout_s: float = TIMEOUT_S) -> MemoryBus:
    """The transport to the board that runs as a process for `arm`, and the board's one controller while connected."""
    return MemoryBus(lambda: command_board_memory(arm), f"the board memory of {arm}", lane, timeout_s)
