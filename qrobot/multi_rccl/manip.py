"""The MANIP of Multi-RCCL: a manipulator of a program, an arm or the frame of an object."""

from __future__ import annotations

from abc import ABC, abstractmethod

from qrobot.motion import HERE, Generator, MoveRequest
from qrobot.multi_rccl.moving_transform import MovingTransform
from qrobot.rccl import Event, Position
from qrobot.rccl.parameters import DEFAULT_SPEED, MotionParameters, MoveOrder
from qrobot.rccl.position import there
from qrobot.rccl.task_group import TaskGroup
from qrobot.units import S_PER_MS


class Manip(ABC):
    """One manipulator with a trajectory generator of its own.

    Attributes:
        name: by which it was opened.
        trans: where it is at each sample, for equations of others: T6 of an arm as it is sent, or an object's pose.
        completed: event, true while it has nothing to do.
    """

    name: str
    trans: MovingTransform
    completed: Event
    _group: TaskGroup

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r})"

    @abstractmethod
    def control(self, clear_fault: bool, period_ms: float | None) -> None:
        """Turn its trajectory generator on. Raises what `rccl_control` raises."""

    @property
    @abstractmethod
    def parameters(self) -> MotionParameters:
        """Its motion parameters. Raises LinkError before `control`."""

    @property
    @abstractmethod
    def eventful(self) -> bool:
        """Events of its motions are still to come."""

    @property
    @abstractmethod
    def waiting(self) -> int:
        """Number of motions that wait in its queue."""

    @abstractmethod
    def skip(self, code: int) -> None:
        """End its present motion now, with `code` in its position. Raises LinkError before `control`."""

    @abstractmethod
    def check(self) -> None:
        """Raise what has ended its control, if anything has."""

    @abstractmethod
    def move(self, position: Position) -> None:
        """Queue a motion. Raises what `Channel.move` raises."""

    def stop_at(self, position: Position | None, ms: float) -> None:
        """Queue a stop. Raises what `stop` raises."""
        with self._group.sampled:
            if position is not None:
                self.move(position)
            self.stand(ms)

    @abstractmethod
    def stand(self, ms: float) -> None:
        """Queue an absolute stop, after which it stands for at least `ms`. What was said for one motion is for others.

        Raises LinkError before `control`; MotionError: too many motions wait.
        """

    @abstractmethod
    def cancel(self, ms: float) -> None:
        """Forget all motions and come to rest."""

    @abstractmethod
    def maintain(self, position: Position) -> None:
        """Be at `position` at once, and stay with it. Raises what `maintain` raises."""

    @abstractmethod
    def track(self) -> None:
        """Stay with the goal of the next motion when it is reached."""


def absolute_stop(ms: float = 0.0) -> MoveOrder:
    """An absolute stop, after which it stands for at least `ms`."""
    position = there()
    return MoveOrder(MoveRequest(position.name, HERE, DEFAULT_SPEED, stay_s=ms * S_PER_MS), position)


def follows(generator: Generator) -> bool:
    """A goal that moves was reached, and is stayed with; one that merely gives way stands still."""
    goal = generator.goal
    return goal is not None and not (goal.left.fixed and goal.right.fixed) and not generator.busy
