"""Compiled control functions, which are called with a tick and the numbers of their task."""

from __future__ import annotations

import numpy as np

from qrobot.arrays import Floats
from qrobot.realtime.clock import monotonic_ns, sleep_until_ns
from qrobot.realtime.jit import lean_kernel

N_TICKS = 64
HANG_NS = 2_000_000_000


@lean_kernel
def note(tick: int, memory: Floats) -> None:
    """Count a run in word 0, and its tick modulo N_TICKS behind it."""
    memory[0] += 1.0
    memory[1 + tick % N_TICKS] += 1.0


@lean_kernel
def double(_tick: int, memory: Floats) -> None:
    """Let the last word be twice the first."""
    memory[memory.size - 1] = 2.0 * memory[0]


@lean_kernel
def hang(_tick: int, _memory: Floats) -> None:
    """Take two seconds."""
    sleep_until_ns(monotonic_ns() + HANG_NS)


@lean_kernel
def of_three(_tick: int, _memory: Floats, _more: float) -> None:
    """Take too much."""


@lean_kernel
def square(_tick: int, memory: Floats) -> None:
    """Ask for a product of vectors, for which Numba needs SciPy."""
    memory[0] = np.dot(memory, memory)


@lean_kernel
def fail(tick: int, _memory: Floats) -> None:
    """Raise from tick 3 on."""
    if tick >= 3:
        raise ValueError("the compiled function cannot go on")
