"""The door of the pendant's server: connections of which nobody knows yet whose they are.

Every account of this machine may connect, and say nothing, or what the gate refuses. Such strangers are few, and stay
for a moment; of too many the one that came first goes, for a browser asks as soon as it has connected. Whoever the gate
has let in is no stranger, and stays as long as the server likes.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

MOST_STRANGERS: Final = 64  # [A] far below the files that a process may open, more than a browser connects at once
PATIENCE_S: Final = 5.0  # [A] as long as uvicorn waits for the next request of a connection

FarEnd = tuple[str, int]


@dataclass(frozen=True)
class _Stranger:
    transport: asyncio.Transport
    leaves: asyncio.TimerHandle


class Door:
    """Belongs to one server, inside its event loop.

    Args:
        most: strangers at a time.
        patience_s: time that each of them has.

    Attributes:
        patience_s: of those that come from now on.
    """

    def __init__(self, most: int = MOST_STRANGERS, patience_s: float = PATIENCE_S) -> None:
        self._most, self.patience_s = most, patience_s
        self._strangers: dict[FarEnd, _Stranger] = {}  # in the order in which they came

    def come(self, transport: asyncio.Transport) -> None:
        """A connection was accepted."""
        far = _far_end(transport.get_extra_info("peername"))
        self._forget(far)
        while len(self._strangers) >= self._most:
            self._send_away(next(iter(self._strangers)))
        leaves = asyncio.get_running_loop().call_later(self.patience_s, self._send_away, far)
        self._strangers[far] = _Stranger(transport, leaves)

    def let_in(self, scope: Mapping[str, Any]) -> None:
        """The gate lets a request in; see the ASGI specification."""
        if (client := scope.get("client")) is not None:
            self._forget(_far_end(client))

    def go(self, transport: asyncio.Transport) -> None:
        """A connection has ended."""
        far = _far_end(transport.get_extra_info("peername"))
        if (stranger := self._strangers.get(far)) is not None and stranger.transport is transport:
            self._forget(far)

    def _send_away(self, far: FarEnd) -> None:
        transport = self._strangers[far].transport
        self._forget(far)
        transport.abort()

    def _forget(self, far: FarEnd) -> None:
        if (stranger := self._strangers.pop(far, None)) is not None:
            stranger.leaves.cancel()


def _far_end(address: Any) -> FarEnd:
    return str(address[0]), int(address[1])
