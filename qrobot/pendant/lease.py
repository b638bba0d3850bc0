"""One page drives an arm, everybody may look: who has the lease of it, and how it ends."""

from __future__ import annotations

from typing import Final

SILENCE_S: Final = 5.0  # a page that drives says so each second; one that sleeps gives way after this


class DriverLease:
    """Instants are seconds of one clock.

    Attributes:
        holder: number of the page that drives, None for none.
    """

    def __init__(self) -> None:
        self.holder: int | None = None
        self._heard_s = 0.0

    def take(self, page: int, now_s: float) -> bool:
        """Ask for the lease; False while another page has it."""
        self.expire(now_s)
        if self.holder not in (None, page):
            return False
        self.holder, self._heard_s = page, now_s
        return True

    def hear(self, page: int, now_s: float) -> None:
        """A page has said something."""
        if page == self.holder:
            self._heard_s = now_s

    def give(self, page: int) -> bool:
        """A page gives the lease up, or has gone; False when it did not have it."""
        if page != self.holder:
            return False
        self.holder = None
        return True

    def expire(self, now_s: float) -> bool:
        """End the lease of a page that has been silent for too long; True when it was."""
        if self.holder is None or now_s - self._heard_s <= SILENCE_S:
            return False
        self.holder = None
        return True
