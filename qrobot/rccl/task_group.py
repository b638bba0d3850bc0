"""The arms of one program that move together: one count of samples, one lock, and what one's fault means to the others.

Lloyd, Parker and McClain (1987), section 3: trajectory tasks share memory; an object's frame is evaluated before the
arms that use it in the same sample. Arms that are no group are each other's strangers, as in the older RCCL.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Protocol

from qrobot.errors import MotionError
from qrobot.motion import EventKind, Termination
from qrobot.rccl.trace import reason_of
from qrobot.wire.sequence import difference

if TYPE_CHECKING:
    from qrobot.motion import Goal, MotionEvent, Trsf
    from qrobot.rccl.task import TrajectoryTask


MOST_APART: Final = 32  # samples by which arms on one clock may differ where they join; more is another clock [A]
LAG: Final = 5  # samples from the last one in which something moved to that at which what it carries stands [A]


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


@dataclass(frozen=True)
class Carriers:
    """All that moves an arm which stays with a goal.

    Attributes:
        frames: objects' frames do, which come to rest when they are told to.
        arms: other arms do, whose transforms stand in the goal's equation.
        itself: what nobody but the arm's own stop ends: functions and variables of the program, or forces.
    """

    frames: bool
    arms: tuple[TrajectoryTask, ...]
    itself: bool


class TaskGroup:
    """Trajectory tasks of one program.

    Attributes:
        sampled: the lock between the program and all its tasks, notified after each sample of each.
        tick: the newest sample of any of them.
        period_s: sample period of all of them, 0 before there is any.
        members: what goes along with their samples, in the order in which it was added.
        frames: where its members are, and others that were or will be members.
        arms: the task of each arm by the transform that tells where the arm is.
    """

    def __init__(self) -> None:
        self.sampled = threading.Condition()
        self.tick, self.period_s = 0, 0.0
        self.members: list[GroupMember] = []
        self.frames: list[Trsf] = []
        self.arms: dict[Trsf, TrajectoryTask] = {}
        self._tasks: list[TrajectoryTask] = []
        self._led_at: dict[TrajectoryTask, int] = {}  # the newest sample at which others led it
        self._lost = ""  # an arm that could not stay with what it held, and why; until it is told
        self._stops: dict[TrajectoryTask, Goal] = {}  # stops to come, once what else carries the arm rests; from where
        self._shared: tuple[int, int] | None = None  # a sample, and its number on the clock that arms share

    def join(self, task: TrajectoryTask) -> None:
        """`task` has its arm under control: its samples count as those of the others that are of the same instants.

        Where their bridges share no clock that is the newest sample to which the others have come.

        Raises:
            MotionError: its sample period is another one.
        """
        self.agree_on(task.period_s)
        if not self._tasks:
            self._lost = ""
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
        for known in (self._led_at, self._stops):
            known.pop(task, None)
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
        self._led_at |= {task: self.tick for task in self._tasks if self._under_way(task)}
        for task, goal in list(self._stops.items()):
            self._stop_in_the_end(task, goal)

    def _stop_in_the_end(self, task: TrajectoryTask, goal: Goal) -> None:
        if task.followed is not goal:
            del self._stops[task]
        elif not self._led(task):
            del self._stops[task]
            task.stop()

    def lose(self, task: TrajectoryTask) -> None:
        """Control of one arm was lost: the others come to rest on their paths, or with what they hold.

        See `begin_stop`; an arm that goes back from what it met goes on doing so.
        """
        self.leave(task)
        self.begin_stop(retreat_too=False)

    def hear(self, task: TrajectoryTask, events: Iterable[MotionEvent]) -> None:
        """Let all come to rest where an arm cannot stay with its goal any more: others may hold what it held."""
        for event in events:
            if event.kind is EventKind.LOST and event.code != Termination.STOPPED and (self._tasks[1:] or self.members):
                of = f"of {event.request.name} " if event.request is not None else ""
                why = f"{reason_of(event.code)}{f': {event.why}' if event.why else ''}"
                told = (
                    f"{task.td.name} cannot stay at the place {of}any more ({why}); all arms and objects come to rest"
                )
                self._lost = self._lost or told
                self.begin_stop(off_path_too=False)

    def take_lost(self) -> str:
        """Words for the first arm that could not stay with its goal since they were taken; "" for none."""
        lost, self._lost = self._lost, ""
        return lost

    def begin_stop(self, retreat_too: bool = True, off_path_too: bool = True) -> None:
        """Let all that moves together begin to come to rest.

        An arm that frames or other arms carry rests with those; if it moves by itself besides, it stops then. Arms that
        carry each other stop.

        Args:
            retreat_too: an arm that goes back from what it met stops as well.
            off_path_too: an arm that is off its path stops as well, and gives a path up that it keeps.
        """
        self.come_to_rest()
        carried = {task: self.carriers(task) for task in self._tasks if self._rests_with_others(task)}
        for task in self._tasks:
            if task.off_path and not off_path_too:
                continue  # it stands, or goes on alone
            if task not in carried:
                task.stop(retreat_too=retreat_too)
            elif carried[task].itself and task.followed is not None:
                self._stops[task] = task.followed

    def rest_with(self, task: TrajectoryTask) -> None:
        """Let what carries an arm begin to come to rest, if frames do."""
        if self._by_frames(task):
            self.come_to_rest()

    def carries(self, task: TrajectoryTask) -> bool:
        """True while an arm moves because what carries it has not come to rest yet, though it will."""
        leaders = self._leaders(task)
        alone = any(each.moves for each in leaders) or any(self.carriers(each).itself for each in (task, *leaders))
        return self._led(task) or (task.followed is not None and task.moves and not alone)

    def carriers(self, task: TrajectoryTask) -> Carriers:
        """All that carries an arm: nothing, unless it stays with a goal."""
        if (goal := task.followed) is None:
            return Carriers(frames=False, arms=(), itself=False)
        moving = goal.moving
        frames = [trsf for trsf in moving if trsf in self.frames]
        arms = {trsf: arm for trsf, arm in self.arms.items() if trsf in moving and arm in self._tasks}
        others = [trsf for trsf in moving if trsf not in self.frames and trsf not in arms]
        return Carriers(frames != [], tuple(arms.values()), others != [] or goal.compliance is not None)

    def _leaders(self, task: TrajectoryTask) -> list[TrajectoryTask]:
        """The arms that carry one, and those that carry these: itself, too, where arms carry each other."""
        leaders: list[TrajectoryTask] = []
        ahead = [*self.carriers(task).arms]
        while ahead:
            if (arm := ahead.pop()) not in leaders:
                leaders.append(arm)
                ahead += self.carriers(arm).arms
        return leaders

    def _by_frames(self, task: TrajectoryTask) -> bool:
        """True for an arm that frames carry, if only by way of other arms."""
        return any(self.carriers(each).frames for each in (task, *self._leaders(task)))

    def _rests_with_others(self, task: TrajectoryTask) -> bool:
        """True for an arm that rests when all else has come to rest."""
        carriers = self.carriers(task)
        return (carriers.frames or carriers.arms != ()) and task not in self._leaders(task)

    def _under_way(self, task: TrajectoryTask) -> bool:
        """True while what carries an arm is on its way to where it rests: a frame, or another arm on its own path."""
        if task.followed is None:  # nothing carries it: nearly always, and asked at each sample
            return False
        led = any(leader.moves and leader.followed is None for leader in self._leaders(task))
        return led or (not self.rests and self._by_frames(task))

    def _led(self, task: TrajectoryTask) -> bool:
        """The same, or the newest setpoints still tell of it."""
        return self._under_way(task) or self.tick - self._led_at.get(task, -LAG) < LAG

    @property
    def tied(self) -> bool:
        """True while an arm goes to a goal that moves or stays with it: what it holds, another may hold as well."""
        return any(task.tied for task in self._tasks)

    @property
    def waits(self) -> bool:
        """True while one of the arms is off its path: all else stands still on its own."""
        return any(task.off_path for task in self._tasks)

    def waits_for_another(self, task: TrajectoryTask) -> bool:
        """True while an arm other than that of `task` is off its path.

        Arms that are off their paths themselves go back one after the other, in the order in which they joined.
        """
        others = self._tasks[: self._tasks.index(task)] if task.off_path and task in self._tasks else self._tasks
        return any(other.off_path for other in others if other is not task)

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
