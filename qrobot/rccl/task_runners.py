"""Callers of the trajectory task: a thread paced by the robot's STATE packets, or the program itself while it waits.

The same program runs under both. In real time samples pass by themselves; in lock-step time stands still until the
program waits for something, so a run is the same every time. Time passes for all arms of a program alike: whichever it
waits for, none is left behind.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext, suppress
from typing import ClassVar, Final, Protocol
from weakref import WeakSet

from qrobot.errors import LinkError, LinkLost, LinkTimeout, MotionError
from qrobot.rccl.task import TaskPhase, TrajectoryTask
from qrobot.rci import Link
from qrobot.realtime.interpreter import InterpreterShare
from qrobot.realtime.setup import set_fifo
from qrobot.units import NS_PER_S
from qrobot.wire import Command

_PRIORITY: Final = 20  # ahead of ordinary programs where that is allowed, behind bridge and servo
_LOOK_S: Final = 0.5  # a waiting program looks up so often
AGAIN_S: Final = 0.5  # [A] between greetings of a bridge that has gone away
_NO_WAIT: Final = "a function that is called at each sample must not wait: let it signal an event the program waits for"


class TrajectoryRunner(Protocol):
    """Runs a task.

    Attributes:
        error: what ended the task before its time, None as long as all is well.
    """

    error: BaseException | None

    def start(self) -> None:
        """Begin to run."""

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
        """

    def end(self) -> None:
        """Let no more samples pass, whatever the task has come to, and close the link."""


class LockstepRunner:
    """Time passes inside `wait`."""

    _running: ClassVar[WeakSet[LockstepRunner]] = WeakSet()

    def __init__(self, link: Link, task: TrajectoryTask) -> None:
        self.error: BaseException | None = None
        self._link = link
        self._task = task
        self._command: Command | None = None
        self._origin_ns = 0
        self._sampling = False
        self._thread = threading.get_ident()  # of the program; another thread's time is its own

    def start(self) -> None:
        """Let time pass from now on, beside that of the program's other arms."""
        now_ns = max((other._elapsed_ns for other in self._others()), default=0)
        self._origin_ns = self._link.now_ns() - now_ns
        self._running.add(self)

    def lock(self) -> AbstractContextManager[object]:
        """Nobody else is there."""
        return nullcontext()

    def wait(self, predicate: Callable[[], bool], ours: bool = False) -> None:  # noqa: ARG002 (there is one thread)
        """Let samples pass until `predicate` is true."""
        if self._sampling:
            raise MotionError(_NO_WAIT)
        while not predicate():
            if self.error is not None:
                raise self.error
            self._sample()
            for other in self._others():
                other._catch_up(self._elapsed_ns)

    def end(self) -> None:
        """Close the link."""
        self._running.discard(self)
        self._link.close("program ended")

    def _others(self) -> list[LockstepRunner]:
        """Tasks of the program's other arms."""
        return [other for other in self._running if other is not self and other._thread == self._thread]

    @property
    def _elapsed_ns(self) -> int:
        """Time of the program, which all its arms share."""
        return self._link.now_ns() - self._origin_ns

    def _catch_up(self, elapsed_ns: int) -> None:
        """Let samples pass to about that time; what goes wrong is told when the program turns to this arm."""
        nearly_ns = elapsed_ns - round(self._task.period_s * 0.5 * NS_PER_S)
        with suppress(Exception):
            while self.error is None and not self._sampling and self._elapsed_ns <= nearly_ns:
                self._sample()

    def _sample(self) -> None:
        self._sampling = True
        try:
            self._command = self._task.step(self._link.exchange(self._command), self._link.now_ns())
        except BaseException as error:
            self.error = error
            self._running.discard(self)
            self._link.close(str(error))
            if self._task.group is not None:
                self._task.group.lose(self._task)
            raise
        finally:
            self._sampling = False


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


class ThreadRunner:
    """Time passes by itself: a thread answers every STATE.

    Args:
        link: open.
        task: to run.
        greeted: called when a link that was lost is there again.
    """

    def __init__(self, link: Link, task: TrajectoryTask, greeted: Callable[[], None]) -> None:
        self.error: BaseException | None = None
        self._link = link
        self._task = task
        self._sampled = threading.Condition() if task.group is None else task.group.sampled
        self._over = False
        self._thread = threading.Thread(target=self._run, name="rccl-trajectory", daemon=True)
        self._share = InterpreterShare()
        task.timing.share = self._share
        self._greeted = greeted
        self._looking = 0  # waits that look themselves
        self._looks: list[_Look] = []  # that the thread takes

    def start(self) -> None:
        """Start the thread, which has the interpreter when a sample is due."""
        self._share.begin()
        self._thread.start()

    def lock(self) -> AbstractContextManager[object]:
        """The lock between program and thread; re-entrant."""
        return self._sampled

    def wait(self, predicate: Callable[[], bool], ours: bool = False) -> None:
        """Sleep from sample to sample until `predicate` is true; through all of them when that is one of `ours`.

        A program that is woken at each sample needs the interpreter for a moment, and may lose the processor meanwhile:
        then the thread waits for both.
        """
        if threading.current_thread() is self._thread:
            raise MotionError(_NO_WAIT)
        with self._sampled:
            if ours:
                self._sleep_through(_Look(predicate))
            else:
                self._sleep_from_sample_to_sample(predicate)

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
            raise LinkLost("the arm was released: nothing can happen any more")

    def _tell_waiting(self) -> None:
        """Wake those who look themselves, and those whose predicate has come true."""
        for look in self._looks:
            look.take()
        if self._looking or self._task.group is not None or any(look.over for look in self._looks):
            self._sampled.notify_all()

    def end(self) -> None:
        """Wait for the thread, which closes the link after its sample."""
        self._over = True
        self._thread.join()
        self._share.end()

    def _run(self) -> None:
        set_fifo(_PRIORITY)
        reason = "program ended"
        try:
            self._answer_states()
        except BaseException as error:  # it belongs to the program, which gets it where it waits
            reason = str(error)
            with self._sampled:
                self.error = error
                if self._task.group is not None:
                    self._task.group.lose(self._task)
                self._sampled.notify_all()
        finally:
            self._link.close(reason)

    def _answer_states(self) -> None:
        command: Command | None = None
        while not self._over and self._task.phase is not TaskPhase.LEFT:
            try:
                state = self._link.exchange(command)
            except (LinkLost, LinkTimeout) as lost:
                command = None
                self._greet_anew(lost)
                continue
            with self._sampled:
                command = self._task.step(state, self._link.now_ns())
                self._tell_waiting()

    def _greet_anew(self, lost: LinkError) -> None:
        """Come back to the bridge with a path that is kept. Raises `lost`: it is not, or given up; LinkBusy."""
        with self._sampled:
            self._task.lose_link(lost)
        while not self._over:
            try:
                self._link.reopen(round(self._task.period_s * 1e6))
            except (LinkLost, LinkTimeout):
                time.sleep(AGAIN_S)
                self._task.insist()
            else:
                self._greeted()
                return


def runner_for(link: Link, task: TrajectoryTask, greeted: Callable[[], None] = lambda: None) -> TrajectoryRunner:
    """The driver that suits the link's time; `greeted` is called when a link that was lost is there again."""
    return LockstepRunner(link, task) if link.virtual_time else ThreadRunner(link, task, greeted)
