"""Values of transforms in memory that a program and the process of its generator share.

Each has a cell with a slot for either process, so that a slot has one writer and nobody waits: a reader takes the slot
that was written last. A value is seen whole, as `seqlock` says, or that of before once more.
"""

from __future__ import annotations

import mmap
import os
from typing import Any, Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import LinkError
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.seqlock import begin_write, end_write, seqlock_read
from qrobot.realtime.structure import WORD_BYTES, dtype_of, floats, record_in, word

CELLS: Final = 512  # [A] variable transforms of one program that motions name at a time
PROGRAM, GENERATOR = 0, 1  # slots
_VALUES: Final = 16
_VERSION: Final = _VALUES  # place of the number that rises with each value of the cell


class Slot:
    """Value that one of the two processes has written."""

    sequence: int = word(own_line=True)
    content: Floats = floats(_VALUES + 1)


_SLOT: Final = dtype_of(Slot)
_SLOT_WORDS: Final = _SLOT.itemsize // WORD_BYTES


@lean_kernel
def _put(slot: Any, other: Any, value: Floats) -> None:
    """Write a value (16,) that is newer than what either slot has."""
    version = max(slot.content[_VERSION], other.content[_VERSION]) + 1.0
    begin_write(slot)
    for i in range(_VALUES):
        slot.content[i] = value[i]
    slot.content[_VERSION] = version
    end_write(slot)


@lean_kernel
def _take(slot: Any, other: Any, out: Floats, spare: Floats) -> bool:
    """Read the newer slot into `out` (17,); `spare` (17,) is scratch. False: each try met a writer."""
    if not seqlock_read(slot, slot.content, out) or not seqlock_read(other, other.content, spare):
        return False
    if spare[_VERSION] > out[_VERSION]:
        for i in range(out.size):
            out[i] = spare[i]
    return True


class ValueCell:
    """The value of one transform, as both processes see it.

    Args:
        words: of all cells.
        number: of the cell.
        side: PROGRAM or GENERATOR.
    """

    def __init__(self, words: Any, number: int, side: int) -> None:
        at = 2 * number * _SLOT_WORDS
        slots = [record_in(words, _SLOT, at + k * _SLOT_WORDS) for k in (PROGRAM, GENERATOR)]
        self._mine, self._theirs = slots[side], slots[1 - side]
        self._out, self._spare = np.empty(_VALUES + 1), np.empty(_VALUES + 1)
        self._newest = np.eye(4)

    def get(self) -> Floats:
        """The newest value, not to be written to. Shape (4, 4)."""
        if _take(self._mine, self._theirs, self._out, self._spare):
            self._newest = self._out[:_VALUES].reshape(4, 4).copy()
            self._newest.flags.writeable = False
        return self._newest

    def set(self, value: Floats) -> None:
        """Give it another value, shape (4, 4), in one step."""
        _put(self._mine, self._theirs, np.ascontiguousarray(value, np.float64).reshape(_VALUES))


class ValueCells:
    """The cells of one program and its generator.

    Args:
        side: PROGRAM or GENERATOR.
        fd: of the memory; made where it is left out. It is closed with this object.

    Raises:
        LinkError: there is no room for it.
    """

    def __init__(self, side: int, fd: int | None = None) -> None:
        n_bytes = 2 * CELLS * _SLOT_WORDS * WORD_BYTES
        self.fd = _reserve(n_bytes) if fd is None else fd
        self._side = side
        self._words = np.frombuffer(mmap.mmap(self.fd, n_bytes, flags=mmap.MAP_SHARED | mmap.MAP_POPULATE), np.int64)

    def cell(self, number: int) -> ValueCell:
        """The cell of that number, from 0."""
        return ValueCell(self._words, number, self._side)

    def close(self) -> None:
        """Give the descriptor back; the memory lives as long as somebody holds a cell."""
        os.close(self.fd)


def warm_up() -> None:
    """No sample may wait for the compiler."""
    words = np.zeros(2 * _SLOT_WORDS, np.int64)
    cell = ValueCell(words, 0, PROGRAM)
    cell.set(np.eye(4))
    cell.get()


def _reserve(n_bytes: int) -> int:
    fd = os.memfd_create("qrobot-transforms")
    try:
        os.posix_fallocate(fd, 0, n_bytes)
    except OSError as error:
        os.close(fd)
        raise LinkError(f"no room for {n_bytes} bytes of shared memory: {error.strerror}") from error
    return fd
