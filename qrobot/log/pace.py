"""Fewer rows than the servo makes: the first of each period of a slower rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from qrobot.units import NS_PER_S


class Pace:
    """Picks rows, `rate_hz` of them a second, from one batch to the next."""

    def __init__(self, rate_hz: int) -> None:
        self._rate_hz, self._last = rate_hz, -1

    def due(self, t_ns: NDArray[np.int64]) -> list[int]:
        """Indices of the first row of each period, of rows at `t_ns` in order. Shape (m,)."""
        if not t_ns.size:
            return []
        period = t_ns * self._rate_hz // NS_PER_S
        first = np.diff(period, prepend=self._last) != 0
        self._last = int(period[-1])
        return [int(k) for k in np.flatnonzero(first)]
