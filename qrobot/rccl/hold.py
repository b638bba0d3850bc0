"""A program's hold of one arm, from the first setpoint to the goodbye, and where what went wrong is told."""

from __future__ import annotations

import atexit
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager

from qrobot.errors import LinkError, QRobotError
from qrobot.rccl.drivers import driver_for
from qrobot.rccl.task import Phase, TrajectoryTask
from qrobot.rccl.trace import Trace
from qrobot.rci import Link


class Hold:
    """Runs a trajectory task for a program.

    What ends it before its time is raised in the program: where it waits, at its next call, or at the latest at
    `release`. A program that ends without `release` is released then, and the error printed.

    Args:
        name: of the arm, for people.
        link: open.
        task: of the arm.
    """

    def __init__(self, name: str, link: Link, task: TrajectoryTask) -> None:
        self._name = name
        self._link = link
        self._task = task
        self._driver = driver_for(link, task)
        self._released = False
        self._error_told = False

    def start(self) -> None:
        """Run until the servo follows our setpoints."""
        self._begin()
        atexit.register(self._at_exit)

    def change_period(self, period_us: int, trace: Trace | None) -> None:
        """Bring the arm to rest, let go of it, and take it again with another sample period, of which `trace` is told.

        It goes on holding its position meanwhile. Raises what `control` raises; the hold has then ended.
        """
        self._come_to_rest()
        self._leave(power_off=False)
        self._driver.end()
        try:
            welcome = self._link.reopen(period_us)
        except BaseException as error:
            self._driver.error = error
            raise
        self._task.begin(welcome.period_us * 1e-6, trace)
        self._driver = driver_for(self._link, self._task)
        self._begin()

    def release(self, power_off: bool) -> None:
        """Bring the arm to rest, let go of it and close the link; a second call does nothing.

        Raises what ended the hold before, if the program has not heard of it yet.
        """
        if self._released:
            return
        self._released = True
        atexit.unregister(self._at_exit)
        try:
            if self._driver.error is None:
                self._come_to_rest()
                self._leave(power_off)
        finally:
            self._driver.end()
        self._tell_error()

    def wait(self, predicate: Callable[[], bool]) -> None:
        """Return when `predicate`, called at every sample, is true. Raises what ended the hold."""
        try:
            self._driver.wait(predicate)
        finally:
            self._error_told = self._error_told or self._driver.error is not None

    def task(self) -> AbstractContextManager[object]:
        """The lock under which a program touches the task. Raises what ended the hold, LinkError after `release`."""
        if self._driver.error is not None:
            self._error_told = True
            raise self._driver.error
        if self._released:
            raise LinkError(f"{self._name} was released; call control() first")
        return self._driver.lock()

    def _begin(self) -> None:
        self._driver.start()
        self.wait(lambda: self._task.phase is Phase.TRACKING)

    def _come_to_rest(self) -> None:
        with self._driver.lock():
            self._task.stop()  # at rest it may still follow a frame that moves
        self.wait(lambda: not self._task.busy)

    def _leave(self, power_off: bool) -> None:
        with self._driver.lock():
            self._task.leave(power_off)
        self.wait(lambda: self._task.phase is Phase.LEFT)

    def _tell_error(self) -> None:
        if self._driver.error is not None and not self._error_told:
            self._error_told = True
            raise self._driver.error

    def _at_exit(self) -> None:
        try:
            self.release(power_off=False)
        except QRobotError as error:
            print(f"{self._name}: {error}", file=sys.stderr)
