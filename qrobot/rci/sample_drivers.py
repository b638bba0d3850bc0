"""Drivers of a task that answers each STATE of one robot: a thread paced by the robot, or the program while it waits.

The same program runs under both. In real time samples pass by themselves; on virtual time they pass when the program
waits, in the order of `program_time`, so a run is the same every time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from qrobot.errors import MotionError
from qrobot.rci.link import Link
from qrobot.rci.program_time import NO_WAIT, program_time
from qrobot.rci.sampled_task import SampleDriver, SampledTask
from qrobot.rci.thread_driver import ThreadDriver, in_sample_thread
from qrobot.rci.virtual_driver import VirtualDriver
from qrobot.wire import RobotState


def driver_for(
    link: Link,
    task: SampledTask,
    name: str,
    tell_again: Callable[[RobotState, bool], object] = lambda _now, _forgotten: None,
    lock: threading.Condition | None = None,
    before: SampleDriver | None = None,
) -> SampleDriver:
    """The driver that suits the link's time.

    Args:
        link: open.
        task: to run.
        name: of its thread.
        tell_again: called with the first sample behind a time in which the link was lost, or the servo away; True when
            the bridge was greeted anew, or the servo is another one, so that what they were told is forgotten. The
            sample that was heard before is still the newest that `task` knows.
        lock: that it shares with others; by default it has one of its own.
        before: the driver of the same arm that has ended, whose place among all that run at an instant it takes.
    """
    if not link.virtual_time:
        return ThreadDriver(link, task, name, tell_again, lock)
    return VirtualDriver(link, task, tell_again, before.rank if isinstance(before, VirtualDriver) else None)


def refuse_at_samples() -> None:
    """Raise MotionError in a function that is called at a sample: what follows waits, and it must not."""
    if in_sample_thread() or program_time().passing:
        raise MotionError(NO_WAIT)
