"""A program's hold of one arm, from the first setpoint to the goodbye, and where what went wrong is told."""

from __future__ import annotations

import atexit
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from typing import ClassVar
from weakref import WeakKeyDictionary

from qrobot.errors import LinkError, MotionError, QRobotError, letting_go, raise_first
from qrobot.rccl.standstill import RcclStandstill
from qrobot.rccl.task import TrajectoryTask
from qrobot.rccl.trace import Trace
from qrobot.rci import Link
from qrobot.rci.arm_settings import ArmSettings
from qrobot.rci.bad_end import at_bad_end, interpreter_ends_well, stop_each, stopping
from qrobot.rci.forked_child import keep_from_children
from qrobot.rci.listening import heard, heard_on_leaving, is_listening
from qrobot.rci.sample_drivers import driver_for, refuse_at_samples
from qrobot.rci.sampled_task import SampleDriver
from qrobot.wire import RobotState, Signals
from qrobot.wire.codec import check_signal_names


class ArmSession:
    """Runs a trajectory task for a program.

    What ends it before its time is raised in the program: where it waits, at its next call, or at the latest at
    `release`. When a program ends without `release`, its motions are done first if it ended well; errors are printed.

    Args:
        name: of the arm, for people.
        link: open.
        task: of the arm.
        make_driver: maker of its drivers; by default they suit the time of the link.

    Attributes:
        released: the arm was let go of.
        settings: of the arm's servo.
    """

    _holds: ClassVar[WeakKeyDictionary[ArmSession, None]] = WeakKeyDictionary()  # in the order they were taken

    def __init__(
        self,
        name: str,
        link: Link,
        task: TrajectoryTask,
        make_driver: Callable[[], SampleDriver] | None = None,
    ) -> None:
        self._name = name
        self._link = link
        self._task = task
        self._make_driver = make_driver
        self._driver = self._new_driver(None)
        self.released = False
        self._error_told = False
        self._block_thread = 0  # whose `with` block holds the arm
        self._signals: tuple[str, ...] = ()
        self.settings = ArmSettings(
            name, lambda: link, self.task, self.wait, lambda: self._task.tick, lambda: self._task.how
        )

    def start(self) -> None:
        """Run until the servo follows our setpoints."""
        try:
            self._begin()
        except BaseException:
            self._driver.end()
            raise
        atexit.register(self._at_exit)
        keep_from_children(self)
        self._holds[self] = None

    def forget_in_child(self) -> None:
        """See `Owned`: the hold is the parent's."""
        self.released = self._error_told = True
        self._holds.pop(self, None)
        atexit.unregister(self._at_exit)

    def _new_driver(self, before: SampleDriver | None) -> SampleDriver:
        task = self._task
        if self._make_driver is not None:
            return self._make_driver()
        lock = None if task.group is None else task.group.sampled
        driver = driver_for(self._link, task, "rccl-trajectory", self._tell_again, lock, before)
        task.timing.share = driver.share
        return driver

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
            self._driver.fail(error)
            raise
        self._task.begin(welcome.period_us * 1e-6, trace)
        self._tell_again()
        self._driver = self._new_driver(self._driver)
        self._begin()

    def log_signal(self, name: str, value: float) -> None:
        """Tell a number of the program's by name. Raises MotionError: no such name, or too many."""
        with self.task():
            if name not in self._signals:
                names = (*self._signals, name)
                if wrong := check_signal_names(names):
                    raise MotionError(f"log_signal: {wrong}")
                self._signals = names
                self._link.tell(Signals(names))
            numbers = list(self._task.chg.signals)
            numbers[self._signals.index(name)] = value
            self._task.chg.signals = tuple(numbers)

    def _tell_again(self, now: RobotState | None = None, forgotten: bool = True) -> None:
        """Tell bridge or servo that may be others the names of the program's signals; see `ArmSettings.tell_again`."""
        if self._signals:
            self._link.tell(Signals(self._signals))
        self.settings.tell_again(now, forgotten)

    def finish(self) -> None:
        """Wait until all motions are done. Raises what `Channel.finish` raises."""
        if self.released or self._driver.error is not None:
            return
        failures = self._task.motions.failures
        before, group = len(failures), self._task.group
        self.wait(lambda: not self._task.eventful and not (group and group.busy), ours=False)
        if len(failures) > before:
            last = failures[before]
            del failures[before:]
            raise MotionError(f"{self._name}: the program has ended, but not all its motions were done: {last}")
        if group is not None and (lost := group.take_lost()):
            raise MotionError(f"the program has ended, but not all its motions were done: {lost}")

    def release(self, power_off: bool) -> None:
        """Bring the arm to rest, let go of it and close the link; a second call does nothing.

        Motions that turned out to be impossible are told on stderr: a program that has not looked at the `code` of its
        positions knows nothing of them. Raises what ended the hold before, if the program has not heard of it yet;
        MotionError, and the hold goes on, in a function that is called at a sample.
        """
        if self.released:
            return
        refuse_at_samples()
        self.released = True
        self._holds.pop(self, None)
        atexit.unregister(self._at_exit)
        try:
            if self._driver.error is None:
                self._come_to_rest()
                self._leave(power_off)
        finally:
            self._driver.end()
            self._link.close()
            if self._task.group is not None:
                self._task.group.leave(self._task)
        if failures := self._task.motions.failures:
            print(f"{self._name}: could not be done on the way: {'; '.join(failures)}", file=sys.stderr)
        self._tell_error()

    def wait(self, predicate: Callable[[], bool], ours: bool = True) -> None:
        """Return when `predicate`, called at every sample, is true. Raises what ended the hold.

        On virtual time MotionError as well: an arm stands still until somebody lets it go on, and nobody will. One that
        is not `ours` is called in the thread of the program.
        """
        self._wait(heard(predicate), ours)

    def _wait_on_leaving(self, predicate: Callable[[], bool]) -> None:
        """`wait` while the arm comes to rest: the end of the program ends that wait no sooner."""
        self._wait(heard_on_leaving(predicate), ours=True)

    def _wait(self, predicate: Callable[[], bool], ours: bool) -> None:
        ours = ours and not is_listening()  # what listens is asked in the thread of the program
        try:
            self._driver.wait(self._watched(predicate) if self._link.virtual_time else predicate, ours)
        except BaseException as error:
            self._error_told = self._error_told or error is self._driver.error
            raise

    def _watched(self, predicate: Callable[[], bool]) -> Callable[[], bool]:
        """The same, which raises MotionError as soon as nobody will let arms go on that stand still."""
        standstill = RcclStandstill(self._task)

        def happened() -> bool:
            if predicate():
                return True
            standstill.check([(hold._name, hold._task) for hold in self._holds])
            return False

        return happened

    def task(self) -> AbstractContextManager[object]:
        """The lock under which a program touches the task. Raises what ended the hold, LinkError after `release`."""
        if self._driver.error is not None:
            self._error_told = True
            raise self._driver.error
        if self.released:
            raise LinkError(f"{self._name} was released; call control() first")
        return self._driver.lock()

    def _begin(self) -> None:
        self._driver.start()
        self.wait(lambda: self._task.follows_setpoints)

    def _come_to_rest(self) -> None:
        if (group := self._task.group) is not None:
            with self._driver.lock():
                group.rest_with(self._task)  # what this arm holds together with others rests before it is let go of
            self._wait_on_leaving(lambda: not group.carries(self._task))
        with self._driver.lock():
            self._task.stop()  # at rest it may still follow a frame that moves
        self._wait_on_leaving(lambda: not self._task.eventful)

    def _leave(self, power_off: bool) -> None:
        with self._driver.lock():
            self._task.leave(power_off)
        self._wait_on_leaving(lambda: self._task.left)

    def _tell_error(self) -> None:
        error = self._driver.error
        if error is not None and not self._error_told and not isinstance(error.__cause__, KeyboardInterrupt):
            self._error_told = True
            raise error

    def begin_stop(self) -> None:
        """Begin to come to rest, and with it what moves together with this arm; waits for nothing."""
        with suppress(QRobotError), self._driver.lock():
            self._task.begin_stop()

    def enter_block(self) -> None:
        """A `with` block of this thread holds the arm."""
        self._block_thread = threading.get_ident()

    def leaving_block(self, well: bool) -> AbstractContextManager[None]:
        """The block ends, `well` or not: by an error, and the arms of the blocks around it stop as this one does."""
        return stopping(well, self._stop_blocks)

    @classmethod
    def _stop_blocks(cls) -> None:
        stop_each([hold.begin_stop for hold in cls._holds if hold._block_thread == threading.get_ident()])

    def end(self, well: bool) -> None:
        """The program has ended: do its motions if it did so well, and release. Raises what those raise.

        When it has ended badly, or they cannot be done, no other arm goes on meanwhile.
        """
        with letting_go(lambda: self.release(power_off=False)), stopping(well):
            if well:
                self.finish()

    @classmethod
    def end_all(cls, well: bool) -> None:
        """`end` those of all arms, in the order they were taken.

        Raises the first error of a program that ended well, and Ctrl-C, once all arms are let go of.
        """
        failed: list[BaseException] = []
        for hold in list(cls._holds):
            try:
                hold.end(well and not failed)
            except BaseException as error:
                failed.append(error)
        raise_first(failed, well)

    def _at_exit(self) -> None:
        """The interpreter ends: well, unless something has been raised that nobody has handled."""
        try:
            self.end(well=interpreter_ends_well())
        except QRobotError as error:
            print(f"{self._name}: {error}", file=sys.stderr)


@at_bad_end
def _stop_all() -> None:
    stop_each([hold.begin_stop for hold in ArmSession._holds])


def ended_well(error: BaseException | None) -> bool:
    """True when a program ends, or a part of it, with no error: with an exit status of 0 as well."""
    return error is None or (isinstance(error, SystemExit) and not error.code)
