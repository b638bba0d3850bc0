"""A TCP connection that can be cut, and garbled, in the middle."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from contextlib import suppress

Spoil = Callable[[bytes], bytes]


def as_it_came(data: bytes) -> bytes:
    """Change nothing."""
    return data


class Relay:
    """Listens on loopback and hands everything to `target` and back, as a context manager.

    Attributes:
        cut: True swallows everything, both ways and silently; the far end sees its connection close.
        spoil: done to each answer on its way back.
    """

    def __init__(self, target: tuple[str, int]) -> None:
        self._target = target
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listener.getsockname()[1]
        self.cut = self._ended = False
        self.spoil: Spoil = as_it_came
        self._sockets: list[socket.socket] = []
        self._threads = [threading.Thread(target=self._listen)]

    def break_now(self) -> None:
        """Cut it; the far end's connections close, the near end's stay silent."""
        self.cut = True
        for far in self._sockets[1::2]:
            with suppress(OSError):
                far.shutdown(socket.SHUT_RDWR)

    def mend(self) -> None:
        """Hand on again; connections that were cut are closed, for what was swallowed is lost."""
        sockets, self._sockets = self._sockets, []
        for one in sockets:
            _end(one)
        self.cut = False

    def __enter__(self) -> Relay:
        self._threads[0].start()
        return self

    def __exit__(self, *_error: object) -> None:
        self._ended = True
        _end(self._listener)
        self._threads[0].join()  # then no connection comes any more
        for one in self._sockets:
            _end(one)
        for thread in self._threads:
            thread.join()

    def _listen(self) -> None:
        with suppress(OSError):
            while not self._ended:
                near, _ = self._listener.accept()
                far = self._far_end(near)
                for one in (near, far):
                    one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._sockets.append(one)
                self._start(near, far, as_it_came)
                self._start(far, near, self._spoil)

    def _far_end(self, near: socket.socket) -> socket.socket:
        """A connection to the target; without one the near end is closed. Raises OSError."""
        try:
            return socket.create_connection(self._target)
        except OSError:
            near.close()
            raise

    def _spoil(self, data: bytes) -> bytes:
        return self.spoil(data)

    def _start(self, source: socket.socket, sink: socket.socket, change: Spoil) -> None:
        thread = threading.Thread(target=self._pump, args=(source, sink, change))
        self._threads.append(thread)
        thread.start()

    def _pump(self, source: socket.socket, sink: socket.socket, change: Spoil) -> None:
        with suppress(OSError):
            while data := source.recv(4096):
                if not self.cut:
                    sink.sendall(change(data))
        if not self.cut:  # a reset is an end, too: a server closes what was idle for long as another request comes
            with suppress(OSError):
                sink.shutdown(socket.SHUT_RDWR)


def _end(one: socket.socket) -> None:
    with suppress(OSError):
        one.shutdown(socket.SHUT_RDWR)
    one.close()
