"""The near end of CAN: the board's node as a `Bus`.

One exchange is the list of operations in mailbox frames, a SYNC with its counter, and the five TPDOs that answer it.
Nothing is ever sent twice: an exchange that has no whole answer in time is given up, and who asked does not know
whether the operations were done.
"""

from __future__ import annotations

import struct
import time
from typing import TYPE_CHECKING, Final

from qrobot.config.can import CanRoad
from qrobot.errors import LinkError, LinkLost, LinkTimeout, RemoteProtocolError
from qrobot.hwif.bus import BoardFacts, Operations
from qrobot.hwif.canbus.frames import (
    EMCY,
    HEARTBEAT,
    MAX_FRAMES,
    NMT,
    RPDO,
    SDO_ANSWER,
    SDO_ASK,
    SYNC,
    SYNC_COUNTERS,
    TPDO,
    Collector,
    encode_operations,
)
from qrobot.hwif.canbus.interface import load_can, open_interface
from qrobot.hwif.canbus.objects import (
    FACTS_JOINTS,
    FACTS_OBJECT,
    FACTS_PERIOD_NS,
    FACTS_REVISION,
    IMAGE_COUNT,
    IMAGE_LISTS,
    IMAGE_OBJECT,
)
from qrobot.hwif.memory import IMAGE_COUNT as COUNT_WORD
from qrobot.realtime.segment import Words

if TYPE_CHECKING:
    import can

TIMEOUT_S: Final = 0.05
SDO_TIMEOUT_S: Final = 0.5
MS_PER_S: Final = 1000
_START: Final = 1  # NMT command
_UPLOAD: Final = struct.Struct("<BHBL")
_UPLOAD_REQUEST: Final = 0x40
_EXPEDITED: Final = 0x42  # of the answer, less its size bits
_ABORTED: Final = 0x80


class CanBus:
    """The board's node at the other end of a CAN interface.

    Args:
        interface: of python-can. channel: of the interface. bitrate: of the wire, where the interface has one.
        node_id: number of the board's node, 1 to 95.
        timeout_s: how long an answer may take.
    """

    def __init__(
        self, interface: str, channel: str, *, bitrate: int = 1_000_000, node_id: int = 1, timeout_s: float = TIMEOUT_S
    ) -> None:
        self.name = f"CAN {interface}:{channel}, node {node_id}"
        self._where = interface, channel, bitrate
        self._node, self._timeout_s = node_id, timeout_s
        self._bus: can.BusABC | None = None
        self._tpdo = {base + node_id: number for number, base in enumerate(TPDO)}
        self._counter, self._lists, self._count = 0, 0, 0
        self._emergency = ""

    def connect(self) -> BoardFacts:
        """Find the node, learn what it is, and let it operate. Raises LinkTimeout when it does not answer."""
        if self._bus is None:
            self._bus = open_interface(*self._where)
        self._drain()
        facts = BoardFacts(
            revision=chr(self._upload(FACTS_OBJECT, FACTS_REVISION) & 0xFF),
            joints=self._upload(FACTS_OBJECT, FACTS_JOINTS),
            period_ns=self._upload(FACTS_OBJECT, FACTS_PERIOD_NS),
        )
        if facts.revision not in "EF":
            raise RemoteProtocolError(f"node {self._node} is no board of revision E or F")
        self._lists = self._upload(IMAGE_OBJECT, IMAGE_LISTS)
        self._count = self._upload(IMAGE_OBJECT, IMAGE_COUNT)
        self._send(NMT, bytes((_START, self._node)))
        return facts

    def exchange(self, operations: Operations, image: Words) -> None:
        """See `Bus`. A list too long for the mailbox is sent in several, one after the other."""
        frames = encode_operations(operations)
        for first in range(0, max(1, len(frames)), MAX_FRAMES):
            self._exchange(frames[first : first + MAX_FRAMES], image)

    def close(self) -> None:
        """Let go of the interface; the node stays as it is."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    # ------------------------------------------------------------------------------------------------------ inside

    def _exchange(self, frames: list[bytes], image: Words) -> None:
        self._drain()
        self._counter = self._counter % SYNC_COUNTERS + 1
        for frame in frames:
            self._send(RPDO[0] + self._node, frame)
        self._send(SYNC, bytes((self._counter,)))
        answer = self._collect(Collector(self._counter))
        self._lists = self._lists + bool(frames) & 0xFF
        if answer.lists != self._lists:
            self._lists = answer.lists
            raise LinkLost(f"node {self._node} has not got all of a list of operations, and has done none of it")
        image[COUNT_WORD] = self._count
        answer.fill(image)
        self._count = int(image[COUNT_WORD])

    def _collect(self, answer: Collector) -> Collector:
        deadline = time.monotonic() + self._timeout_s
        while not answer.whole:
            message = self._receive(deadline)
            if message.arbitration_id in self._tpdo:
                answer.put(self._tpdo[message.arbitration_id], bytes(message.data))
        return answer

    def _upload(self, index: int, sub: int) -> int:
        """Read a number of at most four bytes from the object dictionary (CiA 301, 7.2.4.3.5)."""
        self._send(SDO_ASK + self._node, _UPLOAD.pack(_UPLOAD_REQUEST, index, sub, 0))
        deadline = time.monotonic() + SDO_TIMEOUT_S
        while True:
            message = self._receive(deadline)
            if message.arbitration_id != SDO_ANSWER + self._node or len(message.data) != _UPLOAD.size:
                continue
            command, of_index, of_sub, value = _UPLOAD.unpack(bytes(message.data))
            if (of_index, of_sub) != (index, sub):
                continue
            if command == _ABORTED or command & _EXPEDITED != _EXPEDITED:
                raise RemoteProtocolError(f"node {self._node} has no object {index:#06x}:{sub}: is it a QRobot board?")
            return int(value)

    def _receive(self, deadline: float) -> can.Message:
        """The next data frame. Raises LinkTimeout at the deadline, LinkLost when the node has started anew."""
        while (left := deadline - time.monotonic()) > 0:
            message = self._next(left)
            if message is None or message.is_error_frame or message.is_remote_frame:
                continue
            if message.arbitration_id == EMCY + self._node and len(message.data) >= 2:
                code = int.from_bytes(message.data[:2], "little")
                self._emergency = f"; its last emergency message: {code:#06x}" if code else ""
            if message.arbitration_id == HEARTBEAT + self._node and message.data == b"\0":
                raise LinkLost(f"node {self._node} has started anew{self._emergency}")
            return message
        raise LinkTimeout(f"node {self._node} does not answer{self._emergency}")

    def _next(self, seconds: float) -> can.Message | None:
        library = load_can()
        try:
            return self._open.recv(seconds)
        except (library.CanError, OSError, ValueError) as error:
            raise LinkLost(f"the interface fails: {error}") from error

    def _drain(self) -> None:
        while self._next(0.0) is not None:
            pass

    def _send(self, can_id: int, data: bytes) -> None:
        library = load_can()
        try:
            self._open.send(library.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        except (library.CanError, OSError, ValueError) as error:
            raise LinkLost(f"the interface fails: {error}") from error

    @property
    def _open(self) -> can.BusABC:
        if self._bus is None:
            raise LinkError(f"{self.name} is not connected")
        return self._bus


def can_bus(road: CanRoad) -> CanBus:
    """The bus that a deployment file describes. Raises ConfigError when python-can is not installed."""
    load_can()
    timeout_s = road.timeout_ms / MS_PER_S
    return CanBus(road.interface, road.channel, bitrate=road.bitrate, node_id=road.node_id, timeout_s=timeout_s)
