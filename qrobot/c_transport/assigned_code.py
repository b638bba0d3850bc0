"""An integer of a program that the engine takes whenever it finds one: `nextmove`."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from qrobot.c_transport.memory import Ints32
from qrobot.realtime.atomics import exchange
from qrobot.realtime.jit import lean_kernel

NONE: Final = 0


@lean_kernel
def _take(words: Any) -> int:
    """The value of a word, int32[::1], which is NONE then."""
    return exchange(words, 0, NONE)


class AssignedCode:
    """A code that the program assigns and the engine takes, once, though threads of it look at the same time, and
    though the program assigns another one just then.

    Args:
        words: of the program. Shape (1,).
    """

    def __init__(self, words: Ints32) -> None:
        self._words = words
        _take(np.zeros(1, np.int32))  # no sample may wait for the compiler

    def take(self) -> int:
        """The code, which is NONE then; NONE: there is none."""
        return int(_take(self._words)) if self._words[0] != NONE else NONE
