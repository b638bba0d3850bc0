"""A task that answers each STATE of one robot, and what runs it: the two sides of a driver."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from qrobot.errors import LinkError
from qrobot.rci import arm_tasks
from qrobot.rci.descriptor import TaskDescriptor, TaskState, TaskWord
from qrobot.realtime.interpreter import InterpreterShare
from qrobot.wire import Command, State


class SampledTask(Protocol):
    """A program's hold of one robot, which knows no clock, no link and no thread.

    Attributes:
        td: its descriptor.
        period_s: sample period.
    """

    td: TaskDescriptor
    period_s: float

    @property
    def left(self) -> bool:
        """True when it has let go of the robot, and has nothing more to say."""

    def step(self, state: State, now_ns: int) -> Command:
        """Answer a STATE, at `now_ns` of this end's clock. What it raises ends the hold."""

    def lose_link(self, lost: LinkError) -> None:
        """The link is broken. Raises `lost` unless the hold outlives it, and the link is to be opened anew."""

    def lose_servo(self) -> None:
        """The STATE to be answered next comes from another servo, or from one that was away.

        Nobody has confirmed anything to that one. Raises what ends the hold, where it does not outlive this.
        """

    def insist(self) -> None:
        """Called between greetings of a bridge that has gone away. Raises what is to end them."""

    def lost(self) -> None:
        """The hold has ended before its time; called with the lock held."""


class SampleDriver(Protocol):
    """Runs a task."""

    @property
    def share(self) -> InterpreterShare | None:
        """Share of the interpreter that the thread has which answers samples, None where they need no thread."""

    @property
    def error(self) -> BaseException | None:
        """Error that ended the task before its time, None as long as all is well."""

    def start(self) -> None:
        """Begin to run."""

    def fail(self, error: BaseException) -> None:
        """The hold has ended from outside."""

    def lock(self) -> AbstractContextManager[object]:
        """Held while the program touches the task."""

    def wait(self, predicate: Callable[[], bool], ours: bool = False) -> None:
        """Return when `predicate`, called with the lock held at every sample, is true.

        Args:
            predicate: of the program, and called in its thread; or one of `ours`, which any thread may call.
            ours: as said.

        Raises:
            BaseException: `error`, if it happens, or what `predicate` raises.
            MotionError: called by a function that is itself called at each sample.
            LinkLost: the robot was let go.
        """

    def end(self) -> None:
        """Let no more samples pass, whatever the task has come to, and close the link."""


def end_badly(td: TaskDescriptor, error: BaseException) -> None:
    """A hold has ended before its time: whoever has its descriptor sees so."""
    td.error, td.words[TaskWord.STATE] = error, TaskState.ENDED
    arm_tasks.let_go(td)
