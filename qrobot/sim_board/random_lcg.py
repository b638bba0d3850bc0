"""Lehmer's random numbers inside kernels, bit-identical everywhere."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from qrobot.realtime.jit import lean_kernel

# Park and Miller's minimal standard generator, 1993 multiplier: exact in 64-bit integers, so runs are bit-identical.
_LEHMER_MULTIPLIER: Final = 48271
_LEHMER_MODULUS: Final = 2147483647


def first_state(seed: int) -> NDArray[np.int64]:
    """State of a generator. Shape (1,), 1..2^31-2."""
    return np.array([1 + seed % (_LEHMER_MODULUS - 1)])


@lean_kernel
def uniform(random: NDArray[np.int64]) -> float:
    """Next number of the generator, in (0, 1)."""
    random[0] = random[0] * _LEHMER_MULTIPLIER % _LEHMER_MODULUS
    return float(random[0] / _LEHMER_MODULUS)


@lean_kernel
def normal(random: NDArray[np.int64]) -> float:
    """Standard normal to within the tails: twelve uniforms less six (bounded by 6, as noise of a converter is)."""
    total = -6.0
    for _ in range(12):
        total += uniform(random)
    return total
