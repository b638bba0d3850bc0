"""A name that one process of an account holds at a time, also when the folder of its files has been removed.

It is an address among Linux's abstract sockets (unix(7)): there is no file that somebody could remove, and it goes with
the process. Each runtime folder has names of its own.
"""

from __future__ import annotations

import errno
import hashlib
import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

from qrobot.realtime.runtime_folder import runtime_path

_CREDENTIALS: Final = struct.Struct("3i")  # struct ucred of unix(7)


@contextmanager
def claimed(name: str) -> Iterator[int]:
    """Hold `name` inside the block, unless another process of this account does: its id, or 0 when it is ours.

    What another account holds there says nothing, and keeps nobody from anything.
    """
    key = hashlib.sha256(f"{runtime_path()}\0{name}".encode()).hexdigest()[:32]
    address = f"\0qrobot-{os.geteuid()}-{key}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as held:
        try:
            held.bind(address)
            held.listen()
            holder = 0
        except OSError as error:
            holder = _holder(address) if error.errno == errno.EADDRINUSE else 0
        yield holder


def _holder(address: str) -> int:
    """The process of this account that holds an address, 0 if none does."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as visitor:
        visitor.setblocking(False)
        try:
            visitor.connect(address)
        except OSError:  # it has ended, or is somebody's who lets nobody in
            return 0
        told = visitor.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, uid, _ = _CREDENTIALS.unpack(told)
    return pid if uid == os.geteuid() else 0
