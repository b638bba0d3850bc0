"""A clock that stands still until a test lets time pass."""

from __future__ import annotations

from qrobot.units import NS_PER_MS


class VirtualClock:
    """For whoever takes a function that returns nanoseconds."""

    def __init__(self, now_ns: int = 1_000_000_000) -> None:
        self.now_ns = now_ns

    def __call__(self) -> int:
        return self.now_ns

    def pass_ms(self, duration_ms: float) -> None:
        """Let so much time go by."""
        self.now_ns += round(duration_ms * NS_PER_MS)
