"""A process that imports libraries once, and forks others that have them from their first instruction on.

Half of the processor time that a process of an arm takes until it is ready goes into the import of the same libraries.
A fork server is a process without threads that imports them while whoever has started it does something else. For each
order it forks: the new process shares its memory until either writes there, is a session of its own, and runs the
command with the words of the order. Processes outlive their fork server, which ends with its client.

The two have a pair of sockets. An order goes there as a pickled `_Order` with file descriptors; back comes the process
id with a descriptor of the process (pidfd_open(2)). The fork server, which is the parent, writes how a process has
ended into a pipe that came with the order.
"""

from __future__ import annotations

import gc
import os
import pickle
import select
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Final, NamedTuple

from setproctitle import setproctitle

from qrobot.errors import LinkError, LinkLost
from qrobot.realtime.own_process import own_command
from qrobot.realtime.signals import Handler

ONE_BLAS_THREAD: Final = {"OPENBLAS_NUM_THREADS": "1"}  # threads do not survive a fork; a robot's matrices are small
MOST_BYTES: Final = 1 << 20  # of an order: words and environment
MOST_DESCRIPTORS: Final = 32
ENDING: Final[Mapping[int, Handler]] = {
    signal.SIGHUP: signal.SIG_DFL,
    signal.SIGTERM: signal.SIG_DFL,
    signal.SIGINT: signal.default_int_handler,
}
READY: Final = b"ready"
STATUS: Final = struct.Struct("i")  # as `os.waitstatus_to_exitcode` tells it
UNKNOWN_STATUS: Final = 255  # of a process whose fork server has ended before it


class _Order(NamedTuple):
    """Description of a process.

    Attributes:
        words: of the command line, the program's name first.
        folder: it works in.
        environment: its variables.
        ignored: signals of `ENDING` that it ignores, as a command behind `nohup` does.
        inherited: a variable each, and how many descriptors it is to name. These come in the same order behind two
            others: what the process prints to, and the pipe for its status.
    """

    words: tuple[str, ...]
    folder: str
    environment: dict[str, str]
    ignored: tuple[int, ...]
    inherited: tuple[tuple[str, int], ...]


class ForkedProcess:
    """A process that was forked; its methods are those of `subprocess.Popen`.

    Attributes:
        pid: process id.
        returncode: exit status, or minus the number of the signal that has ended it; None until `poll` or `wait` has
            seen that.
    """

    def __init__(self, pid: int, process: int, status: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self._process, self._status = process, status  # descriptors

    def poll(self) -> int | None:
        """Its status, once it has ended."""
        return self._look(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """Its status. Raises subprocess.TimeoutExpired when it has not ended within so many seconds."""
        status = self._look(timeout)
        if status is None:
            raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
        return status

    def send_signal(self, number: int) -> None:
        """Send a signal, unless it has ended."""
        if self.returncode is None:
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._process, number)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def _look(self, timeout: float | None) -> int | None:
        if self.returncode is None and _is_readable(self._process, timeout):  # it has ended
            told = os.read(self._status, STATUS.size)
            self.returncode = STATUS.unpack(told)[0] if told else UNKNOWN_STATUS
            self._close()
        return self.returncode

    def _close(self) -> None:
        os.close(self._process)
        os.close(self._status)

    def __del__(self) -> None:
        if self.returncode is None:
            self._close()


def _is_readable(descriptor: int, timeout_s: float | None) -> bool:
    poll = select.poll()
    poll.register(descriptor, select.POLLIN)
    return bool(poll.poll(None if timeout_s is None else timeout_s * 1e3))


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

        What modules read in the environment when they are imported, they have read in the fork server's.

        Args:
            words: of its command line, the program's name first.
            output: descriptor of what it prints to, results and messages.
            inherited: variables, and the descriptors that each is to name there, with commas between them.

        Raises:
            LinkLost: the fork server has ended.
            LinkError: the system has no room for another process.
        """
        self.wait_ready()
        counts = tuple((name, len(each)) for name, each in inherited.items())
        ignored = tuple(number for number in ENDING if signal.getsignal(number) is signal.SIG_IGN)
        order = pickle.dumps(_Order(tuple(words), os.getcwd(), dict(os.environ), ignored, counts))
        status, of_parent = os.pipe()
        try:
            descriptors = [output, of_parent, *(one for each in inherited.values() for one in each)]
            with suppress(BrokenPipeError, ConnectionResetError):  # the answer does not come either
                socket.send_fds(self._socket, [order], descriptors)
            told, processes = self._receive()
            if not processes:
                raise LinkError(f"`{' '.join(words)}` cannot be started: {told.decode()}")
        except BaseException:
            os.close(status)
            raise
        finally:
            os.close(of_parent)
        return ForkedProcess(int(told), processes[0], status)

    def _receive(self) -> tuple[bytes, list[int]]:
        told, descriptors = b"", list[int]()
        with suppress(ConnectionResetError):
            told, descriptors, *_ = socket.recv_fds(self._socket, MOST_BYTES, 1)
        if not told:
            raise LinkLost("the fork server has ended")
        return told, descriptors

    def close(self) -> None:
        """End it, whatever it does."""
        self._socket.close()
        self._process.kill()
        self._process.wait()


class _Children:
    """The processes of a fork server, as that sees them."""

    def __init__(self, client: socket.socket) -> None:
        self._client = client
        self._living: dict[int, tuple[int, int]] = {}  # by descriptor of the process: its id, the pipe for its status
        self._poll = select.poll()
        self._poll.register(client, select.POLLIN)

    def serve(self) -> _Order:
        """Take orders; returns in each process that was forked, with its order. Raises EOFError without a client."""
        self._answer(READY, [])
        while True:
            for descriptor, _ in self._poll.poll():
                if descriptor in self._living:
                    self._tell_end(descriptor)
                elif (order := self._fork()) is not None:
                    return order

    def _fork(self) -> _Order | None:
        """Take an order; returns it in the process that was forked."""
        data, descriptors, *_ = socket.recv_fds(self._client, MOST_BYTES, MOST_DESCRIPTORS)
        if not data:
            raise EOFError
        order: _Order = pickle.loads(data)
        output, status, *inherited = descriptors
        try:
            pid = os.fork()
        except OSError as error:
            self._answer(os.strerror(error.errno or 0).encode(), [])
            _close(*descriptors)
            return None
        if pid == 0:
            self._leave(status)
            _become(order, output, inherited)
            return order
        process = os.pidfd_open(pid)
        self._living[process] = pid, status
        self._poll.register(process, select.POLLIN)
        self._answer(str(pid).encode(), [process])
        _close(output, *inherited)
        return None

    def _answer(self, text: bytes, descriptors: list[int]) -> None:
        with suppress(BrokenPipeError):  # that the client has ended is seen with the next order
            socket.send_fds(self._client, [text], descriptors)

    def _tell_end(self, process: int) -> None:
        self._poll.unregister(process)
        pid, status = self._living.pop(process)
        _, ended = os.waitpid(pid, 0)
        with suppress(BrokenPipeError):  # nobody wants to know
            os.write(status, STATUS.pack(os.waitstatus_to_exitcode(ended)))
        _close(process, status)

    def _leave(self, own_status: int) -> None:
        """Close, in a new process, what is the fork server's."""
        self._client.close()
        _close(own_status, *self._living, *(status for _, status in self._living.values()))


def _become(order: _Order, output: int, inherited: Sequence[int]) -> None:
    os.setsid()
    for standard in (1, 2):
        os.dup2(output, standard)
    os.close(output)
    os.chdir(order.folder)
    for number, handler in ENDING.items():
        signal.signal(number, signal.SIG_IGN if number in order.ignored else handler)
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
    """Be a fork server: `DESCRIPTOR TARGET PREPARATION...` on the command line; call the target in what was forked."""
    descriptor, target, *preparations = sys.argv[1:]
    setproctitle("qrobot fork server")
    for each in preparations:
        with suppress(Exception):
            _prepare(each)
    gc.freeze()  # else a search for garbage writes into all pages that the processes share
    with socket.socket(fileno=int(descriptor)) as client, suppress(EOFError):
        _Children(client).serve()
        _prepare(target)


def _prepare(what: str) -> None:
    module, _, function = what.partition(":")
    loaded = import_module(module)
    if function:
        getattr(loaded, function)()


if __name__ == "__main__":
    main()
