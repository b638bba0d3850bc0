"""The motions of a program in C, which its calls and the samples of its arms show it."""

from __future__ import annotations

from threading import Event, Lock, Thread

import numpy as np
import pytest

from qrobot.arcl.c import objects
from qrobot.arcl.c.objects import ObjectTable
from tests.support.patience import PATIENCE_S

PLACE = 64
CODE = 4


class Memory:
    """Memory of a program that is an array."""

    def __init__(self) -> None:
        self._bytes = np.zeros(256, np.uint8)

    def doubles(self, place: int, count: int) -> np.ndarray:
        return self._bytes[place:].view(np.float64)[:count]

    def ints(self, place: int) -> np.ndarray:
        return self._bytes[place:].view(np.int32)


class TellingLock:
    """A lock that tells when somebody has to wait for it."""

    def __init__(self, waited_for: Event) -> None:
        self._lock, self._waited_for = Lock(), waited_for

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            self._waited_for.set()
            self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()


class Ended:
    """A motion that has ended, and is shown by another thread when this one looks at it.

    Args:
        table: that has it.
        settled: the other thread waits for this one, or is done.
    """

    t0 = 28.0

    def __init__(self, table: ObjectTable, settled: Event) -> None:
        self._table, self._settled = table, settled
        self._other = Thread(target=self._show)

    @property
    def code(self) -> int:
        if self._other.ident is None:
            self._other.start()
            assert self._settled.wait(PATIENCE_S)
        return CODE

    def wait(self) -> None:
        self._other.join()

    def _show(self) -> None:
        self._table.show_motions()
        self._settled.set()


def test_a_motion_that_has_ended_may_be_shown_by_two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    settled = Event()
    monkeypatch.setattr(objects, "Lock", lambda: TellingLock(settled))
    memory = Memory()
    table = ObjectTable(memory)
    motion = Ended(table, settled)
    table.put_motion(PLACE, motion)
    table.show_motions()
    motion.wait()
    assert memory.doubles(PLACE + 8, 1)[0] == Ended.t0
    assert memory.ints(PLACE + 16)[0] == CODE
