"""Common part of every near end on CAN: frames both ways, service data of at most four bytes, and who has restarted."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from qrobot.errors import LinkError, LinkLost, LinkTimeout, RemoteProtocolError
from qrobot.hwif.canbus.frames import EMCY, HEARTBEAT, NMT, SDO_ANSWER, SDO_ASK, START
from qrobot.hwif.canbus.interface import load_can, open_interface
from qrobot.realtime.deadline import Deadline

if TYPE_CHECKING:
    import can

SDO_TIMEOUT_S: Final = 0.5  # at least
SDO: Final = struct.Struct("<BHBL")  # of at most four bytes (CiA 301, 7.2.4.3)
UPLOAD: Final = 0x40
UPLOADED: Final = 0x43  # less the bits of its size
DOWNLOAD: Final = {1: 0x2F, 2: 0x2B, 4: 0x23}  # by bytes
DOWNLOADED: Final = 0x60
ABORTED: Final = 0x80
_EXPEDITED: Final = 0x42
_ALL_DIGITS: Final = 0xFFFFFFFF


class CanLink:
    """A CAN interface as seen by somebody who talks to some of its nodes.

    Args:
        interface, channel, bitrate: of python-can.
        nodes: whose emergency and boot-up messages are listened to.

    Attributes:
        timeout_s: how long an answer may take; one with service data, for which a node takes its time, longer.
    """

    def __init__(
        self, interface: str, channel: str, bitrate: int, nodes: Sequence[int], timeout_s: float = SDO_TIMEOUT_S
    ) -> None:
        self._where = interface, channel, bitrate
        self.timeout_s = timeout_s
        self._nodes = frozenset(nodes)
        self._bus: can.BusABC | None = None
        self._emergencies: dict[int, int] = {}
        self._restarted: int | None = None

    def open(self) -> None:
        """Open the interface unless it is, and forget what came in. Raises LinkError."""
        if self._bus is None:
            self._bus = open_interface(*self._where)
        self.drain()
        self._emergencies.clear()
        self._restarted = None

    def close(self) -> None:
        """Let go of the interface, also of one that has failed. May be called twice."""
        bus, self._bus = self._bus, None
        if bus is not None:
            with suppress(load_can().CanError, OSError, ValueError):  # an adapter that is pulled takes no farewell
                bus.shutdown()

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame. Raises LinkLost when the interface fails."""
        library = load_can()
        try:
            self._open.send(library.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        except (library.CanError, OSError, ValueError) as error:
            raise LinkLost(f"the interface fails: {error}") from error

    def receive(self, deadline: Deadline, whom: str) -> can.Message:
        """The next frame of a node, until `deadline`; one that has come in by then is found also by who looks too late.

        Raises:
            LinkTimeout: none came; names `whom`, and the last emergency messages.
            LinkLost: one of the nodes has started anew, or the interface fails.
        """
        while True:
            left_s = deadline.left_s
            message = self._next(left_s)
            if message is not None:
                self._listen(message)
            if self._restarted is not None:
                raise LinkLost(f"node {self._restarted} has started anew{self.emergencies}")
            if message is not None and _is_of_a_node(message):
                return message
            if message is None and left_s == 0:
                raise LinkTimeout(f"{whom} does not answer{self.emergencies}")

    def waiting(self) -> list[can.Message]:
        """The data frames that have come in, of 11 and of 29 bits, without waiting for more."""
        return [message for message in iter(lambda: self._next(0.0), None) if _has_data(message)]

    def drain(self) -> None:
        """Pass over what has come in, so that it is not taken for an answer; emergencies and restarts are noted."""
        while (message := self._next(0.0)) is not None:
            self._listen(message)

    @property
    def emergencies(self) -> str:
        """Complaints of the nodes, for the end of an error message."""
        told = ", ".join(f"{code:#06x} of node {node}" for node, code in sorted(self._emergencies.items()))
        return f"; emergency messages: {told}" if told else ""

    def emergency_of(self, node: int) -> int | None:
        """Code of the last emergency message of a node; None when there was none, or it has told that all is well."""
        return self._emergencies.get(node)

    def start(self, node: int) -> None:
        """Let a node operate."""
        self.send(NMT, bytes((START, node)))

    def upload(self, node: int, index: int, sub: int) -> int:
        """Read a number from a node's object dictionary. Raises RemoteProtocolError when it has no such object."""
        return self._ask(node, UPLOAD, index, sub, 0)

    def upload_from_each(self, nodes: Sequence[int], index: int, sub: int) -> Iterator[tuple[int, int | None]]:
        """Ask all `nodes` for a number at once: (node, number) as each answers, with None where it has no such object.

        Raises:
            LinkTimeout: one does not answer; the others have been given before.
        """
        for node in nodes:
            self.send(SDO_ASK + node, SDO.pack(UPLOAD, index, sub, 0))
        waiting, deadline = set(nodes), Deadline(max(SDO_TIMEOUT_S, self.timeout_s))
        while waiting:
            message = self.receive(deadline, f"node {min(waiting)}")
            node, answer = message.arbitration_id - SDO_ANSWER, _answer_in(message, index, sub)
            if node in waiting and answer is not None:
                waiting.remove(node)
                yield node, answer[1] if _is_success(answer[0]) else None

    def download(self, node: int, index: int, sub: int, value: int, size: int) -> None:
        """Write a number of `size` bytes (1, 2 or 4). Raises RemoteProtocolError when the node refuses it."""
        self._ask(node, DOWNLOAD[size], index, sub, value & _ALL_DIGITS)

    def _ask(self, node: int, command: int, index: int, sub: int, value: int) -> int:
        self.send(SDO_ASK + node, SDO.pack(command, index, sub, value))
        deadline = Deadline(max(SDO_TIMEOUT_S, self.timeout_s))
        while True:
            message = self.receive(deadline, f"node {node}")
            answer = _answer_in(message, index, sub)
            if message.arbitration_id != SDO_ANSWER + node or answer is None:
                continue
            kind, number = answer
            if not _is_success(kind):
                raise RemoteProtocolError(f"node {node} refuses object {index:#06x}:{sub} ({number:#010x})")
            return number

    def _listen(self, message: can.Message) -> None:
        """Note an emergency message, and the boot-up message of a node that has started anew."""
        if not _is_of_a_node(message):
            return
        if message.arbitration_id - HEARTBEAT in self._nodes and message.data == b"\0":
            self._restarted = message.arbitration_id - HEARTBEAT
        node = message.arbitration_id - EMCY
        if node in self._nodes and len(message.data) >= 2:
            code = int.from_bytes(message.data[:2], "little")
            if code:
                self._emergencies[node] = code
            else:
                self._emergencies.pop(node, None)

    def _next(self, seconds: float) -> can.Message | None:
        library = load_can()
        try:
            return self._open.recv(seconds)
        except (library.CanError, OSError, ValueError) as error:
            raise LinkLost(f"the interface fails: {error}") from error

    @property
    def _open(self) -> can.BusABC:
        if self._bus is None:
            raise LinkError("not connected")
        return self._bus


def _has_data(message: can.Message) -> bool:
    return not message.is_error_frame and not message.is_remote_frame


def _is_of_a_node(message: can.Message) -> bool:
    """Nodes of CANopen have identifiers of 11 bits; the same number in one of 29 bits is somebody else's."""
    return _has_data(message) and not message.is_extended_id


def _answer_in(message: can.Message, index: int, sub: int) -> tuple[int, int] | None:
    """Kind and number of an answer about an object, None of anything else."""
    if len(message.data) != SDO.size:
        return None
    kind, of_index, of_sub, number = SDO.unpack(bytes(message.data))
    return (kind, number) if (of_index, of_sub) == (index, sub) else None


def _is_success(kind: int) -> bool:
    return kind == DOWNLOADED or (kind != ABORTED and kind & _EXPEDITED == _EXPEDITED)
