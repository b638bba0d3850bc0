"""Answers that a cycle waits for, and the image that can hold them; see `servo.kernels.converter`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

NOT_NOTED: Final = -1  # the number of the newest image is known only once the cycle has posted


@dataclass(eq=False)
class Awaited:
    """Answer to something that a cycle has posted."""

    answer_at: int = 0  # count of the first image that can show it; NOT_NOTED until the cycle after
    posted_ns: int = 0  # when it was posted: an image taken before cannot show it
