"""Who commands. One lease per robot, shared by all sessions of its bridge."""

from __future__ import annotations


class Lease:
    """At most one holder; whoever has it keeps it until they let go.

    Attributes:
        label: the holder in words for people, "" when nobody commands.
    """

    def __init__(self) -> None:
        self.label = ""
        self._holder: object = None
        self._stream = 0

    @property
    def taken(self) -> bool:
        """Somebody commands."""
        return self._holder is not None

    def take(self, who: object, label: str) -> bool:
        """Give the lease to `who`; False when somebody else has it."""
        if self._holder is not None and self._holder is not who:
            return False
        self._holder, self.label = who, label
        return True

    def release(self, who: object) -> bool:
        """Let go; False when `who` did not hold it."""
        if self._holder is not who or who is None:
            return False
        self._holder, self.label = None, ""
        return True

    def new_stream(self, now_ns: int) -> int:
        """A number for the next run of setpoints, larger than all before.

        It starts from the monotonic clock, so that a restarted bridge does not repeat the streams of the old one.
        """
        self._stream = max(self._stream + 1, now_ns)
        return self._stream
