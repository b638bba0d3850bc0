"""What the generator tells: which request began or ended, and how."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from qrobot.motion.request import MoveRequest


class Termination(IntEnum):
    """Why a request ended. Positive numbers are the program's own (`Generator.interrupt`)."""

    NONE = 0
    COMPLETED = -1
    STOPPED = -2


class EventKind(Enum):
    """What happened."""

    BEGUN = "begun"  # the transition into the request's segment begins
    ENDED = "ended"  # the next one's begins, or the arm came to rest
    IDLE = "idle"  # the arm is at rest and nothing waits


@dataclass(frozen=True)
class MotionEvent:
    """Something happened to `request`, or to none in particular; `code` is a `Termination` or the program's own."""

    kind: EventKind
    request: MoveRequest | None = None
    code: int = Termination.NONE
