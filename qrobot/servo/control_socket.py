"""The control interface's sockets: lines in, lines out, never waiting for anybody.

Unix sockets in the runtime folder (`realtime.runtime_folder`). Each end looks who the other one is: the servo lets in
its own account and root, a client talks only to a servo of the account that owns the folder.
"""

from __future__ import annotations

import contextlib
import errno
import os
import selectors
import socket
import struct
from collections.abc import Callable
from types import TracebackType
from typing import Final

from qrobot.errors import LinkBusy, LinkError
from qrobot.realtime.runtime_folder import RuntimeFolder, look_into_folder, serve_in_folder, tidy_folder
from qrobot.realtime.segment import checked_name
from qrobot.servo.control_messages import MAX_LINE_BYTES

MAX_CLIENTS: Final = 16
_CREDENTIALS: Final = struct.Struct("3i")  # struct ucred: pid, uid, gid

Answer = Callable[["Visitor", bytes], bytes]
Farewell = Callable[["Visitor"], None]


def control_name(arm: str) -> str:
    """File name of an arm's control socket in the runtime folder."""
    return checked_name(f"{arm}-control")


def connect_to_servo(arm: str, connection: socket.socket) -> None:
    """Connect to the servo of an arm.

    Raises OSError when none listens, LinkError when whoever listens is of another account than the folder.
    """
    with look_into_folder() as folder:
        connection.connect(folder.address_of(control_name(arm)))
        _, uid, _ = peer_credentials(connection)
        if uid != folder.owner:
            raise LinkError(f"whoever answers for the servo of {arm} is account {uid}, not {folder.owner_name}")


def peer_credentials(connection: socket.socket) -> tuple[int, int, int]:
    """Process, account and group at the other end, as the kernel says."""
    pid, uid, gid = _CREDENTIALS.unpack(connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size))
    return pid, uid, gid


class Visitor:
    """One connection."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.pid, self.uid, _ = peer_credentials(connection)
        self._unread = b""

    @property
    def label(self) -> str:
        """Who this is, in words for people."""
        return f"process {self.pid} by way of the control interface"

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
        answer: the reply line to a request line. farewell: called when a connection has ended.

    Raises:
        LinkBusy: somebody listens for that arm already. LinkError: the runtime folder cannot be used.
    """

    def __init__(self, arm: str, answer: Answer, farewell: Farewell) -> None:
        self._answer, self._farewell, self._name = answer, farewell, control_name(arm)
        self._listener = _listen(arm)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ, None)

    def serve(self, seconds: float) -> None:
        """Wait at most so long for something to do, and do it."""
        for key, _ in self._selector.select(seconds):
            if key.data is None:
                self._welcome()
            else:
                self._attend(key.data)

    def close(self) -> None:
        """End every connection and stop listening."""
        for key in list(self._selector.get_map().values()):
            if key.data is not None:
                self._dismiss(key.data)
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
        visitor = Visitor(connection)
        if visitor.uid not in (0, os.geteuid()) or len(self._selector.get_map()) > MAX_CLIENTS:
            connection.close()
            return
        self._selector.register(connection, selectors.EVENT_READ, visitor)

    def _attend(self, visitor: Visitor) -> None:
        lines = visitor.read_lines()
        try:
            for line in lines or ():
                visitor.connection.sendall(self._answer(visitor, line))
        except OSError:  # gone, or does not read what it asked for
            lines = None
        if lines is None:
            self._dismiss(visitor)

    def _dismiss(self, visitor: Visitor) -> None:
        self._selector.unregister(visitor.connection)
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
        raise LinkError(f"no control socket for {arm} in {folder.path}: {error.strerror or error}") from None


def _is_answered(address: str) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        return probe.connect_ex(address) not in (errno.ECONNREFUSED, errno.ENOENT)


def _stop_listening(listener: socket.socket, name: str) -> None:
    listener.close()
    with contextlib.suppress(OSError, LinkError), serve_in_folder() as folder:
        os.unlink(name, dir_fd=folder.fd)
        tidy_folder(folder.path)
