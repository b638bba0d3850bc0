"""Room for clients: observers take places, and the commander's is kept free for it."""

from __future__ import annotations


class Places:
    """Places of observers, shared by all sessions of a bridge.

    Args:
        max_clients: observers and the commander together.
    """

    def __init__(self, max_clients: int) -> None:
        self.max_observers = max_clients - 1
        self._observers: set[object] = set()

    def take(self, who: object) -> bool:
        """Give an observer a place; False when none is left."""
        if len(self._observers) >= self.max_observers:
            return False
        self._observers.add(who)
        return True

    def leave(self, who: object) -> None:
        """The place falls free; nothing happens when `who` has none."""
        self._observers.discard(who)
