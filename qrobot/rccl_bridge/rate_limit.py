"""Limit of the rate of messages, so that a flood of trouble does not become a flood of lines."""

from __future__ import annotations

from qrobot.units import NS_PER_S


class RateLimit:
    """Lets `per_second` events through in each second."""

    def __init__(self, per_second: int = 10) -> None:
        self._per_second = per_second
        self._second = -1
        self._used = 0

    def allows(self, now_ns: int) -> bool:
        """True when one more event may pass."""
        second = now_ns // NS_PER_S
        if second != self._second:
            self._second, self._used = second, 0
        self._used += 1
        return self._used <= self._per_second
