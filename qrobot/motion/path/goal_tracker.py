"""Goal of a queued motion, followed from sample to sample so that its velocity is known when its turn comes."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from qrobot.arrays import Floats
from qrobot.model.transform import inverse
from qrobot.motion.path.setpoint_history import DEPTH
from qrobot.motion.world.equation import Goal


@dataclass(frozen=True, eq=False)
class GoalSample:
    """A goal at one sample: T6 = left DRIVE right. Shapes (4, 4)."""

    left: Floats
    right: Floats

    @property
    def pose(self) -> Floats:
        """T6 at the goal."""
        return self.left @ self.right

    def drive_to(self, t6: Floats) -> Floats:
        """The DRIVE that stands at `t6`."""
        return inverse(self.left) @ t6 @ inverse(self.right)


class GoalTracker:
    """Follows a goal.

    Args:
        goal: of a motion.
    """

    def __init__(self, goal: Goal) -> None:
        self.goal = goal
        self._samples: deque[tuple[int, GoalSample]] = deque(maxlen=DEPTH)

    @property
    def settled(self) -> bool:
        """Its velocity is known: it stands still, or was seen often enough."""
        return self.goal.fixed or len(self._samples) == DEPTH

    @property
    def newest(self) -> GoalSample:
        """The newest sample of the goal."""
        return self._samples[-1][1]

    def sample(self, tick: int) -> None:
        """Evaluate the goal for sample `tick`; a second call for the same sample does nothing."""
        if self._samples and (self.goal.fixed or self._samples[-1][0] >= tick):
            return
        self._samples.append((tick, GoalSample(self.goal.left.at(tick), self.goal.carried(tick))))

    def sample_at(self, tick: float) -> GoalSample | None:
        """The goal at sample `tick`; None when nobody looked."""
        if self.goal.fixed:
            return self.newest
        return next((goal for sample, goal in self._samples if sample == tick), None)
