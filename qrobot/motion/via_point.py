"""The corner at the end of a segment, and the way round it into the request that follows."""

from __future__ import annotations

from dataclasses import dataclass

from qrobot.motion.geometric_path import GeometricPath
from qrobot.motion.path import Segment
from qrobot.motion.planner import Planner
from qrobot.motion.queued_motion import NOTHING, QueuedMotion
from qrobot.motion.timing import Schedule
from qrobot.motion.trajectory_state import TrajectoryState


@dataclass(frozen=True, eq=False)
class ViaTransition:
    """How to turn into a request.

    Attributes:
        course: the straight way behind the corner.
        schedule: its times, and that of the transition.
    """

    course: GeometricPath
    schedule: Schedule


class ViaPlanner:
    """Where the present segment ends. The way round it is planned when a request comes that is to follow, and again
    when another one comes behind that.

    Args:
        planner: of the arm.
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._planned: tuple[QueuedMotion, QueuedMotion | None] | None = None
        self._way: ViaTransition | None = None

    def forget(self) -> None:
        """Plan anew: the arm turned elsewhere."""
        self._planned = self._way = None

    def way_round(
        self, segment: Segment, errand: QueuedMotion, at: TrajectoryState, behind: QueuedMotion | None
    ) -> ViaTransition | None:
        """How to turn into `errand` at the end of `segment`, the present one; None when it came too late for that.

        `behind` is the request behind it: when that comes too late, the way that was planned without it stays.
        Raises what `Planner.lay` raises.
        """
        if self._planned != (errand, behind):
            known = self._way if self._planned is not None and self._planned[0] is errand else None
            self._way = self._plan(segment, errand, at, behind) or known
            self._planned = errand, behind
        return self._way

    def _plan(
        self, segment: Segment, errand: QueuedMotion, at: TrajectoryState, behind: QueuedMotion | None
    ) -> ViaTransition | None:
        room = segment.end - max(at.clock, at.path.leg.end)
        course = self._planner.lay(errand, at.goal_joints())
        bounds = segment.schedule.braking, int(room), NOTHING if behind is None else behind.asks
        schedule = self._planner.scheduler.plan(errand.request, course, segment.arriving, *bounds)
        return ViaTransition(course, schedule) if schedule.transition <= room else None
