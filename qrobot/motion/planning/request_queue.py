"""The first-in, first-out queue of motion requests, bounded."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Final

from qrobot.errors import MotionError
from qrobot.motion.planning.queued_motion import QueuedMotion

QUEUE_SIZE: Final = 64


class RequestQueue:
    """Requests that nobody serves yet, oldest first."""

    def __init__(self, size: int = QUEUE_SIZE) -> None:
        self._waiting: deque[QueuedMotion] = deque()
        self._size = size

    def __len__(self) -> int:
        return len(self._waiting)

    def __iter__(self) -> Iterator[QueuedMotion]:
        return iter(self._waiting)

    def push(self, queued: QueuedMotion) -> None:
        """Append. Raises MotionError when the queue is full."""
        if len(self._waiting) >= self._size:
            raise MotionError(
                f"move to {queued.request.name}: {self._size} motions are waiting already, no room for more"
            )
        self._waiting.append(queued)

    def pop(self) -> QueuedMotion:
        """Take the oldest."""
        return self._waiting.popleft()

    def peek(self, index: int = 0) -> QueuedMotion | None:
        """The request that is `index` places from the front, None when there is none."""
        return self._waiting[index] if index < len(self._waiting) else None

    def last(self) -> QueuedMotion | None:
        """The newest, None when empty."""
        return self._waiting[-1] if self._waiting else None

    def clear(self) -> list[QueuedMotion]:
        """Take all, oldest first."""
        taken = list(self._waiting)
        self._waiting.clear()
        return taken
