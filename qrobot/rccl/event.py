"""Event counts: what the trajectory generator signals and the program waits for (Hayward & Paul 1986, section 3.3)."""

from __future__ import annotations


class Event:
    """A count of signals not yet waited for.

    Attributes:
        name: for people.
        count: how often it was signalled and not taken; a program may set it, usually to 0.
    """

    def __init__(self, name: str, count: int = 0) -> None:
        self.name = name
        self.count = count

    def signal(self) -> None:
        """Count one more event."""
        self.count += 1

    def take(self) -> bool:
        """Use up one signal; False when there is none."""
        if self.count <= 0:
            return False
        self.count -= 1
        return True

    def __repr__(self) -> str:
        return f"Event({self.name!r}, count={self.count})"


class Level(Event):
    """An event that stays true until something new begins, however often it is waited for."""

    def take(self) -> bool:
        """True while it is so."""
        return self.count > 0
