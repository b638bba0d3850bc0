"""The driver of a task on virtual time: samples pass while the program waits, in the order of `program_time`."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from qrobot.rci import arm_tasks
from qrobot.rci.client import ServoLoss
from qrobot.rci.link import Link
from qrobot.rci.program_time import Rank
from qrobot.rci.robot_samples import RobotSamples, told_later
from qrobot.rci.sampled_task import SampledTask, end_badly
from qrobot.wire import Command, RobotState


class VirtualDriver:
    """See `SampleDriver`: time passes inside `wait`.

    Attributes:
        rank: its place among all that run at an instant.
    """

    share: None = None

    def __init__(
        self, link: Link, task: SampledTask, tell_again: Callable[[RobotState, bool], object], rank: Rank | None = None
    ) -> None:
        self._link, self._task, self._tell_again = link, task, tell_again
        self._command: Command | None = None
        self._samples = RobotSamples(self._exchange, self._failed, rank)
        self.rank = self._samples.rank

    @property
    def error(self) -> BaseException | None:
        """See `SampleDriver.error`."""
        return self._samples.error

    def start(self) -> None:
        """See `SampleDriver.start`."""
        self._task.td.begin()
        arm_tasks.hold(self._task.td)
        self._samples.begin(self._task.period_s)

    def fail(self, error: BaseException) -> None:
        """See `SampleDriver.fail`."""
        self._samples.error = told_later(error)

    def lock(self) -> AbstractContextManager[object]:
        """See `SampleDriver.lock`: nobody else is there."""
        return nullcontext()

    def wait(self, predicate: Callable[[], bool], ours: bool = False) -> None:  # noqa: ARG002 (there is one thread)
        """See `SampleDriver.wait`."""
        self._samples.wait(predicate)

    def end(self) -> None:
        """See `SampleDriver.end`."""
        arm_tasks.let_go(self._task.td)
        self._samples.end()
        self._link.close("program ended")

    def _exchange(self) -> None:
        state = self._link.exchange(self._command)
        if loss := self._link.take_servo_loss():
            self._task.lose_servo()
            self._tell_again(state.robot, loss is ServoLoss.ANOTHER)
        self._command = self._task.step(state, self._link.now_ns())

    def _failed(self, error: BaseException) -> None:
        end_badly(self._task.td, error)
        self._link.close(str(error))
        self._task.lost()
