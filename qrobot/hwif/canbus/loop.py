"""A CANopen network without threads: its periodic messages are sent by the loop that serves it.

A heartbeat from a thread of its own would go on when the loop hangs, and so tell nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import canopen

if TYPE_CHECKING:
    import can


class LoopTimer:
    """A message to be sent again and again; for canopen, a periodic task."""

    def __init__(self, network: LoopNetwork, can_id: int, data: bytes, period_ns: int) -> None:
        self._network, self._can_id, self._data, self._period_ns = network, can_id, bytes(data), period_ns
        self._due_ns = 0

    def update(self, data: bytes) -> None:
        """Send this from now on."""
        self._data = bytes(data)

    def stop(self) -> None:
        """Send nothing more."""
        self._network.timers.discard(self)

    def fire(self, now_ns: int) -> None:
        """Send it when it is due."""
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + self._period_ns
            self._network.send_message(self._can_id, self._data)


class LoopNetwork(canopen.Network):
    """A network whose owner hands received frames to `notify` and calls `fire`."""

    def __init__(self, bus: can.BusABC) -> None:
        super().__init__(bus)
        self.timers: set[LoopTimer] = set()

    def send_periodic(  # type: ignore[override]
        self, can_id: int, data: bytes, period: float, remote: bool = False
    ) -> LoopTimer:
        """Send `data` every `period` seconds, as far as `fire` is called that often."""
        if remote:
            raise ValueError("no node of ours asks for frames by remote frames")
        timer = LoopTimer(self, can_id, data, int(period * 1e9))
        self.timers.add(timer)
        return timer

    def fire(self, now_ns: int) -> None:
        """Send what is due."""
        for timer in list(self.timers):
            timer.fire(now_ns)

    def stop_timers(self) -> None:
        """Send nothing periodic any more."""
        self.timers.clear()
