"""The via point at the end of a segment, and the transition round it into the request that follows."""

from __future__ import annotations

from dataclasses import dataclass

from qrobot.motion.path.segment import Schedule, Segment
from qrobot.motion.planning.geometric_path import GeometricPath
from qrobot.motion.planning.planner import Planner
from qrobot.motion.planning.queued_motion import NO_FOLLOWER, QueuedMotion
from qrobot.motion.trajectory.trajectory_state import TrajectoryState


@dataclass(frozen=True, eq=False)
class ViaTransition:
    """Transition into a request.

    Attributes:
        geometry: the straight path behind the via point.
        schedule: its times, and that of the transition.
    """

    geometry: GeometricPath
    schedule: Schedule


class ViaPlanner:
    """End of the present segment. The way round it is planned when a request comes that is to follow, and again when
    another one comes behind that.

    Args:
        planner: of the arm.
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._planned: tuple[QueuedMotion, QueuedMotion | None] | None = None
        self._transition: ViaTransition | None = None

    def forget(self) -> None:
        """Plan anew: the arm turned elsewhere."""
        self._planned = self._transition = None

    def transition_to(
        self, segment: Segment, queued: QueuedMotion, at: TrajectoryState, behind: QueuedMotion | None
    ) -> ViaTransition | None:
        """Transition into `queued` at the end of `segment`, the present one; None when it came too late for that.

        `behind` is the request behind it: when that comes too late, the way that was planned without it stays.
        Raises what `Planner.plan_geometry` raises.
        """
        if self._planned != (queued, behind):
            known = self._transition if self._planned is not None and self._planned[0] is queued else None
            self._transition = self._plan(segment, queued, at, behind) or known
            self._planned = queued, behind
        return self._transition

    def _plan(
        self, segment: Segment, queued: QueuedMotion, at: TrajectoryState, behind: QueuedMotion | None
    ) -> ViaTransition | None:
        available = segment.end - max(at.clock, at.path.piece.end)
        geometry = self._planner.plan_geometry(queued, at.goal_joints())
        bounds = segment.schedule.least_resting, int(available), NO_FOLLOWER if behind is None else behind.asks
        schedule = self._planner.scheduler.plan(queued.request, geometry, segment.arriving, *bounds)
        return ViaTransition(geometry, schedule) if schedule.transition <= available else None
