"""One page drives an arm, everybody may look: who has the lease of it, and how it ends."""

from __future__ import annotations

from typing import Final

SILENCE_S: Final = 5.0  # a page that drives says so each second; one that sleeps gives way after this
ANSWER_S: Final = 15.0  # [A] in which a page that drives, and does nothing, may refuse one that asks


class DriverLease:
    """Instants are seconds of one clock.

    Attributes:
        holder: number of the page that drives, None for none.
        asker: number of the page that asks for the lease, None for none.
    """

    def __init__(self) -> None:
        self.holder: int | None = None
        self.asker: int | None = None
        self._heard_s = self._asked_s = 0.0

    def take(self, page: int, now_s: float) -> bool:
        """Ask for the lease, or keep it; False while another page has it, which may give it up or refuse it.

        `expire` first: who loses the lease by that has to let go of the arm.
        """
        if self.holder not in (None, page):
            if self.asker is None:
                self.asker, self._asked_s = page, now_s
            return False
        self._pass_to(page, now_s)
        return True

    def keep(self, page: int) -> int | None:
        """A page does what only a driver does; the page that it has refused by that, None for none."""
        if page != self.holder or self.asker is None:
            return None
        refused, self.asker = self.asker, None
        return refused

    def hear(self, page: int, now_s: float) -> None:
        """A page has said something."""
        if page == self.holder:
            self._heard_s = now_s

    def give(self, page: int) -> bool:
        """A page gives the lease up, or has gone; False when it did not have it. It passes to the page that asks."""
        if page == self.asker:
            self.asker = None
        if page != self.holder:
            return False
        self._pass_to(self.asker, self._heard_s)
        return True

    def expire(self, now_s: float) -> bool:
        """End the lease of a page that was silent for too long, or has not answered one that asks; True when it was."""
        silent = self.holder is not None and now_s - self._heard_s > SILENCE_S
        unanswered = self.asker is not None and now_s - self._asked_s > ANSWER_S
        if silent or unanswered:
            self._pass_to(self.asker, now_s)
        return silent or unanswered

    def _pass_to(self, page: int | None, now_s: float) -> None:
        self.holder, self.asker, self._heard_s = page, None, now_s
