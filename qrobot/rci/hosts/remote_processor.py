"""The planning program's end of a processor on another host: start it, give it orders, notice its silence."""

from __future__ import annotations

import logging
import os
import secrets
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from qrobot.errors import ConfigError, LinkBusy, LinkError, LinkLost, QRobotError, RemoteProtocolError
from qrobot.rci.descriptor import TaskDescriptor, TaskState, TaskWord
from qrobot.rci.environment import tcp_links
from qrobot.rci.host_thread import nothing_left, refuse_start
from qrobot.rci.hosts.functions import name_of, names_of
from qrobot.rci.hosts.mail import Letterbox, collected
from qrobot.rci.hosts.packets import (
    PROTOCOL,
    AllowedTime,
    BootPacket,
    EndPacket,
    ExchangePacket,
    HelloPacket,
    HostReply,
    HostReport,
    HostRequest,
    Mail,
    Offer,
    OrderPacket,
    RobotEntry,
    TaskEntry,
    error_of,
    how_of,
)
from qrobot.rci.hosts.session import ask, ask_later, connecting, open_session
from qrobot.rci.hosts.settings import KnownHost, find_host, known_hosts
from qrobot.rci.processor_image import ProcessorImage, TaskRecord
from qrobot.rci.processor_names import ProcessorInfo, host_name_of
from qrobot.rci.task_runner import ControlFunctions
from qrobot.rci.task_table import ALL, TaskTable, signal_parent
from qrobot.realtime.bridge_token import token_of_file

EXCHANGE_S: Final = 0.005  # [A] between two exchanges
BRISK_S: Final = 0.001  # [A] behind one that carried messages: an answer may follow
SILENCE_S: Final = 1.0  # [A] after which a host is given up; it gives its program up as soon
ORDER_S: Final = 10.0  # start-up functions and bridges that are slow to answer
FRESH_S: Final = 4.0  # in which a host that has ended one program is there for the next
TIMES_ASKED: Final = 8  # for the time by its clock
_RETRY_S: Final = 0.1
_RETURNED: Final = (
    TaskWord.STATE,
    TaskWord.WOKEN,
    TaskWord.SERVED,
    TaskWord.RUNS,
    TaskWord.MISSED,
    TaskWord.LONGEST_NS,
)
_log = logging.getLogger(__name__)


class RemoteProcessor:
    """One processor of a program, on another host.

    Args:
        name: "host:lab2", where QROBOT_HOSTS names a file that knows lab2.
        happened: called when one of its tasks, or itself, has ended.

    Raises:
        ConfigError: there is no such host, or the extra `hosts` is missing. LinkBusy: another program has it.
        LinkLost, LinkTimeout: it does not answer.
    """

    def __init__(self, name: str, happened: Callable[[], object]) -> None:
        self.name, self.cpu, self._happened = name, None, happened
        self._host = find_host(host_name_of(name))
        self._session = _patiently_opened(self._host)
        self._token = secrets.token_hex(16)
        self._tds: dict[int, TaskDescriptor] = {}
        self._waiting: list[OrderPacket] = []
        self._table = TaskTable(time.monotonic_ns)
        self._letterbox = Letterbox({}, set(), time.monotonic_ns)
        self._has_room = True
        self._pause_s = EXCHANGE_S
        self._talking = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._talk, name=f"rci-{name}", daemon=True)
        self._booted = False
        self._dead = ""  # why it can do nothing any more
        try:
            self._check_free()
        except BaseException:
            self._session.close()
            raise

    def _check_free(self) -> None:
        offer = greet(self._session, self._host)
        if offer.program:
            raise LinkBusy(f"host {self._host.name} runs program {offer.program}, and one at a time")

    # --------------------------------------------------------------------------------------------------------- orders

    def order(self, order: str, *arguments: Any) -> None:
        """Let its monitor do something, and wait until it has; before it runs, when it does. Raises what it raises."""
        self.begin(order, *arguments)()

    def begin(self, order: str, *arguments: Any) -> Callable[[], object]:
        """See `Processors.begin`."""
        if order == "add":
            self._tds[arguments[0].bit] = arguments[0]
            return nothing_left
        packet = self._packet(order, arguments)
        if order == "attach":
            for bit, td in self._tds.items():
                if bit & arguments[0]:
                    td.begin()
        if not self._booted:
            self._waiting.append(packet)
        elif self._dead:
            refuse_start(order, self._dead)
        else:
            self._send_waiting()
            return self._carry_out(packet)
        return nothing_left

    def _send_waiting(self) -> None:
        """Give the orders that have waited for the host: after Ctrl-C at its start, those that are left."""
        while self._waiting and not self._dead:
            self._carry_out(self._waiting.pop(0))()

    def _packet(self, order: str, arguments: tuple[Any, ...]) -> OrderPacket:
        """An order as it travels. Raises ConfigError for one that another host cannot carry out."""
        where = f"processor {self.name}"
        if order == "set_device":
            raise ConfigError(
                f"{where}: a device belongs to one host; let a task there look for it by rci_onfunction()"
            )
        numbers = [int(each) for each in arguments if isinstance(each, int)]
        named: list[str] = []
        for each in arguments:
            if isinstance(each, ControlFunctions):
                named += names_of(each, where)
            elif not isinstance(each, int):
                named.append(name_of(each, where))
        return OrderPacket(session=self._token, order=order, numbers=numbers, functions=named)  # type: ignore[arg-type]

    def _carry_out(self, packet: OrderPacket) -> Callable[[], object]:
        """Send an order; gives what waits for its answer, and raises that."""
        try:
            reply = ask_later(self._session, self._host, "orders", packet, ORDER_S)
        except (LinkError, RemoteProtocolError) as error:
            self._bury(error)
            return nothing_left
        return lambda: self._take_answer(reply)

    def _take_answer(self, answer: Callable[[], HostReply]) -> None:
        try:
            reply = answer()
            self._exchange()  # what the order has made of the tasks is known when it returns
        except (LinkError, RemoteProtocolError) as error:
            self._bury(error)
            return
        if reply.error is not None:
            raise error_of(reply.error, self._host.name)

    def _ask(self, what: str, request: HostRequest, patience_s: float) -> HostReply:
        return ask(self._session, self._host, what, request, patience_s)

    # ---------------------------------------------------------------------------------------------------------- start

    def boot(self, image: ProcessorImage) -> None:
        """Let the host have its tasks, once. Raises ConfigError for what cannot go there, LinkBusy."""
        if self._booted:
            return
        self._check_image(image)
        for record in image.tasks:
            self._table.add(TaskDescriptor(record.name, record.bit, record.processor, record.area.words))
        here = {td.bit: td for td in self._table.of(ALL, "tasks") if td.processor != self.name}
        self._letterbox = Letterbox(here, set(self._tds), time.monotonic_ns)
        reply = self._ask("orders", self._boot_packet(image), ORDER_S)
        if reply.error is not None:
            raise error_of(reply.error, self._host.name)
        self._booted = True
        self._thread.start()
        self._send_waiting()

    def _boot_packet(self, image: ProcessorImage) -> BootPacket:
        tasks = [_task_entry(record, self.name) for record in image.tasks]
        return BootPacket(
            session=self._token,
            token="" if self._host.tls is not None else token_of_file(*self._host.address).decode("ascii", "replace"),
            program=(Path(sys.argv[0] or "python").name or "python")[:200],
            processor=self.name,
            rate_hz=image.rate_hz,
            epoch_ns=image.epoch_ns + self._clock_ahead_ns(),
            tasks=tasks,
        )

    def _check_image(self, image: ProcessorImage) -> None:
        if image.environment.links is not tcp_links:
            raise ConfigError(f"processor {self.name} reaches robots by their bridges alone")
        bits = sum(self._tds)
        for area in image.areas:
            shared = area.access & ALL == ALL and area.variable is None  # with all tasks that can reach it
            if area.access & bits and not shared:
                raise ConfigError(f"shared memory {area.label!r} {no_shared_memory(self._host.name)}")

    def _clock_ahead_ns(self) -> int:
        """Lead of the host's clock, ns: of several questions the quickest tells best."""
        found: list[tuple[int, int]] = []
        for _ in range(TIMES_ASKED):
            before = time.monotonic_ns()
            there = greet(self._session, self._host).now_ns
            after = time.monotonic_ns()
            found.append((after - before, there - (before + after) // 2))
        return min(found)[1]

    # ------------------------------------------------------------------------------------------------------ exchanges

    def _talk(self) -> None:
        while not self._over.wait(self._pause_s) and not self._dead:
            try:
                self._exchange()
            except (LinkError, RemoteProtocolError) as error:
                self._bury(error)
            except Exception as error:  # whatever it is, nobody else would tell the program
                _log.exception("the exchange with host %s failed", self._host.name)
                self._bury(error)

    def _exchange(self) -> None:
        """Give the host its messages, and take what it has to tell. Raises LinkError, RemoteProtocolError."""
        with self._talking:
            mail: list[Mail] = collected(self._table, self._tds.values()) if self._has_room else []
            allowed = [AllowedTime(bit=bit, ns=int(td.words[TaskWord.ALLOWED_NS])) for bit, td in self._tds.items()]
            packet = ExchangePacket(session=self._token, mail=mail, room=self._letterbox.room, allowed=allowed)
            reply = self._ask("exchanges", packet, SILENCE_S)
            if reply.error is not None:
                raise LinkLost(f"host {self._host.name}: {reply.error.text}")
            if reply.report is None:
                raise RemoteProtocolError(f"host {self._host.name} answers without a report")
            self._pause_s = BRISK_S if mail or reply.report.mail else EXCHANGE_S
            self._take(reply.report)

    def _take(self, report: HostReport) -> None:
        self._has_room = report.room
        self._letterbox.take(report.mail)
        for task in report.tasks:
            td = self._tds.get(task.bit)
            if td is None:
                raise RemoteProtocolError(f"host {self._host.name} tells of a task {task.bit:#x} that is not there")
            if task.starts != td.starts:
                continue  # it was started again since
            if task.how is not None:
                td.how = how_of(task.how, 0 if td.robot is None else td.robot.n)
            if task.error is not None and td.error is None:
                td.error = error_of(task.error, self._host.name)
                self._happened()
            for word, value in zip(_RETURNED, task.words, strict=True):
                td.words[word] = value
        for number in report.signals:
            with suppress(ConfigError):  # the host knows not what the program catches
                signal_parent(os.getpid(), number)

    def end_rogues(self, _now_ns: int) -> None:
        """Its own host ends what takes too long."""

    def _bury(self, why: Exception) -> None:
        """Tell of every task that ran there."""
        if self._dead:
            return
        self._dead = f"{why}; the host stops the robots of its tasks, or their bridges do"
        for td in self._tds.values():
            if td.state is not TaskState.RELEASED and td.error is None:
                td.error = LinkLost(f"processor {self.name} is lost: {self._dead}")
                td.words[TaskWord.STATE] = TaskState.ENDED
        self._happened()

    def close(self) -> None:
        """Let the host go."""
        self._over.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._booted and not self._dead:
            with suppress(LinkError, RemoteProtocolError):
                self._ask("orders", EndPacket(session=self._token), ORDER_S)
        self._session.close()


def no_shared_memory(host: str) -> str:
    """Refusal of memory for a task on another host, which says what to use."""
    return (
        f"does not reach tasks on host {host}: send them messages (rci_send, rci_receive), or name in its mask the "
        "tasks of this machine alone"
    )


def _task_entry(record: TaskRecord, processor: str) -> TaskEntry:
    robot = None
    if record.robot is not None and record.processor == processor:
        file = record.robot.file
        if not file.replace("-", "_").isidentifier():
            raise ConfigError(f"task {record.name}: another host has the packaged robots alone, not {file}")
        robot = RobotEntry(name=record.robot.name, file=file, bridge=record.robot.bridge)
    return TaskEntry(
        name=record.name, bit=record.bit, processor=record.processor, priority=record.priority, robot=robot
    )


def greet(session: Any, host: KnownHost) -> Offer:
    """Ask a host who it is. Raises LinkTimeout, RemoteProtocolError for another host or another version."""
    reply = ask(session, host, "orders", HelloPacket(), SILENCE_S)
    offer = reply.offer
    if reply.error is not None or offer is None:
        raise RemoteProtocolError(f"host {host.name}: {reply.error.text if reply.error else 'no offer'}")
    if (offer.protocol, offer.host) != (PROTOCOL, host.name):
        raise RemoteProtocolError(
            f"host {host.name} at {host.endpoint} is {offer.host} with protocol {offer.protocol}; {PROTOCOL} is needed"
        )
    return offer


def _patiently_opened(host: KnownHost) -> Any:
    """A session with a host, also when it has just ended another program and starts afresh."""
    until = time.monotonic() + FRESH_S
    while True:
        try:
            return open_session(connecting(host), f"host {host.name} at {host.endpoint} cannot be reached")
        except LinkLost:
            if time.monotonic() > until:
                raise
            time.sleep(_RETRY_S)


def host_processors() -> list[ProcessorInfo]:
    """Processors on the hosts that QROBOT_HOSTS names, asked one after the other. Raises ConfigError."""
    return [_info(host) for host in known_hosts().values()]


def _info(host: KnownHost) -> ProcessorInfo:
    name, what = f"host:{host.name}", f"another host, at {host.endpoint}"
    try:
        session: Any = open_session(connecting(host), f"host {host.name} cannot be reached")
        try:
            offer = greet(session, host)
        finally:
            session.close()
    except QRobotError as error:
        return ProcessorInfo(name, what, False, str(error))
    busy = f"it runs program {offer.program}" if offer.program else ""
    return ProcessorInfo(name, f"{what}: {offer.description}", not busy, busy)
