"""The corner at the end of a segment, and the way round it into the request that follows."""

from __future__ import annotations

from dataclasses import dataclass

from qrobot.motion.course import Course
from qrobot.motion.errand import Errand
from qrobot.motion.path import Segment
from qrobot.motion.planner import Planner
from qrobot.motion.progress import Progress
from qrobot.motion.schedule import Schedule


@dataclass(frozen=True, eq=False)
class WayRound:
    """How to turn into a request.

    Attributes:
        course: the straight way behind the corner.
        schedule: its times, and that of the transition.
    """

    course: Course
    schedule: Schedule


class Corner:
    """Where the present segment ends. The way round it is planned once for each request that is to follow.

    Args:
        planner: of the arm.
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._errand: Errand | None = None
        self._way: WayRound | None = None

    def forget(self) -> None:
        """Plan anew: the arm turned elsewhere."""
        self._errand = self._way = None

    def way_round(self, segment: Segment, errand: Errand, at: Progress, following: int) -> WayRound | None:
        """How to turn into `errand` at the end of `segment`, the present one; None when it came too late for that.

        `following` is Ta of the request behind it, 0 for none. Raises what `Planner.lay` raises.
        """
        if self._errand is not errand:
            self._way = self._plan(segment, errand, at, following)
            self._errand = errand
        return self._way

    def _plan(self, segment: Segment, errand: Errand, at: Progress, following: int) -> WayRound | None:
        room = segment.end - max(at.clock, at.path.leg.end)
        course = self._planner.lay(errand, at.goal_joints())
        bounds = segment.schedule.braking, int(room), following
        schedule = self._planner.scheduler.plan(errand.request, course, segment.arriving, *bounds)
        return WayRound(course, schedule) if schedule.transition <= room else None
