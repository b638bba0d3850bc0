"""The motions of a program in C, which its calls and the samples of its arms show it."""

from __future__ import annotations

from threading import Thread

import numpy as np

from qrobot.arcl.c.objects import ObjectTable

PLACE = 64
CODE = 4
LONG_ENOUGH_S = 0.1  # to show one motion


class Memory:
    """Memory of a program that is an array."""

    def __init__(self) -> None:
        self._bytes = np.zeros(256, np.uint8)

    def doubles(self, place: int, count: int) -> np.ndarray:
        return self._bytes[place:].view(np.float64)[:count]

    def ints(self, place: int) -> np.ndarray:
        return self._bytes[place:].view(np.int32)


class Ended:
    """A motion that has ended, and is shown by another thread when this one looks at it."""

    t0 = 28.0

    def __init__(self, table: ObjectTable) -> None:
        self._other = Thread(target=table.show_motions)

    @property
    def code(self) -> int:
        if self._other.ident is None:
            self._other.start()
            self._other.join(LONG_ENOUGH_S)
        return CODE

    def wait(self) -> None:
        self._other.join()


def test_a_motion_that_has_ended_may_be_shown_by_two_threads() -> None:
    memory = Memory()
    table = ObjectTable(memory)
    motion = Ended(table)
    table.put_motion(PLACE, motion)
    table.show_motions()
    motion.wait()
    assert memory.doubles(PLACE + 8, 1)[0] == Ended.t0
    assert memory.ints(PLACE + 16)[0] == CODE
