"""A name that one process of an account holds at a time, also when the folder of its files has been removed.

It is an address among Linux's abstract sockets (unix(7)): there is no file that somebody could remove, and it goes with
the process. Each runtime folder has names of its own.
"""

from __future__ import annotations

import errno
import hashlib
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

from qrobot.realtime.peer_credentials import peer_credentials
from qrobot.realtime.runtime_folder import runtime_path

UNKNOWN: Final = -1
_MOST_VISITORS: Final = 4096  # that ask who holds a name, during its life
_TRIES: Final = 100


@contextmanager
def claimed(name: str) -> Iterator[int]:
    """Hold `name` inside the block, unless another process of this account does: its id, or 0 when it is ours.

    An id that cannot be told is UNKNOWN. What another account holds there says nothing, and keeps nobody from anything.
    """
    key = hashlib.sha256(f"{runtime_path()}\0{name}".encode()).hexdigest()[:32]
    address = f"\0qrobot-{os.geteuid()}-{key}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as held:
        yield _hold(held, address)


def _hold(held: socket.socket, address: str) -> int:
    """Hold an address; the process of this account that does so already, 0 if none does."""
    for _ in range(_TRIES):
        try:
            held.bind(address)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                return 0
        else:
            held.listen(_MOST_VISITORS)
            return 0
        with suppress(ConnectionRefusedError):  # it has just ended, or does not listen yet
            return _holder(address)
        os.sched_yield()
    return 0  # of somebody who lets nobody in


def _holder(address: str) -> int:
    """The process of this account that holds an address, 0 for one of another. Raises ConnectionRefusedError."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as visitor:
        visitor.setblocking(False)
        try:
            visitor.connect(address)
        except BlockingIOError:  # more have asked than the kernel keeps, and nobody is ever answered
            return UNKNOWN
        pid, uid, _ = peer_credentials(visitor)
    return pid if uid == os.geteuid() else 0
