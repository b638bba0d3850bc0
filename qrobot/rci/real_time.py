"""The processors of a program in real time, and the watch over tasks that run too long."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from qrobot.arrays import Words
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.compiled_thread import CompiledThread
from qrobot.rci.descriptor import HOST
from qrobot.rci.environment import Environment
from qrobot.rci.host_thread import WATCH_S, HostThread
from qrobot.rci.mapped_area import MappedArea
from qrobot.rci.process_processor import ProcessProcessor
from qrobot.rci.processor_image import AreaRecord, KnownArea, KnownTask, ProcessorImage, TaskNumbers, TaskRecord
from qrobot.rci.processor_names import is_compiled, is_remote
from qrobot.rci.task_runner import check_may_wait
from qrobot.rci.task_table import Bytes

if TYPE_CHECKING:
    from qrobot.rci.hosts.remote_processor import RemoteProcessor

START_LEAD_S: Final = 0.01  # [A] in which every processor hears that its tasks are to begin at one tick
_log = logging.getLogger(__name__)
_LOOK_S: Final = 0.002  # a waiting program looks up so often


class RealTimeProcessors:
    """Runs the tasks of a program by the monotonic clock.

    Attributes:
        clock: the common clock, which begins with the program.
    """

    def __init__(self) -> None:
        self.clock = CommonClock(time.monotonic_ns, epoch_ns=time.monotonic_ns())
        self._processors: dict[str, HostThread | CompiledThread | ProcessProcessor | RemoteProcessor] = {}
        self._areas: dict[int, MappedArea] = {}  # by the address of their words
        self._numbers = TaskNumbers()
        self._happened = threading.Event()
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._watch_tasks, name="rci-watch", daemon=True)

    def stamp(self) -> int:
        """A number for each message, in their order."""
        return time.monotonic_ns()

    @property
    def start_lead(self) -> int:
        """Ticks from now to the first at which tasks that are activated together run."""
        return 1 + round(START_LEAD_S * self.clock.rate_hz)

    @property
    def ticks(self) -> int:
        """The newest tick."""
        return self.clock.ticks

    def add(self, processor: str) -> None:
        """Have a processor of that name. Raises ConfigError when there is none."""
        if processor not in self._processors:
            self._processors[processor] = self._new(processor)
        if not self._watch.is_alive():
            self._watch.start()

    def _new(self, processor: str) -> HostThread | CompiledThread | ProcessProcessor | RemoteProcessor:
        happened = self._happened.set
        if processor == HOST:
            return HostThread(processor, self.clock, happened)
        if is_compiled(processor):
            return CompiledThread(processor, self.clock, self._numbers.of, happened)
        if is_remote(processor):
            from qrobot.rci.hosts.remote_processor import RemoteProcessor

            return RemoteProcessor(processor, happened)
        return ProcessProcessor(processor, happened)

    def order(self, processor: str, order: str, *arguments: object) -> None:
        """Let the monitor of a processor do something, and wait until it has. Raises what it raises."""
        self.begin(processor, order, *arguments)()

    def begin(self, processor: str, order: str, *arguments: object) -> Callable[[], object]:
        """See `Processors.begin`."""
        return self._processors[processor].begin(order, *arguments)

    def words(self, n: int) -> Words:
        """Zeroed memory that all processors reach."""
        area = MappedArea(n)
        self._areas[area.words.ctypes.data] = area
        return area.words

    def seal(self, tasks: list[KnownTask], areas: list[KnownArea], environment: Environment) -> None:
        """Start the processors that are processes, or on other hosts, now that all tasks and memory are known."""
        self._numbers.know(areas)
        records = [
            TaskRecord(td.name, td.bit, td.processor, td.priority, self._area_of(td.words), robot, td.robot)
            for td, robot in tasks
        ]
        regions = [
            AreaRecord(a.area.label, a.area.memory.nbytes, a.area.access, self._area_of(a.area.memory), a.variable)
            for a in areas
        ]
        rate_hz, epoch_ns = self.clock.rate_hz, self.clock.epoch_ns
        for processor in self._processors.values():
            if not isinstance(processor, HostThread | CompiledThread):
                processor.boot(
                    ProcessorImage(
                        processor.name, processor.cpu, rate_hz, epoch_ns, os.getpid(), records, regions, environment
                    )
                )

    def _area_of(self, words: Words | Bytes) -> MappedArea:
        return self._areas[words.ctypes.data]

    def wait(self, predicate: Callable[[], object], look: Callable[[], object]) -> None:
        """Return when `predicate` is true, calling `look` as time passes. Raises what they raise."""
        check_may_wait()
        while not predicate():
            self._happened.wait(_LOOK_S)
            self._happened.clear()
            look()

    def close(self) -> None:
        """End them."""
        self._over.set()
        if self._watch.is_alive():
            self._watch.join()
        for processor in self._processors.values():
            processor.close()
        for area in self._areas.values():
            area.close()

    def _watch_tasks(self) -> None:
        """End what takes longer than it is allowed."""
        while not self._over.wait(WATCH_S):
            for name, processor in list(self._processors.items()):
                try:
                    processor.end_rogues(self.clock.now_ns())
                except Exception:  # one processor that cannot be looked at leaves no other without a watch
                    _log.exception("the watch over processor %s failed, and looks again", name)
