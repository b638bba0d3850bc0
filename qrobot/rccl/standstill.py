"""A wait on virtual time for arms whose motions stand still until somebody lets them go on, and nobody is there."""

from __future__ import annotations

from collections.abc import Sequence

from qrobot.rccl.task import TrajectoryTask
from qrobot.rci.standstill import PAUSED, Standstill, nobody_resumes
from qrobot.units import NS_PER_S


class RcclStandstill:
    """Watches one wait of a program.

    Args:
        task: of the arm that it waits for.
    """

    def __init__(self, task: TrajectoryTask) -> None:
        self._task, self._stands = task, Standstill()

    def check(self, arms: Sequence[tuple[str, TrajectoryTask]]) -> None:
        """Look once more at all arms, with their names. Raises MotionError: nobody will let them go on."""
        if (how := self._task.how) is None:
            return
        if not self._stands.lasts(how.t_ns / NS_PER_S, any(_moves(task) for _, task in arms)):
            return
        for name, task in arms:
            if reason := _halted(task):
                raise nobody_resumes(name, reason)


def _halted(task: TrajectoryTask) -> str:
    """Reason for which motions stand still until somebody lets them go on; empty for none."""
    if (reason := task.kept) is not None:
        return str(reason)
    return PAUSED if task.eventful and not task.off_path and (task.paused or task.override == 0.0) else ""


def _moves(task: TrajectoryTask) -> bool:
    """Whether motions go on: neither this arm's path nor that of another with which it moves is held."""
    waits = task.group is not None and task.group.waits_for_another(task)
    return task.eventful and not waits and not _halted(task)
