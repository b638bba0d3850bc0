"""Memory that several processes of one program map: anonymous, and gone with the last of them.

A file of the runtime folder has a name, an owner's lock and a life of its own (`realtime.shared_memory`), for peers
that find each other by it. Processors of RCI are children of their program and are handed the descriptor.
"""

from __future__ import annotations

import mmap
import os
from multiprocessing.reduction import DupFd
from typing import Any

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import LinkError

_WORD_BYTES = 8


class MappedArea:
    """Zeroed 64-bit words; a copy sent to a process that is being started maps the same ones.

    Args:
        n_words: how many.
        fd: descriptor of an area that is there already.

    Raises:
        LinkError: there is no room for it.
    """

    def __init__(self, n_words: int, fd: int | None = None) -> None:
        self._n_words = n_words
        self._fd = _reserve(n_words) if fd is None else fd
        mapped = mmap.mmap(self._fd, n_words * _WORD_BYTES, flags=mmap.MAP_SHARED | mmap.MAP_POPULATE)
        self.words: Words = np.frombuffer(mapped, np.int64)

    def close(self) -> None:
        """Give the descriptor back; the memory lives as long as somebody holds `words`."""
        os.close(self._fd)

    def __reduce__(self) -> tuple[Any, ...]:
        return _attach, (self._n_words, DupFd(self._fd))


def _reserve(n_words: int) -> int:
    fd = os.memfd_create("qrobot-rci")
    try:
        os.posix_fallocate(fd, 0, n_words * _WORD_BYTES)
    except OSError as error:
        os.close(fd)
        raise LinkError(f"no room for {n_words * _WORD_BYTES} bytes of shared memory: {error.strerror}") from error
    return fd


def _attach(n_words: int, handed: Any) -> MappedArea:
    return MappedArea(n_words, handed.detach())
