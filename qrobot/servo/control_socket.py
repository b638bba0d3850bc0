"""The control interface's sockets: lines in, lines out, never waiting for anybody.

Unix sockets in the abstract namespace: no file to leave behind, and no way in from another machine. Only processes of
the servo's own user, and root, are let in.
"""

from __future__ import annotations

import os
import selectors
import socket
import struct
from collections.abc import Callable
from types import TracebackType
from typing import Final

from qrobot.errors import LinkBusy
from qrobot.servo.control_messages import MAX_LINE_BYTES

MAX_CLIENTS: Final = 16
_CREDENTIALS: Final = struct.Struct("3i")  # struct ucred: pid, uid, gid

Answer = Callable[["Visitor", bytes], bytes]
Farewell = Callable[["Visitor"], None]


def control_address(arm: str) -> str:
    """Abstract address of an arm's control socket."""
    return f"\0qrobot-{arm}-control"


class Visitor:
    """One connection."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection = connection
        self.pid, self.uid, _ = _CREDENTIALS.unpack(
            connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        )
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
        LinkBusy: somebody listens for that arm already.
    """

    def __init__(self, arm: str, answer: Answer, farewell: Farewell) -> None:
        self._answer, self._farewell = answer, farewell
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._listener.bind(control_address(arm))
        except OSError:
            self._listener.close()
            raise LinkBusy(f"the control socket of {arm} is in use: does another servo run?") from None
        self._listener.listen(MAX_CLIENTS)
        self._listener.setblocking(False)
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
        self._listener.close()

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
