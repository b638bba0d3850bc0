"""The program's end of a generator in a process of its own: its start, orders, reports and death."""

from __future__ import annotations

import os
import socket
import subprocess
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, Final

from qrobot.errors import LinkLost
from qrobot.rccl.process.carried import ProgramEnd
from qrobot.rccl.process.reports import GeneratorReport, OrderAnswer
from qrobot.rccl.process.shared_values import PROGRAM, ValueCells, warm_up
from qrobot.rci.client import Beside
from qrobot.rci.forked_child import NO_PART, keep_from_children
from qrobot.realtime.own_process import own_command
from qrobot.realtime.shared_memory import SharedMemory

END_S: Final = 10.0  # [A] for an arm to come to rest
LOOK_S: Final = 0.5  # a waiting program looks up so often


class GeneratorProcess:
    """One process, which answers orders one after another.

    Args:
        claim: of the processor that it is kept on, None for any.

    Attributes:
        ends: what crosses.
        sampled: held while the program looks at what was reported; notified with each report.
        error: what has ended the task, or the process, before its time.
        heard: called with each report, with the lock held.
        ended: called with what has ended the task, with the lock held.
        refusals: of the link by kind, as they were reported last.
    """

    def __init__(self, claim: SharedMemory | None = None) -> None:
        values = ValueCells(PROGRAM)
        warm_up()
        self.ends = ProgramEnd(values, lambda numbers: self.ask("part", numbers))
        self.sampled = threading.Condition()
        self.error: BaseException | None = None
        self.heard: Callable[[GeneratorReport], object] = lambda _: None
        self.ended: Callable[[BaseException], object] = lambda _: None
        self._answers: dict[int, OrderAnswer] = {}
        self._orders = 0
        self._closed = self._ended = False
        self._claim = claim
        self.refusals: Mapping[type[Beside], str] = {}
        ours, theirs = socket.socketpair()
        with theirs:
            handed = theirs.fileno(), values.fd
            command = own_command("qrobot.rccl.process", *map(str, (*handed, os.getpid())))
            self._process = subprocess.Popen(command, pass_fds=handed)
        values.close()
        self._connection = Connection(ours.detach())
        self._listener = threading.Thread(target=self._listen, name="rccl-reports", daemon=True)
        self._listener.start()
        keep_from_children(self)

    def forget_in_child(self) -> None:
        """See `Owned`: the process is the parent's, whose threads may have had the lock."""
        self.sampled = threading.Condition()
        self.error = LinkLost(NO_PART)
        self._closed = self._ended = True
        self._connection.close()

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    def ask(self, order: str, *arguments: object) -> Any:
        """Have an order carried out, and wait until it is. Raises what it raises, or what has ended the process."""
        with self.sampled:
            self._orders += 1
            number = self._orders
            self._send((number, order, arguments))
            while number not in self._answers:
                if self._closed:
                    raise self.error or LinkLost("the process of the generator was ended")
                self.sampled.wait(LOOK_S)
            answer = self._answers.pop(number)
        if answer.error is not None:
            raise answer.error
        return answer.value

    def tell(self, order: str, *arguments: object) -> None:
        """Have an order carried out, and go on meanwhile."""
        with self.sampled, suppress(LinkLost):  # whoever waits hears of that
            self._send((0, order, arguments))

    def _send(self, order: tuple[object, ...]) -> None:
        data = self.ends.dumps(order)
        try:
            self._connection.send_bytes(data)
        except OSError:
            raise self.error or self._death() from None

    def _death(self) -> LinkLost:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_S)
        status = self._process.returncode
        return LinkLost(f"the process of the generator has died, exit status {status}; the bridge has stopped the arm")

    # ------------------------------------------------------------------------------------------- thread of the reports

    def _listen(self) -> None:
        try:
            while True:
                data = self._connection.recv_bytes()
                with self.sampled:
                    self._take(self.ends.loads(data))
                    self.sampled.notify_all()
        except (EOFError, OSError):
            self._mourn()

    def _take(self, report: GeneratorReport) -> None:
        self.heard(report)
        if report.seen is not None:
            self.refusals = report.seen.refusals
        if report.error is not None:
            self.fail(report.error)
        self._answers.update({answer.order: answer for answer in report.answers if answer.order})
        strays = [answer.error for answer in report.answers if not answer.order and answer.error is not None]
        if strays:
            self.fail(strays[0])

    def fail(self, error: BaseException) -> None:
        """The arm is lost, for that reason; does nothing a second time. To be called with the lock held."""
        if self.error is None:
            self.error = error
            self.ended(error)

    def _mourn(self) -> None:
        with self.sampled:
            if not self._closed:
                self.fail(self._death())
            self._closed = True
            self.sampled.notify_all()

    def close(self) -> None:
        """Let the process end, which takes its arm to rest if it still has it; a second call does nothing."""
        with self.sampled:
            self._closed, ended = True, self._ended
            self._ended = True
        if not ended:
            with suppress(OSError):
                self._shut()
            self._end_process()

    def _shut(self) -> None:
        with socket.socket(fileno=os.dup(self._connection.fileno())) as ours:
            ours.shutdown(socket.SHUT_WR)

    def _end_process(self) -> None:
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if threading.current_thread() is not self._listener:
            self._listener.join()
        self._connection.close()
        if self._claim is not None:
            self._claim.close(unlink=True)
