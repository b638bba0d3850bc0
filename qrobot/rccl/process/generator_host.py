"""The process of a trajectory generator: the task of one arm, its driver and its link, as its program orders them.

A thread answers the robot, as everywhere; another tells the program, and the process's own takes its orders. When the
program is gone the arm comes to a controlled stop on its path, is let go of, and the process ends.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterable
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection, wait
from typing import Any, Final

from qrobot.arrays import Floats
from qrobot.config import Robot
from qrobot.errors import LinkError, QRobotError
from qrobot.fences.fence_set import FenceSet
from qrobot.motion import Blend, MotionEvent, Output, PlannedPath
from qrobot.rccl.connect import compile_all
from qrobot.rccl.open_motions import OpenMotions, Placed
from qrobot.rccl.parameters import MoveOrder
from qrobot.rccl.process.carried import GeneratorEnd
from qrobot.rccl.process.reports import GeneratorReport, Happened, MotionProgress, OrderAnswer, Outbox, Seen
from qrobot.rccl.process.shared_values import GENERATOR, ValueCells, warm_up
from qrobot.rccl.setpoints import Setpoints
from qrobot.rccl.task import TrajectoryTask
from qrobot.rci.arm_settings import CarriedLoad
from qrobot.rci.client import Beside
from qrobot.rci.link import check_welcome
from qrobot.rci.process_main import portable
from qrobot.rci.tcp import SocketAddress, TcpLink
from qrobot.rci.thread_driver import ThreadDriver
from qrobot.realtime.deadline import Deadline
from qrobot.realtime.interpreter import prepare_interpreter
from qrobot.realtime.process_end import end_of_process
from qrobot.realtime.setup import lock_memory, pin_threads, tighten_timers
from qrobot.wire import Collision, Hello, Payload, RobotState, Signals, Welcome

FAREWELL_S: Final = 8.0  # [A] for an arm to come to rest, when its program is gone
TOLD_WORDS: Final = 8  # of the descriptor
SETTINGS: Final = frozenset({"override", "paused", "keeps_path", "way_back", "retract_m"})


@dataclass(frozen=True)
class GeneratorOptions:
    """Wishes of a program: an arm, how to greet its bridge and where that is, as `control` was told.

    Attributes:
        answer_s: how long the bridge may be silent.
        cpu: processor of this machine that it is kept on, None for any.
        fences: that the arm keeps off, None for none; those in force are the program's, and unknown to its processes.
    """

    robot: Robot
    hello: Hello
    address: SocketAddress
    answer_s: float
    clear_fault: bool
    blend: Blend
    cpu: int | None
    fences: FenceSet | None


class _ReportedMotions(OpenMotions):
    """Motions whose events are noted for the program, and whose updates are done here, at their instant."""

    def __init__(self, arm: Placed, number_of: Callable[[Any], int]) -> None:
        super().__init__(arm)
        self._number_of = number_of
        self.happened: list[Happened] = []
        self.progress: tuple[MotionProgress, ...] = ()

    def notify(self, events: Iterable[MotionEvent], q: Floats, tick: int) -> None:
        """See `OpenMotions.notify`."""
        events = list(events)
        for event in events:
            number = 0 if event.request is None else self._number_of(event.request)
            self.happened.append(Happened(event.kind, number, event.code, q, tick, event.why))
        super().notify(events, q, tick)

    def update_progress(self, output: Output) -> None:
        """See `OpenMotions.update_progress`."""
        both = ((output.request, output.scal), (output.passing, output.passing_scal))
        self.progress = tuple(
            MotionProgress(self._number_of(request), scal) for request, scal in both if request is not None
        )
        super().update_progress(output)


class _ReportedTask(TrajectoryTask):
    """A task that tells of each sample."""

    def __init__(self, host: GeneratorHost, options: GeneratorOptions, period_s: float) -> None:
        super().__init__(options.robot, period_s, options.clear_fault, options.blend, None, options.fences)
        self.reported = _ReportedMotions(self.motions.arm, host.ends.number_of)
        self.motions = self.reported
        self._host = host

    def step(self, state: Any, now_ns: int) -> Any:
        """See `TrajectoryTask.step`."""
        command = super().step(state, now_ns)
        happened, self.reported.happened = self.reported.happened, []
        progress, self.reported.progress = self.reported.progress, ()
        self._host.outbox.sample(self._host.seen(), happened, progress)
        return command

    def lost(self) -> None:
        """See `TrajectoryTask.lost`."""
        super().lost()
        error = self.td.error or LinkError("control of the arm was lost")
        self._host.outbox.fail(portable(error))


class GeneratorHost:
    """Carries out the orders of one program.

    Args:
        connection: to the program.
        values: memory of its transforms.
        program: number of its process.
    """

    def __init__(self, connection: Connection, values: ValueCells, program: int) -> None:
        self._connection = connection
        self._program = end_of_process(program)
        self.ends = GeneratorEnd(values)
        self.outbox = Outbox()
        self._task: _ReportedTask | None = None
        self._link: TcpLink | None = None
        self._driver: ThreadDriver | None = None
        self._told_again: dict[type, Signals | Collision] = {}
        self._load = CarriedLoad()
        self._teller = threading.Thread(target=self._tell, name="rccl-reports", daemon=True)

    def serve(self) -> None:
        """Carry out orders until the program closes the connection, or is gone: its children may keep that open."""
        self._teller.start()
        with suppress(EOFError, OSError):
            while self._connection in wait((self._connection, *self._program)):
                self._obey(self._connection.recv_bytes())
        self._farewell()
        self.outbox.close()

    def _obey(self, data: bytes) -> None:
        number, error, value = 0, None, None
        try:
            number, order, arguments = self.ends.loads(data)
            value = getattr(self, f"do_{order}")(*arguments)
        except Exception as raised:  # it belongs to the program
            error = portable(raised)
        if number or error is not None:
            with self._locked():
                self.outbox.answer(OrderAnswer(number, value, error), self.seen() if self._task is not None else None)

    def _locked(self) -> Any:
        return nullcontext() if self._driver is None else self._driver.lock()

    def _tell(self) -> None:
        with suppress(OSError):  # a program that has gone is noticed where its orders come from
            while (report := self.outbox.take()) is not None:
                self._connection.send_bytes(self._bytes_of(report))

    def _bytes_of(self, report: GeneratorReport) -> bytes:
        try:
            return self.ends.dumps(report)
        except Exception as error:  # of an answer, whose order gets it
            report.answers = [OrderAnswer(answer.order, None, portable(error)) for answer in report.answers]
            return self.ends.dumps(report)

    @property
    def task(self) -> _ReportedTask:
        """The task. Raises LinkError before `open`."""
        if self._task is None:
            raise LinkError("no arm is under control yet")
        return self._task

    @property
    def link(self) -> TcpLink:
        """The link. Raises LinkError before `open`."""
        if self._link is None:
            raise LinkError("no arm is under control yet")
        return self._link

    def seen(self) -> Seen:
        """The task as it is now; to be called with its lock held, or within its step."""
        task = self.task
        seen = Seen(
            task.tick, task.how, tuple(task.td.words[:TOLD_WORDS].tolist()), task.follows_setpoints, task.left,
            task.eventful, task.completed.count, "" if task.kept is None else str(task.kept), task.off_path,
            task.force.exerted, dict(self.link.refusals), task.chg.hand, task.chg.outputs,
        )  # fmt: skip
        try:
            generator = task.generator
        except LinkError:  # the arm does not hold yet
            return seen
        serving = generator.serving is not None
        return replace(seen, waiting=generator.waiting, serving=serving, stopping=generator.stopping, rate=task.rate)

    # ------------------------------------------------------------------------------------------- orders of the program

    def do_open(self, options: GeneratorOptions) -> Welcome:
        """Compile, connect and make the task; nothing moves yet. Raises what `control` raises."""
        if options.cpu is not None:
            pin_threads(options.cpu)
        lock_memory()
        tighten_timers()
        compile_all(options.robot, options.blend)
        if options.fences is not None:
            options.fences.compiled()
        warm_up()
        prepare_interpreter()
        link = TcpLink(options.hello, options.address, answer_s=options.answer_s)
        try:
            welcome = link.open()
            check_welcome(welcome, options.robot, "the program")
        except BaseException as error:
            link.close(str(error))
            raise
        self._link = link
        self._task = _ReportedTask(self, options, welcome.period_us * 1e-6)
        return welcome

    def do_start(self) -> None:
        """Answer the robot from now on."""
        self._driver = ThreadDriver(self.link, self.task, "rccl-trajectory", self._tell_again)
        self.task.timing.share = self._driver.share
        self._driver.start()

    def do_end(self) -> None:
        """Answer it no more."""
        if self._driver is not None:
            self._driver.end()

    def do_reopen(self, period_us: int) -> Welcome:
        """Greet the bridge anew. Raises what `Link.reopen` raises."""
        return self.link.reopen(period_us)

    def do_begin(self, period_s: float) -> None:
        """Take the arm anew."""
        self.task.begin(period_s)

    def do_tell(self, packet: Beside) -> None:
        """Send a packet beside the next command."""
        with self._locked():
            if isinstance(packet, Signals):
                self.do_tell_again(packet)
            self.link.tell(packet)

    def do_tell_again(self, packet: Signals | Collision) -> None:
        """Send it as well to a bridge that is greeted anew: nothing that was refused, nor what a stop has ended."""
        with self._locked():
            self._told_again[type(packet)] = packet

    def do_push(self, number: int, order: MoveOrder) -> None:
        """Queue a motion. Raises what `TrajectoryTask.push` raises."""
        with self._locked():
            self.ends.know(number, order.request)
            self.task.push(order)

    def do_play(self, setpoints: Setpoints, label: str) -> None:
        """Send setpoints as they are. Raises what `TrajectoryTask.play` raises."""
        with self._locked():
            self.task.play(setpoints, label)

    def do_plan(self) -> PlannedPath:
        """The path to rest. Raises what `Generator.copy` raises."""
        with self._locked():
            twin = self.task.generator.copy()
        return twin.run_to_rest()

    def do_stop(self, seconds: float) -> None:
        """See `TrajectoryTask.stop`."""
        with self._locked():
            self.task.stop(seconds)

    def do_resume(self) -> None:
        """See `TrajectoryTask.resume`."""
        with self._locked():
            self.task.resume()

    def do_skip(self, code: int) -> None:
        """See `Generator.skip`."""
        with self._locked():
            self.task.generator.skip(code)

    def do_leave(self, power_off: bool) -> None:
        """See `TrajectoryTask.leave`."""
        with self._locked():
            self.task.leave(power_off)

    def do_carry(self, load: Payload) -> None:
        """See `TrajectoryTask.carry`."""
        with self._locked():
            self._load.carry(load)
            self.task.carry(load)

    def do_set(self, name: str, value: object) -> None:
        """Set one of SETTINGS. Raises LinkError: it is none."""
        if name not in SETTINGS:
            raise LinkError(f"{name!r} cannot be set in a generator's process")
        with self._locked():
            setattr(self.task, name, value)

    def do_change(self, fields: dict[str, Any]) -> None:
        """Set fields of `chg`."""
        with self._locked():
            for name, value in fields.items():
                setattr(self.task.chg, name, value)

    def do_part(self, numbers: list[int]) -> None:
        """See `GeneratorEnd.part`."""
        with self._locked():
            self.ends.part(numbers)

    # ---------------------------------------------------------------------------------------------------------- inside

    def _tell_again(self, now: RobotState, forgotten: bool) -> None:
        """See `ArmSettings.tell_again`."""
        load = self._load.lost(self.task.how, now) if forgotten else None
        told = [packet for packet in self._told_again.values() if forgotten or isinstance(packet, Signals)]
        for packet in (*told, *(() if load is None else (load,))):
            self.link.tell(packet)

    def _farewell(self) -> None:
        """Bring the arm to a controlled stop and let go of it, if it is held."""
        if self._driver is None or self._task is None or self._task.left or self._driver.error is not None:
            return
        task, driver, deadline = self._task, self._driver, Deadline(FAREWELL_S)
        with suppress(QRobotError):
            with driver.lock():
                task.stop()
            driver.wait(lambda: not task.eventful or deadline.left_s <= 0.0)
            with driver.lock():
                task.leave(power_off=False)
            driver.wait(lambda: task.left or deadline.left_s <= 0.0)
        driver.end()


def run(channel: int, memory: int, program: int) -> None:
    """Be the process of a generator, for the process `program` at the other end of the descriptor `channel`."""
    for number in (signal.SIGINT, signal.SIGHUP):  # the terminal's are the program's, which ends us in good order
        signal.signal(number, signal.SIG_IGN)
    GeneratorHost(Connection(channel), ValueCells(GENERATOR, memory), program).serve()
    os._exit(0)  # no thread of ours has anything left to do
