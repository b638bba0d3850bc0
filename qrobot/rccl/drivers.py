"""Who calls the trajectory task: a thread paced by the robot's STATE packets, or the program itself while it waits.

The same program runs under both. In real time samples pass by themselves; in lock-step time stands still until the
program waits for something, so a run is the same every time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Final, Protocol

from qrobot.errors import LinkLost
from qrobot.rccl.task import Phase, TrajectoryTask
from qrobot.rci import Link
from qrobot.realtime.setup import set_fifo
from qrobot.wire import Command

_PRIORITY: Final = 20  # ahead of ordinary programs where that is allowed, behind bridge and servo
_LOOK_S: Final = 0.5  # a waiting program looks up so often


class Driver(Protocol):
    """Runs a task.

    Attributes:
        error: what ended the task before its time, None as long as all is well.
    """

    error: BaseException | None

    def start(self) -> None:
        """Begin to run."""

    def lock(self) -> AbstractContextManager[object]:
        """Held while the program touches the task."""

    def wait(self, predicate: Callable[[], bool]) -> None:
        """Return when `predicate`, called with the lock held at every sample, is true. Raises `error` if it happens."""

    def end(self) -> None:
        """Let no more samples pass, whatever the task has come to, and close the link."""


class LockstepDriver:
    """Time passes inside `wait`."""

    def __init__(self, link: Link, task: TrajectoryTask) -> None:
        self.error: BaseException | None = None
        self._link = link
        self._task = task
        self._command: Command | None = None

    def start(self) -> None:
        """Nothing to do: the program itself lets time pass."""

    def lock(self) -> AbstractContextManager[object]:
        """Nobody else is there."""
        return nullcontext()

    def wait(self, predicate: Callable[[], bool]) -> None:
        """Let samples pass until `predicate` is true."""
        while not predicate():
            if self.error is not None:
                raise self.error
            self._sample()

    def end(self) -> None:
        """Close the link."""
        self._link.close("program ended")

    def _sample(self) -> None:
        try:
            self._command = self._task.step(self._link.exchange(self._command), self._link.now_ns())
        except BaseException as error:
            self.error = error
            self._link.close(str(error))
            raise


class ThreadDriver:
    """Time passes by itself: a thread answers every STATE."""

    def __init__(self, link: Link, task: TrajectoryTask) -> None:
        self.error: BaseException | None = None
        self._link = link
        self._task = task
        self._sampled = threading.Condition()
        self._over = False
        self._thread = threading.Thread(target=self._run, name="rccl-trajectory", daemon=True)

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def lock(self) -> AbstractContextManager[object]:
        """The lock between program and thread; re-entrant."""
        return self._sampled

    def wait(self, predicate: Callable[[], bool]) -> None:
        """Sleep from sample to sample until `predicate` is true."""
        with self._sampled:
            while not predicate():
                if self.error is not None:
                    raise self.error
                if not self._thread.is_alive():
                    raise LinkLost("the arm was released: nothing can happen any more")
                self._sampled.wait(_LOOK_S)

    def end(self) -> None:
        """Wait for the thread, which closes the link after its sample."""
        self._over = True
        self._thread.join()

    def _run(self) -> None:
        set_fifo(_PRIORITY)
        reason = "program ended"
        try:
            self._answer_states()
        except BaseException as error:  # it belongs to the program, which gets it where it waits
            reason = str(error)
            with self._sampled:
                self.error = error
                self._sampled.notify_all()
        finally:
            self._link.close(reason)

    def _answer_states(self) -> None:
        command: Command | None = None
        while not self._over and self._task.phase is not Phase.LEFT:
            state = self._link.exchange(command)
            with self._sampled:
                command = self._task.step(state, self._link.now_ns())
                self._sampled.notify_all()


def driver_for(link: Link, task: TrajectoryTask) -> Driver:
    """The driver that suits the link's time."""
    return LockstepDriver(link, task) if link.virtual_time else ThreadDriver(link, task)
