"""The near end of CAN: the board's node as a `Bus`.

One exchange is the list of operations in mailbox frames, a SYNC with its counter, and the five TPDOs that answer it.
Nothing is ever sent twice: an exchange that has no whole answer in time is given up, and who asked does not know
whether the operations were done.
"""

from __future__ import annotations

from typing import Final

from qrobot.arrays import Words
from qrobot.config.can import CanTransport
from qrobot.errors import LinkLost, RemoteProtocolError
from qrobot.hwif.bus import BoardFacts, Operations
from qrobot.hwif.canbus.frames import MAX_FRAMES, RPDO, SYNC, SYNC_COUNTERS, TPDO, Collector, encode_operations
from qrobot.hwif.canbus.interface import load_can
from qrobot.hwif.canbus.link import CanLink
from qrobot.hwif.canbus.objects import (
    FACTS_JOINTS,
    FACTS_OBJECT,
    FACTS_PERIOD_NS,
    FACTS_REVISION,
    IMAGE_COUNT,
    IMAGE_LISTS,
    IMAGE_OBJECT,
)
from qrobot.hwif.image import IMAGE_COUNT as COUNT_WORD
from qrobot.realtime.deadline import Deadline
from qrobot.units import MS_PER_S

TIMEOUT_S: Final = 0.05


class CanBus:
    """The board's node at the other end of a CAN interface.

    Args:
        interface: of python-can. channel: of the interface. bitrate: of the wire, where the interface has one.
        node_id: number of the board's node, 1 to 95.
        timeout_s: how long an answer may take.

    Attributes:
        link: its `timeout_s` may be changed.
    """

    def __init__(
        self, interface: str, channel: str, *, bitrate: int = 1_000_000, node_id: int = 1, timeout_s: float = TIMEOUT_S
    ) -> None:
        self.name = f"CAN {interface}:{channel}, node {node_id}"
        self.link = CanLink(interface, channel, bitrate, (node_id,), timeout_s)
        self._node = node_id
        self._tpdo = {base + node_id: number for number, base in enumerate(TPDO)}
        self._counter, self._lists, self._count = 0, 0, 0

    def connect(self) -> BoardFacts:
        """Find the node, learn what it is, and let it operate. Raises LinkTimeout when it does not answer."""
        self.link.open()
        facts = BoardFacts(
            revision=chr(self._upload(FACTS_OBJECT, FACTS_REVISION) & 0xFF),
            joints=self._upload(FACTS_OBJECT, FACTS_JOINTS),
            period_ns=self._upload(FACTS_OBJECT, FACTS_PERIOD_NS),
        )
        if facts.revision not in "EF":
            raise RemoteProtocolError(f"node {self._node} is no board of revision E or F")
        self._lists = self._upload(IMAGE_OBJECT, IMAGE_LISTS)
        self._count = self._upload(IMAGE_OBJECT, IMAGE_COUNT)
        self.link.start(self._node)
        return facts

    def exchange(self, operations: Operations, image: Words) -> None:
        """See `Bus`. A list too long for the mailbox is sent in several, one after the other."""
        frames = encode_operations(operations)
        for first in range(0, max(1, len(frames)), MAX_FRAMES):
            self._exchange(frames[first : first + MAX_FRAMES], image)

    def close(self) -> None:
        """Let go of the interface; the node stays as it is."""
        self.link.close()

    # ------------------------------------------------------------------------------------------------------ inside

    def _exchange(self, frames: list[bytes], image: Words) -> None:
        self.link.drain()
        self._counter = self._counter % SYNC_COUNTERS + 1
        for frame in frames:
            self.link.send(RPDO[0] + self._node, frame)
        self.link.send(SYNC, bytes((self._counter,)))
        answer = self._collect(Collector(self._counter))
        self._lists = self._lists + bool(frames) & 0xFF
        if answer.lists != self._lists:
            self._lists = answer.lists
            raise LinkLost(f"node {self._node} has not got all of a list of operations, and has done none of it")
        image[COUNT_WORD] = self._count
        answer.fill(image)
        self._count = int(image[COUNT_WORD])

    def _collect(self, answer: Collector) -> Collector:
        deadline = Deadline(self.link.timeout_s)
        while not answer.whole:
            message = self.link.receive(deadline, f"node {self._node}")
            if message.arbitration_id in self._tpdo:
                answer.put(self._tpdo[message.arbitration_id], bytes(message.data))
        return answer

    def _upload(self, index: int, sub: int) -> int:
        return self.link.upload(self._node, index, sub)


def can_bus(transport: CanTransport) -> CanBus:
    """The bus that a deployment file describes. Raises ConfigError when python-can is not installed."""
    load_can()
    timeout_s = transport.timeout_ms / MS_PER_S
    return CanBus(
        transport.interface,
        transport.channel,
        bitrate=transport.bitrate,
        node_id=transport.node_id,
        timeout_s=timeout_s,
    )
