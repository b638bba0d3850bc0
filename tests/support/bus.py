"""A bus to a board on the bench, in the same process; it can be cut."""

from __future__ import annotations

from qrobot.errors import LinkLost
from qrobot.hwif.bus import BoardFacts, Endpoint, Operations
from qrobot.hwif.memory import Lane, fetch_image, post_operations
from qrobot.realtime.segment import Words
from tests.support.bench import Bench


class BenchEndpoint:
    """A `Bench` as the far end of a road: it ticks once for each list of operations it is given."""

    def __init__(self, bench: Bench | None = None) -> None:
        self.bench = bench or Bench()
        self.lists: list[list[tuple[int, int, int]]] = []

    def facts(self) -> BoardFacts:
        return BoardFacts("F" if self.bench.board.options.revision_f else "E", 6)

    def apply(self, operations: Operations) -> None:
        self.lists.append([tuple(map(int, row)) for row in operations])  # type: ignore[misc]
        assert post_operations(self.bench.memory, int(Lane.SERVO), operations, len(operations))
        self.bench.tick()

    def read_image(self, image: Words) -> None:
        assert fetch_image(self.bench.memory, image)


class DirectBus:
    """Hands everything to an endpoint at once, until it is cut."""

    name = "the bench"

    def __init__(self, endpoint: Endpoint) -> None:
        self.endpoint = endpoint
        self.cut = False
        self.closed = 0

    def connect(self) -> BoardFacts:
        self._insist()
        return self.endpoint.facts()

    def exchange(self, operations: Operations, image: Words) -> None:
        self._insist()
        self.endpoint.apply(operations)
        self.endpoint.read_image(image)

    def close(self) -> None:
        self.closed += 1

    def _insist(self) -> None:
        if self.cut:
            raise LinkLost("the wire is cut")
