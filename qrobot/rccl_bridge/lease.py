"""The right to command: one lease per robot, shared by all sessions of its bridge."""

from __future__ import annotations

from typing import Protocol

from qrobot.errors import LinkError


class ArmAuthority(Protocol):
    """The right to command the arm, for which the bridge competes with others on this machine."""

    def take(self, label: str) -> None:
        """Hold it. Raises LinkBusy naming who does, or LinkError when nobody can."""

    def release(self) -> None:
        """Let go."""


class Lease:
    """Right to command with at most one holder, who keeps it until they let go.

    Args:
        authority: held for as long as the lease is; None where the bridge is the only way to the arm.

    Attributes:
        refusal: why the last `take` failed, in words for people.
        path_waits: the holder waits for somebody to confirm that the arm may go back to its path.
    """

    def __init__(self, authority: ArmAuthority | None = None) -> None:
        self.refusal, self.path_waits = "", False
        self._authority = authority
        self._label = ""
        self._holder: object = None
        self._stream = 0

    @property
    def taken(self) -> bool:
        """Somebody commands."""
        return self._holder is not None

    def take(self, who: object, label: str) -> bool:
        """Give the lease to `who`; False when somebody else has it."""
        if self._holder is not None and self._holder is not who:
            self.refusal = f"is commanded by {self._label}"
            return False
        if self._authority is not None:
            try:
                self._authority.take(f"the bridge for {label}")  # of whose process it tells
            except LinkError as error:
                self.refusal = f"cannot be commanded: {error}"
                return False
        self._holder, self._label = who, label
        return True

    def release(self, who: object) -> bool:
        """Let go; False when `who` did not hold it."""
        if self._holder is not who or who is None:
            return False
        self._holder, self._label, self.path_waits = None, "", False
        if self._authority is not None:
            self._authority.release()
        return True

    def new_stream(self, now_ns: int) -> int:
        """A number for the next run of setpoints, larger than all before.

        It starts from the monotonic clock, so that a restarted bridge does not repeat the streams of the old one.
        """
        self._stream = max(self._stream + 1, now_ns)
        return self._stream
