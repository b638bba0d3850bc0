"""Requests of one kind, in the order in which they were made; of those that wait only the newest is done."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

_log = logging.getLogger(__name__)
LaneWork = Callable[[], None]


class RequestLane:
    """Does one request at a time, in a thread that ends when there is no more to do. Safe in threads.

    Args:
        name: of the kind, for the thread.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._lock = threading.Lock()
        self._waiting: LaneWork | None = None
        self._works = False

    def put(self, request: LaneWork) -> None:
        """Do it when the one under way is done, in place of what waits; returns at once."""
        with self._lock:
            self._waiting = request
            begins, self._works = not self._works, True
        if begins:
            try:
                threading.Thread(target=self._work, name=f"pendant-{self._name}", daemon=True).start()
            except RuntimeError:  # no more threads: what is asked for later finds a lane that may begin
                with self._lock:
                    self._works = False
                raise

    def drop(self) -> None:
        """Forget what waits; what is under way goes on."""
        with self._lock:
            self._waiting = None

    def _next(self) -> LaneWork | None:
        with self._lock:
            request, self._waiting = self._waiting, None
            self._works = request is not None
        return request

    def _work(self) -> None:
        while (request := self._next()) is not None:
            try:
                request()
            except Exception:  # the next request must not find a lane that is never free again
                _log.exception("a request of kind %s failed", self._name)
