"""A processor in a process of its own: what the process does from its start to its end.

It is started from the program's image, as the papers' auxiliaries are: the same modules, in which it finds the tasks'
functions by name. Tasks run in one thread; another one takes the planning program's orders. When the planning program
is gone, its tasks are released and the process ends.
"""

from __future__ import annotations

import importlib
import os
import pickle
import signal
import time
from multiprocessing.connection import Connection, wait
from typing import Any

import numpy as np

from qrobot.errors import QRobotError
from qrobot.rci import calls
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.descriptor import TaskDescriptor
from qrobot.rci.environment import link_maker
from qrobot.rci.host_thread import WATCH_S, HostThread
from qrobot.rci.processor_image import AreaRecord, ProcessorImage, TaskRecord
from qrobot.rci.task_table import SharedArea, SharedProgram, TaskTable
from qrobot.realtime.process_end import end_of_process
from qrobot.realtime.setup import lock_memory, pin_threads, tighten_timers


def run_processor(image: ProcessorImage, orders: Connection, events: Connection) -> None:
    """Be a processor until the planning program closes it, or is gone."""
    for number in (signal.SIGINT, signal.SIGHUP):  # the terminal's are the program's, which ends us in good order
        signal.signal(number, signal.SIG_IGN)
    if image.cpu is not None:
        pin_threads(image.cpu)
    lock_memory()
    tighten_timers()
    AuxiliaryProcessor(image, events).obey(orders)


class AuxiliaryProcessor:
    """One processor in its process."""

    def __init__(self, image: ProcessorImage, events: Connection) -> None:
        self._events = events
        self._program = end_of_process(image.parent_pid)
        self._told: dict[int, int] = {}  # of which start the end was told
        clock = CommonClock(time.monotonic_ns, image.rate_hz, image.epoch_ns)
        self._table = TaskTable(time.monotonic_ns)
        self._host = HostThread(image.name, clock, lambda: None)
        self._tds: list[TaskDescriptor] = []
        for record in image.tasks:
            self._take_task(record, image)
        for area in image.areas:
            self._take_area(area)
        parent = self._table.find("parent")
        calls.be_processor(SharedProgram(self._table, parent, lambda: clock.ticks, image.parent_pid))

    def _take_task(self, record: TaskRecord, image: ProcessorImage) -> None:
        words = record.area.words
        td = TaskDescriptor(record.name, record.bit, record.processor, words, record.data, record.priority)
        self._table.add(td)
        if record.processor == image.name:
            self._tds.append(td)
            if record.data is not None and record.data.fences is not None:
                record.data.fences.compiled()
            self._host.order("add", td, link_maker(image.environment, record.robot, record.data))

    def _take_area(self, record: AreaRecord) -> None:
        memory = record.area.words.view(np.uint8)[: record.size]
        self._table.share(SharedArea(record.label, memory, record.access))
        if record.variable is not None and any(td.bit & record.access for td in self._tds):
            module, name, dtype, shape = record.variable
            setattr(importlib.import_module(module), name, memory.view(np.dtype(dtype)).reshape(shape))

    def obey(self, orders: Connection) -> None:
        """Carry out orders, and look after the tasks, until there is nobody to give any."""
        try:
            while self._look_after() and self._take_order(orders):
                pass
        except (EOFError, OSError):
            self._host.farewell(self._tds)
        os._exit(0)  # the thread of a task that never comes back would keep us

    def _take_order(self, orders: Connection) -> bool:
        ready = wait((orders, *self._program), WATCH_S)
        if not ready:
            return True
        if orders not in ready:
            raise EOFError  # a child of the program, which has ended, keeps the orders open
        number, order, arguments = orders.recv()
        if order == "end":
            return False
        orders.send((number, _outcome(self._host, order, arguments)))
        return True

    def _look_after(self) -> bool:
        """End rogues, tell of tasks that have ended; false when no task runs here any more."""
        self._host.end_rogues(time.monotonic_ns())
        for td in self._tds:
            error = td.error
            if error is not None and self._told.get(td.bit) != td.starts:
                self._told[td.bit] = td.starts
                self._events.send((td.bit, td.starts, portable(error)))
        return not self._host.hung


def _outcome(host: HostThread, order: str, arguments: Any) -> BaseException | None:
    try:
        host.order(order, *arguments)
    except Exception as error:
        return portable(error)
    return None


def portable(error: BaseException) -> BaseException:
    """An exception that another process can make again; one that it cannot becomes text."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return QRobotError(f"{type(error).__name__}: {error}")
    return error
