"""Processes that have their libraries from their first instruction on: forked by one that has imported them.

Half of the processor time that a process of an arm takes until it is ready goes into the import of the same libraries.
A fork server (`qrobot.realtime.fork_server`) imports them once, while whoever has started it does something else, and
then forks a process for each order. The two have a pair of sockets.
"""

from __future__ import annotations

import os
import pickle
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from typing import Final

from qrobot.errors import LinkLost
from qrobot.realtime.fork_order import MOST_BYTES, ForkOrder
from qrobot.realtime.forked_process import ForkedProcess, is_readable
from qrobot.realtime.own_process import own_command
from qrobot.realtime.signals import ENDING

ONE_BLAS_THREAD: Final = {"OPENBLAS_NUM_THREADS": "1"}  # threads do not survive a fork; a robot's matrices are small
ANSWER_S: Final = 5.0  # [A] to an order: a fork takes milliseconds


class ForkServer:
    """A fork server and the connection to it. Closing ends it, and no process that it has forked.

    Args:
        target: function without arguments that a forked process calls, as `module:function`.
        preparations: modules to import beforehand, and functions to call, as `module:function`. Where one fails, it is
            left to the process that needs it.
    """

    def __init__(self, target: str, preparations: Sequence[str]) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._is_ready = False
        with theirs:
            self._process = subprocess.Popen(
                own_command("qrobot.realtime.fork_server", str(theirs.fileno()), target, *preparations),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=None if sys.stderr else subprocess.DEVNULL,
                start_new_session=True,
                pass_fds=[theirs.fileno()],
                env={**os.environ, **ONE_BLAS_THREAD},
            )

    def wait_ready(self) -> None:
        """Wait until it is prepared. Raises LinkLost when it has ended."""
        if not self._is_ready:
            self._receive()
            self._is_ready = True

    def fork(self, words: Sequence[str], output: int, inherited: Mapping[str, Sequence[int]]) -> ForkedProcess:
        """A process with the folder, the environment and the ignored signals that this one has now.

        What modules read in the environment when they are imported, they have read in the fork server's; limits,
        niceness, processors and the mode mask of files are the fork server's too.

        Args:
            words: of its command line, the program's name first.
            output: descriptor of what it prints to, results and messages.
            inherited: variables, and the descriptors that each is to name there, with commas between them.

        Raises:
            LinkLost: the fork server has ended, does not answer or cannot fork; then there is no process.
        """
        self.wait_ready()
        counts = tuple((name, len(each)) for name, each in inherited.items())
        ignored = tuple(number for number in ENDING if signal.getsignal(number) is signal.SIG_IGN)
        order = ForkOrder(tuple(words), dict(os.environ), ignored, counts)
        with _written(order) as file, _folder() as folder, _pipe() as (status, told), _pipe() as (begins, begin):
            given = [each for descriptors in inherited.values() for each in descriptors]
            pid, process = self._ask([file, folder, output, told, begins, *given])
            found = ForkedProcess(pid, process, os.dup(status))
            with suppress(BrokenPipeError):  # it has been killed
                os.write(begin, b"!")  # before that nobody knows it, and it would end with `begin`
        return found

    def _ask(self, descriptors: list[int]) -> tuple[int, int]:
        """Id and descriptor of the process of an order."""
        with suppress(BrokenPipeError, ConnectionResetError):  # no answer comes either
            socket.send_fds(self._socket, [b"order"], descriptors)
        if not is_readable(self._socket.fileno(), ANSWER_S):
            self._process.kill()  # its answer would be taken for that to another order
            raise LinkLost(f"the fork server has not answered within {ANSWER_S:g} s")
        told, processes = self._receive()
        if not processes:
            raise LinkLost(f"the fork server cannot fork: {told.decode()}")
        return int(told), processes[0]

    def _receive(self) -> tuple[bytes, list[int]]:
        told, descriptors = b"", list[int]()
        with suppress(ConnectionResetError):
            told, descriptors, *_ = socket.recv_fds(self._socket, MOST_BYTES, 1, socket.MSG_CMSG_CLOEXEC)
        if not told:
            raise LinkLost("the fork server has ended")
        return told, descriptors

    def close(self) -> None:
        """End it, whatever it does."""
        self._socket.close()
        self._process.kill()
        self._process.wait()


@contextmanager
def _written(order: ForkOrder) -> Iterator[int]:
    """Descriptor of a file in memory with an order: environments are longer than a message may be."""
    with os.fdopen(os.memfd_create("order"), "w+b") as file:
        pickle.dump(order, file)
        file.seek(0)
        yield file.fileno()


@contextmanager
def _folder() -> Iterator[int]:
    """Descriptor of the current folder, which may have no name any more."""
    found = os.open(".", os.O_PATH | os.O_DIRECTORY)
    try:
        yield found
    finally:
        os.close(found)


@contextmanager
def _pipe() -> Iterator[tuple[int, int]]:
    """Ends of a pipe, to read and to write."""
    ends = os.pipe()
    try:
        yield ends
    finally:
        for end in ends:
            os.close(end)
