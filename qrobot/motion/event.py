"""Events of the generator: which request began or ended, and how."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from qrobot.motion.request import MoveRequest


class Termination(IntEnum):
    """Reasons for which a request ended. Positive numbers are the program's own (`Generator.skip`)."""

    NONE = 0
    COMPLETED = -1
    STOPPED = -2  # by `stop`, or because a motion before it failed
    JOINT_LIMIT = -3  # a joint would have left its range
    UNREACHABLE = -4  # the goal, or a place on the way to it, is out of the arm's reach
    SINGULAR = -5  # the way led too close to a singularity
    TOO_FAST = -6  # a joint would have passed its speed or acceleration, as when a frame jumps
    FORCE_LIMIT = -7  # the arm exerted more than its motion allows
    MOTION_LIMIT = -8  # the controlled frame was pushed farther off than its motion allows
    FENCE = -9  # the arm would have come too near a fence


class EventKind(Enum):
    """Kinds of events."""

    BEGUN = "begun"  # the transition into the request's segment begins
    INTERRUPTED = "interrupted"  # it is cut short, and the arm is brought to rest; ENDED follows when it stands
    ENDED = "ended"  # its via point is passed, in the middle of the transition; or the next one cuts it short; or rest
    LOST = "lost"  # the arm had arrived, but could not follow the goal any further
    IDLE = "idle"  # the arm is at rest and nothing waits


@dataclass(frozen=True)
class MotionEvent:
    """Something happened to `request`, or to none in particular; `code` is a `Termination` or the program's own.

    `why` tells more of it in words, as which joint met which limit; empty where the code says it all.
    """

    kind: EventKind
    request: MoveRequest | None = None
    code: int = Termination.NONE
    why: str = ""
