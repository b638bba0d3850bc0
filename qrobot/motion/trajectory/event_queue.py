"""Events since the sample before, collected until the next one goes out."""

from __future__ import annotations

from collections.abc import Iterable

from qrobot.motion.event import EventKind, MotionEvent, Termination
from qrobot.motion.request import MoveRequest


class EventQueue:
    """Events of one generator, oldest first."""

    def __init__(self) -> None:
        self._events: list[MotionEvent] = []
        self._idle_told = True

    @property
    def pending(self) -> bool:
        """Something has happened, or was asked for, that the next samples tell."""
        return bool(self._events) or not self._idle_told

    def expect(self) -> None:
        """Something was asked for: tell when all is done."""
        self._idle_told = False

    def begun(self, request: MoveRequest) -> None:
        """The transition into its segment begins."""
        self._events.append(MotionEvent(EventKind.BEGUN, request))

    def interrupted(self, request: MoveRequest, code: int) -> None:
        """Note that a request is cut short: it will end with `code` when the arm has come to rest."""
        self._events.append(MotionEvent(EventKind.INTERRUPTED, request, code))

    def ended(self, request: MoveRequest, code: int, why: str = "") -> None:
        """Note that a request ended with `code`."""
        self._events.append(MotionEvent(EventKind.ENDED, request, code, why))

    def lost(self, request: MoveRequest | None, code: int, why: str) -> None:
        """The goal of a request that had arrived cannot be followed any further."""
        self._events.append(MotionEvent(EventKind.LOST, request, code, why))

    def dropped(self, requests: Iterable[MoveRequest]) -> None:
        """Note that requests ended without having begun."""
        for request in requests:
            self.ended(request, Termination.STOPPED)

    def drain(self, busy: bool) -> tuple[MotionEvent, ...]:
        """All there is, once; with the end of all motions if that came."""
        if not busy and not self._idle_told:
            self._idle_told = True
            self._events.append(MotionEvent(EventKind.IDLE))
        events, self._events = tuple(self._events), []
        return events
