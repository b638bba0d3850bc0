"""Calls of a program's functions in shared memory, without a message, while the thread that serves them is awake."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt
from numba import types

from qrobot.c_transport.message import Op
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.clock import monotonic_ns, pause
from qrobot.realtime.jit import jit_disabled, lean_kernel

SLOT_WORDS: Final = 8
_CALLED, _OP, _REF, _PROCESSOR, _DONE, _ASKING, _LOOKING, _WAITING = range(SLOT_WORDS)  # `struct shim_cell`
_NUMBERS: Final = (1 << 31) - 1
_PATIENCE_NS: Final = 50_000  # for a function; then we sleep until it comes back
_SPINS: Final = 50  # some 1 us

if jit_disabled():

    def _processor() -> int:
        """An interpreter does not know."""
        return -1

else:
    _processor = types.ExternalFunction("sched_getcpu", types.int32())


# What has become of a call; plain numbers, as this is on the way of every call.
DONE: Final = 0
ASKING: Final = 1  # the function asks the engine: that and its end come as messages
UNSEEN: Final = 2  # nobody looks, or it takes long: a message has to follow, which is answered by one


@lean_kernel
def _call(cell: Any, number: int, op: int, ref: int) -> int:
    """Put a call into the cell, int64[::1]; what has become of it after at most `_PATIENCE_NS`."""
    cell[_OP], cell[_REF], cell[_PROCESSOR] = op, ref, _processor()
    store_release(cell, _CALLED, number)
    if load_acquire(cell, _LOOKING) == 0:
        return UNSEEN
    deadline = monotonic_ns() + _PATIENCE_NS
    while monotonic_ns() < deadline:
        for _ in range(_SPINS):
            if load_acquire(cell, _DONE) == number:
                return DONE
            pause()
        if load_acquire(cell, _ASKING) == number:
            return ASKING
    return UNSEEN


class CallbackSlot:
    """The engine's end of it.

    Args:
        words: `struct shim_cell`, shared with the program. Shape (SLOT_WORDS,).

    Attributes:
        number: of the newest call, 1 to 2^31 - 1 and round again; 0 says that calls come by messages alone.
    """

    def __init__(self, words: npt.NDArray[np.int64]) -> None:
        self._words = words
        self._jit = not jit_disabled()  # an interpreter's writes are in no order
        self.number = 0
        if self._jit:  # no sample may wait for the compiler
            _call(np.zeros(SLOT_WORDS, np.int64), 0, 0, 0)

    def call(self, op: Op, ref: int) -> int:
        """Have a function called: DONE, ASKING or UNSEEN."""
        if not self._jit:
            return UNSEEN
        self.number = self.number % _NUMBERS + 1
        return _call(self._words, self.number, int(op), ref)  # an enumeration would cost Numba 100 us

    def others_wait(self) -> bool:
        """True while threads of the program wait for their turn to ask."""
        return bool(self._words[_WAITING] > 0)
