"""The tasks of a program that run on this host, by the orders of the program on another."""

from __future__ import annotations

import os
import signal
import time
from typing import Any, Final

from qrobot.errors import ConfigError, RemoteProtocolError
from qrobot.rci import calls
from qrobot.rci.common_clock import CommonClock
from qrobot.rci.descriptor import TaskDescriptor, TaskWord, local_area
from qrobot.rci.environment import Environment, link_maker
from qrobot.rci.host_thread import HostThread
from qrobot.rci.hosts.functions import function_named
from qrobot.rci.hosts.mail import Letterbox, collected
from qrobot.rci.hosts.packets import (
    BootPacket,
    ExchangePacket,
    HostReport,
    OrderPacket,
    TaskEntry,
    TaskReport,
    failure_of,
    sample_of,
)
from qrobot.rci.hosts.remote_processor import no_shared_memory
from qrobot.rci.robot_data import KnownRobot
from qrobot.rci.task_runner import ControlFunctions
from qrobot.rci.task_table import Bytes, SharedProgram, TaskTable

FORWARDED: Final = (signal.SIGUSR1, signal.SIGUSR2)  # of tasks to their planning program
_SHAPES: Final = {  # of each order: numbers and functions
    "set_functions": (1, 3),
    "set_clock": (3, 0),
    "set_wakeup": (1, 1),
    "set_trigger": (3, 1),
    "attach": (1, 0),
    "activate": (2, 0),
    "release": (2, 0),
    "power_off": (1, 0),
}


class RemoteTable(TaskTable):
    """Table of tasks on this host: they share messages with those of another, and no memory."""

    host = ""

    def memory(self, label: str, td: TaskDescriptor) -> Bytes:
        """Refused by a ConfigError that says what to use."""
        raise ConfigError(f"task {td.name}: shared memory {label!r} {no_shared_memory(self.host)}")


class HostedProgram:
    """One program's tasks on this host.

    Args:
        boot: what the program said of itself.
        host: name of this host.
        modules: of which it may name functions.

    Raises:
        ConfigError: a robot that this host has not. RemoteProtocolError: tasks that cannot be.
    """

    def __init__(self, boot: BootPacket, host: str, modules: tuple[str, ...]) -> None:
        self.name, self.session = boot.program, boot.session
        self._modules = modules
        self._signals: list[int] = []
        clock = CommonClock(time.monotonic_ns, boot.rate_hz, boot.epoch_ns)
        self._table = RemoteTable(time.monotonic_ns)
        self._table.host = host
        self._tds: dict[int, TaskDescriptor] = {}
        self._others: dict[int, TaskDescriptor] = {}
        known = [self._take_task(entry, boot.processor) for entry in boot.tasks]
        self._letterbox = Letterbox(self._tds, set(self._others), time.monotonic_ns)
        self._thread = HostThread(boot.processor, clock, lambda: None)
        for td, robot in known:
            if td.bit in self._tds:
                self._thread.order("add", td, link_maker(Environment(), robot, td.robot))
        parent = self._table.find("parent")
        calls.be_processor(SharedProgram(self._table, parent, lambda: clock.ticks, os.getpid()))

    def _take_task(self, entry: TaskEntry, processor: str) -> tuple[TaskDescriptor, KnownRobot | None]:
        if self._table.knows(entry.name) or entry.bit.bit_count() != 1 or entry.bit in {**self._tds, **self._others}:
            raise RemoteProtocolError(f"task {entry.name!r} with bit {entry.bit:#x} is there already, or cannot be")
        robot = None if entry.robot is None else KnownRobot(entry.robot.name, entry.robot.file, entry.robot.bridge)
        data = None if robot is None else robot.data()
        td = TaskDescriptor(entry.name, entry.bit, entry.processor, local_area(), data, entry.priority)
        self._table.add(td)
        (self._tds if entry.processor == processor else self._others)[td.bit] = td
        return td, robot

    def note_signal(self, number: int) -> None:
        """A task wants to interrupt the planning program."""
        self._signals.append(number)

    def obey(self, packet: OrderPacket) -> None:
        """Carry out an order. Raises what it raises."""
        if (len(packet.numbers), len(packet.functions)) != _SHAPES[packet.order] or packet.numbers[0] < 0:
            raise RemoteProtocolError(f"order {packet.order} with {packet.numbers} and {packet.functions}")
        one = packet.order.startswith("set_")
        if (packet.numbers[0] not in self._tds) if one else (packet.numbers[0] & ~sum(self._tds)):
            raise RemoteProtocolError(f"order {packet.order} for tasks {packet.numbers[0]:#x}, which are not here")
        functions: list[Any] = [function_named(name, self._modules) for name in packet.functions]
        if packet.order == "set_functions":
            functions = [ControlFunctions(*functions)]
        self._thread.order(packet.order, *packet.numbers, *functions)

    def exchange(self, packet: ExchangePacket) -> HostReport:
        """Take messages, tell what has happened. Raises RemoteProtocolError."""
        for allowed in packet.allowed:
            if allowed.bit not in self._tds:
                raise RemoteProtocolError(f"a time for task {allowed.bit:#x}, which is not here")
            self._tds[allowed.bit].words[TaskWord.ALLOWED_NS] = allowed.ns
        self._letterbox.take(packet.mail)
        mail = collected(self._table, self._others.values()) if packet.room else []
        told, self._signals = self._signals[:64], self._signals[64:]
        reports = [_report(td) for td in self._tds.values()]
        return HostReport(mail=mail, room=self._letterbox.room, tasks=reports, signals=told)

    def look_after(self) -> None:
        """End rogues."""
        self._thread.end_rogues(time.monotonic_ns())

    def farewell(self) -> None:
        """Bring all robots to a controlled stop, and end."""
        self._thread.farewell(self._tds.values())


def _report(td: TaskDescriptor) -> TaskReport:
    state = int(td.words[TaskWord.STATE])  # first: an error is there before its end is
    words = [int(td.words[k]) for k in (TaskWord.WOKEN, TaskWord.SERVED, TaskWord.RUNS, TaskWord.MISSED)]
    error, heard = td.error, td.heard
    return TaskReport(
        bit=td.bit,
        starts=td.starts,
        words=[state, *words, int(td.words[TaskWord.LONGEST_NS])],
        error=None if error is None else failure_of(error),
        how=None if heard is None else sample_of(heard),
    )
