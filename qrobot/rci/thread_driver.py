"""The driver of a task in real time: a thread that answers every STATE, and those who wait for its samples."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Final

from qrobot.errors import LinkError, LinkLost, LinkTimeout, MotionError
from qrobot.rci import arm_tasks
from qrobot.rci.client import ServoLoss
from qrobot.rci.forked_child import NO_PART, keep_from_children
from qrobot.rci.link import Link
from qrobot.rci.program_time import NO_WAIT
from qrobot.rci.robot_samples import RELEASED, told_later
from qrobot.rci.sampled_task import SampledTask, end_badly
from qrobot.realtime.interpreter import InterpreterShare
from qrobot.realtime.setup import set_fifo
from qrobot.wire import Command, RobotState

PRIORITY: Final = 20  # ahead of ordinary programs where that is allowed, behind bridge and servo
AGAIN_S: Final = 0.5  # [A] between greetings of a bridge that has gone away
_LOOK_S: Final = 0.5  # a waiting program looks up so often


class _Look:
    """A predicate that is looked at until it is true, or raises.

    Attributes:
        over: it has come true, or has raised.
        error: what it has raised.
    """

    def __init__(self, predicate: Callable[[], bool]) -> None:
        self.over = False
        self.error: BaseException | None = None
        self._predicate = predicate

    def take(self) -> None:
        """Look, unless it is over."""
        if self.over:
            return
        try:
            self.over = self._predicate()
        except BaseException as error:  # it belongs to who waits
            self.over, self.error = True, error


class _SampleThread(threading.Thread):
    """A thread that answers the STATEs of one robot: it waits for none, lest its own go unanswered."""


_asking: Final = threading.local()  # `now`: the thread asks a predicate of the program, with the lock of its samples


def in_sample_thread() -> bool:
    """Whether the caller is called at the samples of a robot in real time."""
    return isinstance(threading.current_thread(), _SampleThread)


def keeps_samples_waiting() -> bool:
    """Whether samples of a robot in real time wait for the caller: it is called at one, or asked between two."""
    return in_sample_thread() or getattr(_asking, "now", False)


class ThreadDriver:
    """See `SampleDriver`: time passes by itself, and a thread answers every STATE. See `driver_for`."""

    def __init__(
        self,
        link: Link,
        task: SampledTask,
        name: str,
        tell_again: Callable[[RobotState, bool], object] = lambda _now, _forgotten: None,
        lock: threading.Condition | None = None,
    ) -> None:
        self.error: BaseException | None = None
        self.share = InterpreterShare()
        self._link, self._task, self._tell_again = link, task, tell_again
        self._sampled = lock or threading.Condition()
        self._shared = lock is not None  # others wait for it
        self._over = self._greeted_anew = False
        self._thread = _SampleThread(target=self._run, name=name, daemon=True)
        self._looking = 0  # waits that look themselves
        self._looks: list[_Look] = []  # that the thread takes
        keep_from_children(self)

    def start(self) -> None:
        """Start the thread, which has the interpreter when a sample is due."""
        self._task.td.begin()
        arm_tasks.hold(self._task.td)
        self.share.begin()
        self._thread.start()

    def fail(self, error: BaseException) -> None:
        """See `SampleDriver.fail`."""
        self.error = told_later(error)

    def lock(self) -> AbstractContextManager[object]:
        """The lock between program and thread; re-entrant."""
        return self._sampled

    def wait(self, predicate: Callable[[], bool], ours: bool = False) -> None:
        """Sleep from sample to sample until `predicate` is true; through all of them when that is one of `ours`.

        A program that is woken at each sample needs the interpreter for a moment, and may lose the processor meanwhile:
        then the thread waits for both.
        """
        if in_sample_thread():
            raise MotionError(NO_WAIT)
        with self._sampled:
            before, _asking.now = getattr(_asking, "now", False), True
            try:
                if ours:
                    self._sleep_through(_Look(predicate))
                else:
                    self._sleep_from_sample_to_sample(predicate)
            finally:
                _asking.now = before

    def _sleep_from_sample_to_sample(self, predicate: Callable[[], bool]) -> None:
        self._looking += 1
        try:
            while not predicate():
                self._require_thread()
                self._sampled.wait(_LOOK_S)
        finally:
            self._looking -= 1

    def _sleep_through(self, look: _Look) -> None:
        look.take()
        self._looks.append(look)
        try:
            while not look.over:
                self._require_thread()
                self._sampled.wait(_LOOK_S)
        finally:
            self._looks.remove(look)
        if look.error is not None:
            raise look.error

    def _require_thread(self) -> None:
        """Raise what has ended it."""
        if self.error is not None:
            raise self.error
        if not self._thread.is_alive():
            raise LinkLost(RELEASED)

    def _tell_waiting(self) -> None:
        """Wake those who look themselves, and those whose predicate has come true."""
        for look in self._looks:
            look.take()
        if self._looking or self._shared or any(look.over for look in self._looks):
            self._sampled.notify_all()

    def end(self) -> None:
        """Wait for the thread, which closes the link after its sample."""
        self._over = True
        if self._thread.is_alive():
            self._thread.join()
        self.share.end()

    def forget_in_child(self) -> None:
        """See `Owned`: the thread is the parent's, which may have had the lock."""
        self._sampled = threading.Condition()
        self.error = LinkLost(NO_PART)

    def _run(self) -> None:
        set_fifo(PRIORITY)
        reason = "program ended"
        try:
            self._answer_states()
        except BaseException as error:  # it belongs to the program, which gets it where it waits
            reason = str(error)
            with self._sampled:
                self.error = error
                end_badly(self._task.td, error)
                self._task.lost()
                self._sampled.notify_all()
        finally:
            arm_tasks.let_go(self._task.td)
            self._link.close(reason)

    def _answer_states(self) -> None:
        command: Command | None = None
        while not self._over and not self._task.left:
            try:
                state = self._link.exchange(command)
            except (LinkLost, LinkTimeout) as lost:
                command = None
                self._greet_anew(lost)
                continue
            with self._sampled:
                loss = self._link.take_servo_loss()
                if loss or self._greeted_anew:
                    forgotten = self._greeted_anew or loss is ServoLoss.ANOTHER
                    self._greeted_anew = False
                    self._task.lose_servo()
                    self._tell_again(state.robot, forgotten)
                command = self._task.step(state, self._link.now_ns())
                self._tell_waiting()

    def _greet_anew(self, lost: LinkError) -> None:
        """Come back to the bridge with a hold that outlives its link. Raises `lost`: it does not; LinkBusy."""
        with self._sampled:
            self._task.lose_link(lost)
        while not self._over:
            try:
                self._link.reopen(round(self._task.period_s * 1e6))
            except (LinkLost, LinkTimeout):
                time.sleep(AGAIN_S)
                self._task.insist()
            else:
                self._greeted_anew = True
                return
