"""A bench as the far end of a transport, and a bus to it in the same process that can be cut."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable

import numpy as np

from qrobot.arrays import Words
from qrobot.errors import LinkError, LinkLost
from qrobot.hwif.board_memory import PANEL_MICRO, Lane, fetch_image
from qrobot.hwif.bus import BoardFacts, Endpoint, Operations, check_image
from qrobot.hwif.image import make_image
from qrobot.hwif.lanes import post_operations
from qrobot.hwif.operations import OP_FIELDS
from tests.support.bench import Bench

Row = tuple[int, int, int]


def rows_of(rows: Iterable[Row]) -> Operations:
    """Operations as a bus takes them. Shape (k, OP_FIELDS)."""
    return np.array(list(rows), np.int64).reshape(-1, OP_FIELDS)


def nothing() -> None:
    """Happen not at all."""


def at_once(work: Callable[[], None]) -> None:
    """Do here what would be done in a thread of its own."""
    work()


class BenchEndpoint:
    """A `Bench` as the far end of a transport: it ticks once for each list of operations it is given.

    What the board does by itself (`turn`, `set_volts`) and what is asked of it over the transport exclude each other,
    for a server may run in a thread.

    Attributes:
        lists: the lists of operations it was given.
        standing: True holds the board: it takes operations and shows its last image again.
        gone: True takes the board away from the server that holds this endpoint.
        before, after: called when operations have come, before and after they are applied; for cutting the transport.
    """

    def __init__(self, bench: Bench | None = None) -> None:
        self.bench = bench or Bench()
        self.lists: list[list[Row]] = []
        self.standing = self.gone = False
        self.before: Callable[[], None] = nothing
        self.after: Callable[[], None] = nothing
        self._lock = threading.RLock()

    @property
    def applied(self) -> list[Row]:
        """All operations so far, in the order they came."""
        return [row for rows in self.lists for row in rows]

    @property
    def illegal(self) -> int:
        """Operations the board has ignored and counted."""
        return int(self.bench.memory.facts.illegal_ops)

    def turn(self, channel: int, *positions: float) -> None:
        """Move one shaft through positions."""
        with self._lock:
            self.bench.turn(channel, *positions)

    def set_volts(self, channel: int, volts: float) -> None:
        """Voltage at a channel of the converter that has no potentiometer."""
        self.bench.memory.panel.analog[channel] = round(volts * PANEL_MICRO)

    def facts(self) -> BoardFacts:
        self._insist()
        return BoardFacts("F" if self.bench.board.options.revision_f else "E", 6)

    def apply(self, operations: Operations) -> None:
        self._insist()
        if len(operations):
            self.before()
        with self._lock:
            self.lists.append([tuple(map(int, row)) for row in operations])  # type: ignore[misc]
            assert post_operations(self.bench.memory, int(Lane.SERVO), operations, len(operations))
            if not self.standing:
                self.bench.tick()
        if len(operations):
            self.after()

    def read_image(self, image: Words) -> None:
        self._insist()
        with self._lock:
            assert fetch_image(self.bench.memory, image)

    def _insist(self) -> None:
        if self.gone:
            raise LinkError("somebody took the board away")


class DirectBus:
    """Hands everything to an endpoint at once, until it is cut.

    Attributes:
        spoil: done to each image on its way.
    """

    name = "the bench"

    def __init__(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint
        self.cut = False
        self.closed = 0
        self.spoil: Callable[[Words], None] = lambda _image: None

    def connect(self) -> BoardFacts:
        self._insist()
        return self.endpoint.facts()

    def exchange(self, operations: Operations, image: Words) -> None:
        self._insist()
        self.endpoint.apply(operations)
        self._insist()
        newest = make_image()
        self.endpoint.read_image(newest)
        self.spoil(newest)
        check_image(newest)
        image[:] = newest

    def close(self) -> None:
        self.closed += 1

    def _insist(self) -> None:
        if self.cut:
            raise LinkLost("the wire is cut")
