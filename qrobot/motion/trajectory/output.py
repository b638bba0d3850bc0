"""Output of the generator, and its reasons for a stop."""

from __future__ import annotations

from dataclasses import dataclass

from qrobot.arrays import Floats
from qrobot.motion.event import MotionEvent, Termination
from qrobot.motion.path.segment import Segment
from qrobot.motion.request import MoveRequest


@dataclass(frozen=True)
class StopState:
    """An absolute stop under way.

    Attributes:
        request: being ended, None when none was served.
        code: it ends with.
        scal: how much of it was done.
        why: more of the reason in words, empty for none.
    """

    request: MoveRequest | None
    code: int
    scal: float
    why: str = ""

    @property
    def stays(self) -> bool:
        """True for one that was asked for, and to stand for a time where the arm comes to rest."""
        return self.request is not None and self.request.stay_s > 0.0 and self.code == Termination.COMPLETED


@dataclass(frozen=True, eq=False)
class Passing:
    """A via point on the way to which the transition into the next segment has begun.

    Attributes:
        segment: that ends there.
        middle: path time at the middle of the transition, where the path is nearest to the via point.
    """

    segment: Segment
    middle: float


@dataclass(frozen=True, eq=False)
class Output:
    """One sample.

    Attributes:
        q: joint setpoints, rad or m. Shape (n,).
        request: being served, None at rest.
        scal: how much of its segment is done, 0 to 1; 1 at rest.
        events: what happened since the sample before, oldest first.
        moving: a request is being served, or waits.
        passing: in the first half of a transition the request whose via point is passed in its middle, else None.
        passing_scal: how much of its segment is done, 1 at the via point.
    """

    q: Floats
    request: MoveRequest | None
    scal: float
    events: tuple[MotionEvent, ...]
    moving: bool
    passing: MoveRequest | None = None
    passing_scal: float = 1.0
