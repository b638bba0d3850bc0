"""The processes of one deployment: started in order, watched, ended in order.

Order matters: the board must exist before the servo, the servo before its guardian and the bridge. They get ready at
the same time, forked by a process that has imported their libraries, and begin one after the other. At the end the
servo goes while board and guardian still live, so that it can make a controlled stop; processes whose supervisor was
killed keep that order by themselves. Every process is a session of its own: a Ctrl-C at the terminal reaches only the
supervisor, which ends the rest.
"""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import IO

from qrobot.errors import LinkBusy, LinkError, LinkTimeout, QRobotError
from qrobot.hwif.board_memory import attach_board_memory
from qrobot.realtime.compile_progress import COMPILING
from qrobot.realtime.file_lock import lock_alone
from qrobot.realtime.shared_memory import SharedMemory, discard_dead
from qrobot.realtime.signals import signal_name
from qrobot.realtime.startup_order import TURN_VARIABLE
from qrobot.realtime.supervised import SUPERVISOR_VARIABLE, Supervision
from qrobot.report import Report
from qrobot.rig.interrupts import interrupted_by_signals, interrupts_deferred, interrupts_ignored
from qrobot.rig.process_starter import ProcessStarter, Started
from qrobot.servo.memory.servo_memory import PLACE_LAYOUT, ServoFront, attach_servo_memory, guardian_place

START_PATIENCE_S = 400.0  # a first start compiles everything, perhaps on a busy machine
STOP_PATIENCE_S = 6.0
POLL_S = 0.02


@dataclass(frozen=True)
class ProcessPlan:
    """A process to be started.

    Attributes:
        name: of the process in its rig.
        arguments: of the `qrobot` command.
        ready: whether the process of an id does its work, with 0 whether any does; waited for. None may do it before.
        rank: the higher, the sooner it ends; below `supervised.RANKS`.
        restarts: how often a minute it is started again when it ends by itself; 0: then the others are ended too.
        vital: the others are ended when it has ended more often than that; else they go on without it.
    """

    name: str
    arguments: Sequence[str]
    ready: Callable[[int], bool] | None = None
    rank: int = 0
    restarts: int = 0
    vital: bool = True


@dataclass
class Child:
    """One supervised process."""

    plan: ProcessPlan
    process: Started
    output: Path
    turn: IO[bytes]
    killed: bool = field(default=False)

    @property
    def name(self) -> str:
        """Name of the process in its rig."""
        return self.plan.name

    @property
    def alive(self) -> bool:
        """True while the process runs."""
        return self.process.poll() is None

    def complaint(self) -> str:
        """Signal that has killed it, else the last line it printed, for an error message; what it compiled is none."""
        last = self._last_line()
        status = self.process.poll()
        if status is None or status >= 0:
            return last or "it said nothing"
        killed = f"it was killed by {signal_name(-status)}"
        return killed if status == -signal.SIGKILL or not last else f"{killed}; {last}"

    def _last_line(self) -> str:
        return next((line for line in reversed(self._lines()) if not line.startswith(COMPILING)), "")

    def compiling(self) -> str:
        """Line about what it compiles, if that is what it said last; else nothing."""
        last = next(reversed(self._lines()), "")
        return last if last.startswith(COMPILING) else ""

    def _lines(self) -> list[str]:
        """Lines that it printed; none where they cannot be read."""
        with contextlib.suppress(OSError):
            lines = self.output.read_text(errors="replace").splitlines()
            return [line.removeprefix("qrobot: ") for line in lines if line.strip()]
        return []

    def begin(self) -> None:
        """Let it go on, once it is ready, to what others can see."""
        with contextlib.suppress(BrokenPipeError), self.turn:  # what became of it, if it has ended, its output tells
            self.turn.write(b"!")

    def end(self, patience_s: float = STOP_PATIENCE_S) -> None:
        """SIGTERM, and SIGKILL for one that does not listen."""
        if self.alive:
            self.process.send_signal(signal.SIGTERM)
        self.turn.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(patience_s)
            return
        self.killed = True
        self.process.kill()
        self.process.wait()


class ProcessRig:
    """Starts `qrobot` subcommands as processes and ends them all when the `with` block does.

    Inside the block SIGTERM, and SIGHUP of a terminal that is closed, raise KeyboardInterrupt, as SIGINT does; while
    the processes are being ended all are ignored. Use it from the main thread.

    Args:
        directory: for their output.
        starter: starts them, for several rigs one after the other; None for one of this rig alone.
        told: of what a process compiles that is waited for.
    """

    def __init__(
        self, directory: Path, starter: ProcessStarter | None = None, told: Report = lambda _line: None
    ) -> None:
        self.directory = directory
        self.children: dict[str, Child] = {}
        self._outputs: dict[str, IO[bytes]] = {}
        self._interrupted = contextlib.ExitStack()
        self._supervision = Supervision()
        self._starter = starter or ProcessStarter()
        self._owns_starter = starter is None
        self._told = told
        directory.mkdir(parents=True, exist_ok=True)

    def start(self, *plans: ProcessPlan) -> None:
        """Start processes; each begins its work when the ones before it are ready.

        Raises:
            LinkBusy: one is ready before it was started, or another rig has its output file; then none is started.
            LinkError: one ended instead of getting ready; the message is the process's own.
            LinkTimeout: one did not get ready in time.
        """
        for plan in plans:
            if plan.ready is not None and plan.ready(0):
                raise LinkBusy(
                    f"{plan.name} is not started: another process does its work already; stop that one first"
                )
        for plan in plans:
            self._empty_output(plan)
        self._starter.prepare()
        for plan in plans:
            with interrupts_deferred():  # one that comes in between would leave a process that nobody knows
                self.children[plan.name] = self._spawn(plan)
        for plan in plans:
            self.children[plan.name].begin()
            if plan.ready is not None:
                _wait_for(self.children[plan.name], plan.ready, self._told)

    def restart(self, name: str) -> None:
        """Start again a child that has ended, and do not wait for it: those it needs are there."""
        with interrupts_deferred():
            child = self.children[name] = self._spawn(self.children[name].plan)
        child.begin()

    def forget(self, name: str) -> None:
        """Go on without a child that has ended."""
        self.children.pop(name).end()

    def alive(self, name: str) -> bool:
        """True while a process of this name runs."""
        return name in self.children and self.children[name].alive

    def dead(self) -> list[Child]:
        """Children that have ended although nobody asked them to."""
        return [child for child in self.children.values() if not child.alive]

    def end(self, name: str) -> None:
        """End one child, if there is one of that name."""
        child = self.children.pop(name, None)
        if child is not None:
            child.end()

    def close(self) -> None:
        """End all children, highest rank first."""
        for child in sorted(self.children.values(), key=lambda child: -child.plan.rank):
            child.end()
            discard_dead(child.name)  # of one that was killed: its memory has its name
        self._supervision.close()
        if self._owns_starter:
            self._starter.close()
        for file in self._outputs.values():
            file.close()

    def _empty_output(self, plan: ProcessPlan) -> None:
        """Begin its output file; it is locked while this rig, or a process of it, has it open.

        Where its file system knows no locks, as NFS and FUSE may, that another one starts is seen later: `_wait_for`.
        """
        if plan.name not in self._outputs:
            file = (self.directory / f"{plan.name}.txt").open("ab")
            if not lock_alone(file):
                file.close()
                raise LinkBusy(
                    f"{plan.name} is not started: another process starts it, or runs, and writes to {file.name}"
                )
            self._outputs[plan.name] = file
        self._outputs[plan.name].truncate(0)

    def _spawn(self, plan: ProcessPlan) -> Child:
        awaited, turn = os.pipe()
        file = self._outputs[plan.name]
        with os.fdopen(awaited):
            inherited = {TURN_VARIABLE: [awaited], SUPERVISOR_VARIABLE: self._supervision.descriptors(plan.rank)}
            process = self._starter.start(plan.arguments, file, inherited)
        return Child(plan, process, Path(file.name), os.fdopen(turn, "wb", buffering=0))

    def __enter__(self) -> ProcessRig:
        self._interrupted.enter_context(interrupted_by_signals())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with self._interrupted, interrupts_ignored():
            self.close()


def _wait_for(child: Child, ready: Callable[[int], bool], told: Report) -> None:
    deadline, before = time.monotonic() + START_PATIENCE_S, child.compiling()  # as it waited for its turn
    compiling = before
    while True:
        is_ready = ready(child.process.pid)
        if not child.alive:  # also when something is ready: then it is another's
            raise LinkError(f"{child.name} did not start: {child.complaint()}")
        if is_ready:
            if compiling != before:
                told(f"{child.name} is ready")
            return
        if time.monotonic() > deadline:
            raise LinkTimeout(f"{child.name} was not ready within {START_PATIENCE_S:.0f} s: {child.complaint()}")
        if (compiles := child.compiling()) not in ("", compiling):
            compiling = compiles
            told(f"{child.name}: {compiles}")
        time.sleep(POLL_S)


def _serves(segment: SharedMemory, pid: int) -> bool:
    """The process of this id, with 0 any living one, owns it, and has cleared what a killed one has left in it.

    That takes a moment.
    """
    owner = int(segment.header.owner_pid)
    return segment.owner_alive and pid in (0, owner) and Path(f"/proc/{owner}").exists()


def board_ready(arm: str, pid: int = 0) -> bool:
    """A board, of process `pid` unless that is 0, serves this arm and has published an image."""
    try:
        segment = attach_board_memory(arm)
    except QRobotError:
        return False
    ready = _serves(segment, pid) and bool(segment.memory.facts.period_ns) and segment.memory.shown.sequence > 0
    segment.close()
    return bool(ready)


@contextlib.contextmanager
def _maybe_front(arm: str, pid: int = 0) -> Iterator[ServoFront | None]:
    """Memory of servo and guardian of an arm, while it is looked at; None when there is no servo, or not this one."""
    try:
        segment = attach_servo_memory(arm)
    except QRobotError:
        yield None
        return
    with segment:
        yield segment.front if _serves(segment, pid) else None


def servo_ready(arm: str, pid: int = 0) -> bool:
    """The servo of this arm, process `pid` unless that is 0, runs its loop."""
    with _maybe_front(arm, pid) as front:
        return front is not None and front.info.ready == 1


def guardian_ready(arm: str, since_ns: int, pid: int = 0) -> bool:
    """The guardian of this arm, process `pid` unless that is 0, has looked at its servo after `since_ns`.

    `since_ns` is of CLOCK_MONOTONIC.
    """
    with _maybe_front(arm) as front:
        looked = front is not None and front.guardian.t_ns + front.heartbeat.slipped_ns > since_ns
    return looked and (pid == 0 or _in_guardians_place(arm, pid))


def _in_guardians_place(arm: str, pid: int) -> bool:
    try:
        segment = SharedMemory.attach(guardian_place(arm), PLACE_LAYOUT)
    except QRobotError:
        return False
    with segment:
        return _serves(segment, pid)


def bridge_ready(host: str, port: int) -> bool:
    """Something accepts connections at the bridge's address."""
    with contextlib.suppress(OSError), socket.create_connection((host, port), timeout=0.2):
        return True
    return False
