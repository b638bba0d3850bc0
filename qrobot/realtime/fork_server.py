"""The process that imports libraries once and forks others: `DESCRIPTOR TARGET PREPARATION...` on its command line.

It has one thread, as no other would live on in what it forks. Over the socket of the descriptor it takes orders from
its client (`qrobot.realtime.forking`), and ends with that. It answers an order with the id and a descriptor of the
process, and is the parent: how the process has ended it writes into the pipe that came with the order. A forked process
waits until its client knows it, is then a session of its own, and calls the target. It outlives the fork server.
"""

from __future__ import annotations

import gc
import os
import pickle
import select
import signal
import socket
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module

from setproctitle import setproctitle

from qrobot.realtime.fork_order import MOST_BYTES, MOST_DESCRIPTORS, READY, STATUS, ForkOrder
from qrobot.realtime.signals import ENDING


class Children:
    """The processes of a fork server."""

    def __init__(self, client: socket.socket) -> None:
        self._client = client
        self._living: dict[int, tuple[int, int]] = {}  # by descriptor of the process: its id, the pipe for its status
        self._poll = select.poll()
        self._poll.register(client, select.POLLIN)

    def serve(self) -> ForkOrder | None:
        """Take orders until the client ends. Returns an order in the process that was forked for it."""
        self._answer(READY)
        while True:
            for descriptor, _ in self._poll.poll():
                if descriptor in self._living:
                    self._tell_end(descriptor)
                elif (descriptors := self._received()) is None:
                    return None
                elif (order := self._taken(descriptors)) is not None:
                    return order

    def _received(self) -> list[int] | None:
        """Descriptors of an order; None without a client."""
        data = b""
        with suppress(ConnectionResetError):  # it has ended before it read an answer
            data, descriptors, *_ = socket.recv_fds(self._client, MOST_BYTES, MOST_DESCRIPTORS)
        return descriptors if data else None

    def _taken(self, descriptors: list[int]) -> ForkOrder | None:
        """Fork a process for an order, and return that there."""
        try:
            order = _read_order(descriptors)
            pid = os.fork()
        except (OSError, ValueError) as error:
            self._refuse(error, descriptors)
            return None
        file, folder, output, status, begins, *inherited = descriptors
        if pid == 0:
            self._leave()
            _begin(order, folder, output, begins, inherited)
            _close(file, folder, output, status, begins)
            return order
        try:
            process = os.pidfd_open(pid)
        except OSError as error:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
            self._refuse(error, descriptors)
            return None
        self._living[process] = pid, status
        self._poll.register(process, select.POLLIN)
        self._answer(str(pid).encode(), process)
        _close(file, folder, output, begins, *inherited)
        return None

    def _refuse(self, error: Exception, descriptors: list[int]) -> None:
        self._answer(str(error).encode()[:MOST_BYTES])
        _close(*descriptors)

    def _answer(self, text: bytes, *descriptors: int) -> None:
        with suppress(BrokenPipeError):  # that the client has ended is seen with the next order
            socket.send_fds(self._client, [text], descriptors)

    def _tell_end(self, process: int) -> None:
        self._poll.unregister(process)
        pid, status = self._living.pop(process)
        _, ended = os.waitpid(pid, 0)
        with suppress(BrokenPipeError):  # nobody wants to know
            os.write(status, STATUS.pack(os.waitstatus_to_exitcode(ended)))
        _close(process, status)

    def _leave(self) -> None:
        """Close, in a new process, what is the fork server's."""
        self._client.close()
        _close(*self._living, *(status for _, status in self._living.values()))


def _read_order(descriptors: list[int]) -> ForkOrder:
    """Raises ValueError when descriptors are missing, for want of room in this process."""
    if not descriptors:
        raise ValueError("its order has not come")
    with open(descriptors[0], "rb", closefd=False) as file:
        order: ForkOrder = pickle.load(file)
    if len(descriptors) != 5 + sum(count for _, count in order.inherited):
        raise ValueError("descriptors of its order have not come")
    return order


def _begin(order: ForkOrder, folder: int, output: int, begins: int, inherited: Sequence[int]) -> None:
    """Become what an order says, once the client knows this process; else end it."""
    if not os.read(begins, 1):
        os._exit(1)
    os.setsid()
    os.fchdir(folder)
    for standard in (1, 2):
        os.dup2(output, standard)
    for number in ENDING:
        usual = signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL
        signal.signal(number, signal.SIG_IGN if number in order.ignored else usual)
    os.environ.clear()
    os.environ.update(order.environment)
    left = iter(inherited)
    for name, count in order.inherited:
        os.environ[name] = ",".join(str(next(left)) for _ in range(count))
    sys.argv[:] = order.words
    setproctitle(" ".join(order.words))


def _close(*descriptors: int) -> None:
    for descriptor in descriptors:
        os.close(descriptor)


def main() -> None:
    """Be a fork server, and call the target in what was forked."""
    descriptor, target, *preparations = sys.argv[1:]
    setproctitle("qrobot fork server")
    gc.disable()  # what is imported makes no garbage
    for each in preparations:
        with suppress(Exception):
            _prepare(each)
    gc.freeze()  # else a search for garbage writes into all pages that the processes share
    gc.enable()
    with socket.socket(fileno=int(descriptor)) as client:
        order = Children(client).serve() if _can_name_processes() else None
    if order is not None:
        _prepare(target)


def _prepare(what: str) -> None:
    module, _, function = what.partition(":")
    loaded = import_module(module)
    if function:
        getattr(loaded, function)()


def _can_name_processes() -> bool:
    """Whether kernel and Python know descriptors of processes, as Linux does since 5.3."""
    try:
        os.close(os.pidfd_open(os.getpid()))
    except (OSError, AttributeError):
        return False
    return True


if __name__ == "__main__":
    main()
