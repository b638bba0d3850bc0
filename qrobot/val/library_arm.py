"""Memory of a `ValArm`, whichever library moves it: motions under way, those that were stopped, and its rest."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Generic, TypeVar

from qrobot.val.arm import SETTLING_S, Destination

M = TypeVar("M")


@dataclass(frozen=True, eq=False)
class MotionUnderWay(Generic[M]):
    """A motion that has not ended.

    Attributes:
        destination: its goal and manner.
        motion: what the library calls it.
    """

    destination: Destination
    motion: M


class LibraryArm(ABC, Generic[M]):
    """An arm of a library, whose motions are of type `M`; see `ValArm` for what it offers."""

    def __init__(self) -> None:
        self._going: list[MotionUnderWay[M]] = []
        self._stopped: list[Destination] = []
        self._failure = ""
        self._rest_since_s: float | None = None
        self._override = 100.0

    @property
    @abstractmethod
    def time_s(self) -> float:
        """See `ValArm`."""

    @property
    @abstractmethod
    def off_path(self) -> bool:
        """See `ValArm`."""

    @property
    def idle(self) -> bool:
        """See `ValArm`; the last setpoints are still under way when a motion is completed."""
        if self.off_path or self._moves():
            self._rest_since_s = None
        elif self._rest_since_s is None:
            self._rest_since_s = self.time_s
        return self._rest_since_s is not None and self.time_s - self._rest_since_s >= SETTLING_S

    @property
    def override(self) -> float:
        """See `ValArm`."""
        return self._override

    @override.setter
    def override(self, percent: float) -> None:
        """Raises MotionError: that is no percentage."""
        self._set_override(percent)
        self._override = percent

    def unfinished(self) -> list[Destination]:
        """See `ValArm`."""
        self._look()
        stopped, self._stopped = self._stopped, []
        going, self._going = self._going, []
        return stopped + [each.destination for each in going]

    def failure(self) -> str:
        """See `ValArm`."""
        self._look()
        failure, self._failure = self._failure, ""
        return failure

    @abstractmethod
    def _moves(self) -> bool:
        """The library has still to move the arm."""

    @abstractmethod
    def _set_override(self, percent: float) -> None:
        """Tell the library. Raises MotionError: that is no percentage."""

    @abstractmethod
    def _look(self) -> None:
        """Take note of motions that have ended: of `_going` they go to `_stopped` when it was before their end."""
