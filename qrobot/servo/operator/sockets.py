"""The control interface's sockets: lines in, lines out, never waiting for anybody.

One thread reads. A request that is not answered at once gets a thread of its own for the rest, so that the next one,
which may be a stop, is read meanwhile; replies then come in the order in which they are ready.

Unix sockets in the runtime folder (`realtime.runtime_folder`). Each end looks who the other one is: the servo lets in
its own account and root, a client talks only to a servo of the account that owns the folder.
"""

from __future__ import annotations

import contextlib
import errno
import os
import selectors
import socket
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Final

from qrobot.errors import LinkBusy, LinkError, error_text
from qrobot.realtime.peer_credentials import peer_credentials
from qrobot.realtime.runtime_folder import RuntimeFolder, look_into_folder, serve_in_folder, tidy_folder
from qrobot.realtime.shared_memory import checked_name
from qrobot.servo.operator.messages import MAX_LINE_BYTES

MAX_CLIENTS: Final = 16
MAX_WAITING: Final = 4  # replies that one connection may wait for
_CONTROL: Final = "-control"

RequestHandler = Callable[["OperatorConnection", bytes], bytes | Callable[[], bytes]]
Farewell = Callable[["OperatorConnection"], None]


def control_name(arm: str) -> str:
    """File name of an arm's control socket in the runtime folder."""
    return checked_name(f"{arm}{_CONTROL}")


def visitor_label(pid: int) -> str:
    """Name of a process that commands by the control interface, for people."""
    return f"process {pid} by way of the control interface"


def arms_that_run() -> list[str]:
    """Names of the arms whose servos listen in the runtime folder, in order."""
    try:
        with look_into_folder() as folder:
            named = [name.removesuffix(_CONTROL) for name in os.listdir(folder.fd) if name.endswith(_CONTROL)]
    except OSError:
        return []
    return sorted(arm for arm in named if _listens(arm))


def _listens(arm: str) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
        connection.setblocking(False)
        try:
            connect_to_servo(arm, connection)
        except BlockingIOError:  # it hangs, and as many as the kernel lets wait for it
            return True
        except (OSError, LinkError):
            return False
    return True


def connect_to_servo(arm: str, connection: socket.socket) -> None:
    """Connect to the servo of an arm.

    Raises OSError when none listens, of it BlockingIOError when too many wait for one and `connection` does not block
    or has a timeout, LinkError when whoever listens is of another account than the folder.
    """
    with look_into_folder() as folder:
        connection.connect(folder.address_of(control_name(arm)))
        _, uid, _ = peer_credentials(connection)
        if uid != folder.owner:
            raise LinkError(f"whoever answers for the servo of {arm} is account {uid}, not {folder.owner_name}")


class OperatorConnection:
    """One connection.

    Attributes:
        gone: set once it has ended.
        heard: when it was last heard of, as a count; the lowest has been silent for longest.
    """

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.pid, self.uid, _ = peer_credentials(connection)
        self.gone = threading.Event()
        self.heard = 0
        self._unread = b""
        self._waiting = threading.BoundedSemaphore(MAX_WAITING)

    def wait_for(self, rest: Callable[[], bytes]) -> None:
        """Let another thread find out the reply and send it. Raises BlockingIOError for too many at once."""
        if not self._waiting.acquire(blocking=False):
            raise BlockingIOError("too many requests at once")
        try:
            threading.Thread(target=self._send, args=(rest,), name="control-reply", daemon=True).start()
        except RuntimeError as error:  # this process, or its account, may have no more threads
            self._waiting.release()
            raise BlockingIOError(str(error)) from None

    def _send(self, rest: Callable[[], bytes]) -> None:
        try:
            self.connection.sendall(rest())
        except OSError:  # gone, or does not read what it asked for
            return
        finally:
            self._waiting.release()

    @property
    def label(self) -> str:
        """Name of the peer, for people."""
        return visitor_label(self.pid)

    def read_lines(self) -> list[bytes] | None:
        """Whole lines that have come; None when the connection is at its end or the line has none."""
        try:
            data = self.connection.recv(MAX_LINE_BYTES)
        except BlockingIOError:
            return []
        except OSError:
            return None
        *lines, self._unread = (self._unread + data).split(b"\n")
        return None if not data or len(self._unread) > MAX_LINE_BYTES else lines


class ControlSocket:
    """Listens for one arm; `serve` does what there is to do.

    Args:
        answer: the reply line to a request line, or what finds it out and may wait.
        farewell: called when a connection has ended.

    Raises:
        LinkBusy: somebody listens for that arm already. LinkError: the runtime folder cannot be used.
    """

    def __init__(self, arm: str, answer: RequestHandler, farewell: Farewell) -> None:
        self._answer, self._farewell, self._name = answer, farewell, control_name(arm)
        self._heard = 0
        self._listener = _listen(arm)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ, None)

    def serve(self, seconds: float) -> None:
        """Wait at most so long for something to do, and do it."""
        for key, _ in self._selector.select(seconds):
            if key.data is None:
                self._welcome()
            elif not key.data.gone.is_set():  # it may have made room for one who was welcomed a moment ago
                self._attend(key.data)

    def close(self) -> None:
        """End every connection and stop listening."""
        for visitor in self._visitors():
            self._dismiss(visitor)
        self._selector.close()
        _stop_listening(self._listener, self._name)

    def __enter__(self) -> ControlSocket:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _welcome(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:  # gone again, or this process has too many files open: nothing the arm should feel
            return
        connection.setblocking(False)
        visitor = OperatorConnection(connection)
        if visitor.uid not in (0, os.geteuid()):
            connection.close()
            return
        if len(self._selector.get_map()) > MAX_CLIENTS:  # the new one may want to stop the arm
            self._dismiss(min(self._visitors(), key=lambda one: one.heard))
        self._hear(visitor)
        self._selector.register(connection, selectors.EVENT_READ, visitor)

    def _visitors(self) -> list[OperatorConnection]:
        return [key.data for key in self._selector.get_map().values() if key.data is not None]

    def _hear(self, visitor: OperatorConnection) -> None:
        self._heard += 1
        visitor.heard = self._heard

    def _attend(self, visitor: OperatorConnection) -> None:
        self._hear(visitor)
        lines = visitor.read_lines()
        over = lines is None
        for line in lines or ():
            try:
                self._reply(visitor, line)
            except OSError:  # gone, or does not read what it asked for; a stop may stand behind it
                over = True
        if over:
            self._dismiss(visitor)

    def _reply(self, visitor: OperatorConnection, line: bytes) -> None:
        reply = self._answer(visitor, line)
        if isinstance(reply, bytes):
            visitor.connection.sendall(reply)
        else:
            visitor.wait_for(reply)

    def _dismiss(self, visitor: OperatorConnection) -> None:
        self._selector.unregister(visitor.connection)
        visitor.gone.set()
        visitor.connection.close()
        self._farewell(visitor)


def _listen(arm: str) -> socket.socket:
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        with serve_in_folder() as folder:
            _bind(listener, folder, arm)
        listener.listen(MAX_CLIENTS)
        listener.setblocking(False)
    except BaseException:
        listener.close()
        raise
    return listener


def _bind(listener: socket.socket, folder: RuntimeFolder, arm: str) -> None:
    name = control_name(arm)
    try:
        if _is_answered(folder.address_of(name)):
            raise LinkBusy(f"the control socket of {arm} is in use: does another servo run?")
        with contextlib.suppress(FileNotFoundError):  # of a servo that was killed
            os.unlink(name, dir_fd=folder.fd)
        listener.bind(folder.address_of(name))
        os.chmod(name, 0o600, dir_fd=folder.fd)
    except OSError as error:
        raise LinkError(f"no control socket for {arm} in {folder.path}: {error_text(error)}") from None


def _is_answered(address: str) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        return probe.connect_ex(address) not in (errno.ECONNREFUSED, errno.ENOENT)


def _stop_listening(listener: socket.socket, name: str) -> None:
    listener.close()
    with contextlib.suppress(OSError, LinkError), serve_in_folder() as folder:
        os.unlink(name, dir_fd=folder.fd)
        tidy_folder(folder.path)
