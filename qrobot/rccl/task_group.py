"""The arms of one program that move together: one count of samples, one lock, and what one's fault means to the others.

Lloyd, Parker and McClain (1987), section 3: trajectory tasks share memory; an object's frame is evaluated before the
arms that use it in the same sample. Arms that are no group are each other's strangers, as in the older RCCL.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Final, Protocol

import numpy as np

from qrobot.errors import MotionError
from qrobot.wire.sequence import difference

if TYPE_CHECKING:
    from qrobot.motion import Goal, Trsf
    from qrobot.rccl.task import TrajectoryTask


MOST_APART: Final = 32  # samples by which arms on one clock may differ where they join; more is another clock [A]
STANDING: Final = 1e-6  # rad/s or m/s: of a setpoint that stands, but for rounding


class GroupMember(Protocol):
    """Something that takes part in the samples of a group."""

    def before_sample(self, tick: int) -> None:
        """Some arm is about to make its setpoints of sample `tick`; called for each arm."""

    def come_to_rest(self) -> None:
        """An arm of the group was lost, or is about to be let go of."""

    @property
    def busy(self) -> bool:
        """Whether motions of its own are still to be done."""

    @property
    def rests(self) -> bool:
        """Whether it moves no more."""


class TaskGroup:
    """Trajectory tasks of one program.

    Attributes:
        sampled: the lock between the program and all its tasks, notified after each sample of each.
        tick: the newest sample of any of them.
        period_s: sample period of all of them, 0 before there is any.
        members: what goes along with their samples, in the order in which it was added.
        transforms: where arms and members are: what follows them comes to rest when they do.
    """

    def __init__(self) -> None:
        self.sampled = threading.Condition()
        self.tick, self.period_s = 0, 0.0
        self.members: list[GroupMember] = []
        self.transforms: list[Trsf] = []
        self._tasks: list[TrajectoryTask] = []
        self._shared: tuple[int, int] | None = None  # a sample, and its number on the clock that arms share

    def join(self, task: TrajectoryTask) -> None:
        """`task` has its arm under control: its samples count as those of the others that are of the same instants.

        Where their bridges share no clock that is the newest sample to which the others have come.

        Raises:
            MotionError: its sample period is another one.
        """
        self.agree_on(task.period_s)
        if task not in self._tasks:
            self._tasks.append(task)
        task.count_from(self._sample_of(task))
        if task.period_number is not None and self._shared is None:
            self._shared = task.tick, task.period_number

    def _sample_of(self, task: TrajectoryTask) -> int:
        """The sample of the others that is of the same instant as the newest of `task`."""
        if task.period_number is None or self._shared is None:
            return self.tick
        tick, number = self._shared
        sample = tick + difference(task.period_number, number)
        return sample if abs(sample - self.tick) <= MOST_APART else self.tick

    def agree_on(self, period_s: float) -> None:
        """Have a sample period. Raises MotionError: it is another one already."""
        if self.period_s and abs(period_s - self.period_s) > 1e-9:
            both = f"{self.period_s * 1e3:g} ms and {period_s * 1e3:g} ms"
            raise MotionError(f"arms that move together need one sample period, not {both}")
        self.period_s = period_s

    def leave(self, task: TrajectoryTask) -> None:
        """`task` has let go of its arm; does nothing a second time."""
        if task in self._tasks:
            self._tasks.remove(task)
        if not self._tasks:
            self._shared = None
        if not self._tasks and not self.members:
            self.period_s = 0.0

    def before_sample(self, tick: int) -> None:
        """An arm is about to make its setpoints of sample `tick`.

        Samples that it has left out come first: another arm may still be about to make its setpoints of them.
        """
        left_out = range(max(self.tick + 1, tick - MOST_APART), tick)
        self.tick = max(self.tick, tick)
        for number in (*left_out, tick):
            for member in self.members:
                member.before_sample(number)

    def lose(self, task: TrajectoryTask) -> None:
        """Control of one arm was lost: the others come to rest on their paths, or with what they hold.

        An arm that follows a frame goes on doing so, for that frame comes to rest; and one that goes back from what it
        met as well.
        """
        self.leave(task)
        self.begin_stop(retreat_too=False)

    def begin_stop(self, retreat_too: bool = True) -> None:
        """Let all that moves together begin to come to rest; an arm that follows a frame rests with that.

        Args:
            retreat_too: an arm that goes back from what it met stops as well.
        """
        self.come_to_rest()
        for task in self._tasks:
            if not task.follows:
                task.stop(retreat_too=retreat_too)

    def leads(self, goal: Goal | None) -> bool:
        """True for a goal that no function of the program moves."""
        return goal is not None and all(trsf in self.transforms for trsf in goal.functions)

    def carries(self, task: TrajectoryTask) -> bool:
        """True while the arm moves because what it follows does; one that gives way may go on by itself."""
        goal = task.generator.goal
        if goal is None or goal.compliance is not None or not task.follows:
            return False
        return bool(np.abs(task.generator.state()[1]).max() > STANDING)

    @property
    def tied(self) -> bool:
        """True while an arm goes to a goal that moves or stays with it: what it holds, another may hold as well."""
        return any(task.tied for task in self._tasks)

    @property
    def waits(self) -> bool:
        """True while one of the arms is off its path: all else stands still on its own."""
        return any(task.off_path for task in self._tasks)

    def waits_for_another(self, task: TrajectoryTask) -> bool:
        """True while an arm other than that of `task` is off its path."""
        return any(other.off_path for other in self._tasks if other is not task)

    def come_to_rest(self) -> None:
        """Let all that arms follow come to rest."""
        for member in self.members:
            member.come_to_rest()

    @property
    def busy(self) -> bool:
        """True while something that arms follow has motions of its own to do."""
        return any(member.busy for member in self.members)

    @property
    def rests(self) -> bool:
        """True when all that arms follow has come to rest."""
        return all(member.rests for member in self.members)
