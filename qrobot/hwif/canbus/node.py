"""The far end of CAN: any `Endpoint` as a CANopen node (CiA 301, with the objects of CiA 401 that fit).

Outputs act only while the node is OPERATIONAL; leaving that state, in whatever way, makes the board safe. So does
silence: when an operational node has had neither a SYNC, from whomever, nor a request or a command for itself for the
watchdog's time, the board is made safe once and the node says so. Emergency messages tell of lost power, the emergency
stop, the watchdog, and frames without meaning; each once, until what it tells of is over.
"""

from __future__ import annotations

import contextlib
import io
import struct
import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import canopen
import numpy as np
from canopen.objectdictionary.eds import import_eds

from qrobot.errors import ConfigError, LinkError, RemoteProtocolError
from qrobot.hwif.bus import Endpoint, Operations, safe_operations
from qrobot.hwif.canbus.frames import MAX_NODE, NMT, RPDO, SDO_ASK, START, SYNC, TPDO, Mailbox, encode_image
from qrobot.hwif.canbus.loop import LoopNetwork
from qrobot.hwif.canbus.objects import COUNTERS_OBJECT, ERROR_REGISTER, IMAGE_OBJECT, eds_text
from qrobot.hwif.canbus.service import RegisterService
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_STATUS, IMAGE_T_NS, make_image
from qrobot.hwif.operations import OP_FIELDS, OP_WRITE
from qrobot.hwif.registers import DAC, DISCRETE, DISCRETE_POWER, STATUS_ESTOP_OK, STATUS_POWER
from qrobot.report import Report

if TYPE_CHECKING:
    import can

WATCHDOG_MS: Final = 100.0
POLL_S: Final = 0.01
FRAMES_AT_ONCE: Final = 64  # taken before timers are looked at again

# Emergency codes of CiA 301, table 26, and the bit of the error register (7.5.2.2) that goes with each.
LOST_POWER: Final = 0x3100
BOARD_FAILED: Final = 0x5000
CLIENT_SILENT: Final = 0x8130
LIST_TORN: Final = 0x8200
WITHOUT_MEANING: Final = 0x8210
EMERGENCY_STOP: Final = 0x9000
_REGISTER_BIT: Final = {
    LOST_POWER: 0x04,
    BOARD_FAILED: 0x80,
    CLIENT_SILENT: 0x10,
    LIST_TORN: 0x10,
    WITHOUT_MEANING: 0x10,
    EMERGENCY_STOP: 0x80,
}
_GENERIC: Final = 0x01

_OUTPUTS: Final = {1: DAC, 2: DAC + 8, 3: DISCRETE}  # first register of RPDO 2, 3 and 4
_WORDS: Final = {1: struct.Struct("<4H"), 2: struct.Struct("<4H"), 3: struct.Struct("<H")}
OPERATIONAL: Final = "OPERATIONAL"
_HEARD: Final = (OPERATIONAL, "PRE-OPERATIONAL")  # states in which SDO is served


class BoardNode:
    """A board on a CAN interface.

    Args:
        bus: open CAN interface; the caller closes it.
        endpoint: the board.
        node_id: 1 to 95.
        watchdog_ms: patience with a silent client while OPERATIONAL; 0 for endless.
        now_ns: the clock of that silence, and of the heartbeat.
        report: takes a line when the watchdog acts.

    Attributes:
        exchanges: SYNCs answered. meaningless: frames to us that made no sense. expired: times the watchdog acted.

    Raises:
        ConfigError: there is no such node number.
    """

    def __init__(
        self,
        bus: can.BusABC,
        endpoint: Endpoint,
        node_id: int = 1,
        watchdog_ms: float = WATCHDOG_MS,
        report: Report = lambda _line: None,
        now_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        if not 1 <= node_id <= MAX_NODE:
            raise ConfigError(f"node {node_id}: the board's node has a number from 1 to {MAX_NODE}")
        self.node_id = node_id
        self.exchanges, self.meaningless, self.expired = 0, 0, 0
        self._bus, self._endpoint, self._report, self._now_ns = bus, endpoint, report, now_ns
        self._watchdog_ns = int(watchdog_ms * 1e6)
        self._heard_ns = 0
        self._silent = self._late = False  # of a client that is late the board is made safe, tried until it is
        self._left_unsafe = False  # the board could not be made safe when OPERATIONAL was left: tried until it is
        self._image, self._mailbox = make_image(), Mailbox()
        self._outputs: dict[int, list[tuple[int, int, int]]] = {}
        self._lists, self._standing = 0, set[int]()
        self._wants_power, self._had_power = False, False
        self._network = LoopNetwork(bus)
        self._node = canopen.LocalNode(node_id, import_eds(io.StringIO(eds_text()), node_id))
        self._network[node_id] = self._node
        self._handlers = self._make_handlers()
        self._serve_objects()

    def _serve_objects(self) -> None:
        service = RegisterService(self._endpoint, self._apply, lambda: self.state == OPERATIONAL)
        self._node.add_read_callback(self._read_own)
        self._node.add_read_callback(service.read)
        self._node.add_write_callback(service.write)

    @property
    def state(self) -> str:
        """NMT state, in the words of CiA 301."""
        return str(self._node.nmt.state)

    @property
    def torn(self) -> int:
        """Lists of operations thrown away because they had a hole or no end."""
        return self._mailbox.torn

    def boot(self) -> None:
        """Say that it is there, and become PRE-OPERATIONAL. The board is looked at once, which may have to compile."""
        with contextlib.suppress(LinkError):
            self._endpoint.read_image(self._image)
        self._node.nmt.state = "INITIALISING"
        self._node.nmt.state = "PRE-OPERATIONAL"

    def step(self, timeout_s: float = POLL_S) -> None:
        """Wait for frames, answer them, and look at the clock. Raises can.CanError when the interface fails."""
        for _ in range(FRAMES_AT_ONCE):
            message = self._bus.recv(timeout_s)
            if message is None:
                break
            self.take(message)
            timeout_s = 0.0
        self._look_at_clock(self._now_ns())

    def take(self, message: can.Message) -> None:
        """Answer one frame; whatever it holds, nothing is raised."""
        if message.is_error_frame or message.is_remote_frame or message.is_extended_id:
            return
        handler = self._handlers.get(message.arbitration_id)
        if handler is None:
            return
        try:
            handler(message.arbitration_id, bytes(message.data))
        except (RemoteProtocolError, struct.error):
            self.meaningless += 1
            self._raise(WITHOUT_MEANING)
        except LinkError as error:
            self._raise(BOARD_FAILED)
            self._report(f"CAN node {self.node_id}: {error}")

    def release(self) -> None:
        """Leave the board safe and stop."""
        self._make_safe()
        self._node.nmt.state = "STOPPED"
        self._network.stop_timers()

    # ------------------------------------------------------------------------------------------------------ frames

    def _make_handlers(self) -> dict[int, Callable[[int, bytes], None]]:
        outputs = {base + self.node_id: self._take_outputs for base in RPDO}
        return {NMT: self._take_command, SYNC: self._answer, SDO_ASK + self.node_id: self._take_service, **outputs}

    def _take_command(self, can_id: int, data: bytes) -> None:
        if len(data) != 2:
            raise RemoteProtocolError("an NMT command has two bytes")
        before = self.state
        self._network.notify(can_id, bytearray(data), 0.0)
        if before == OPERATIONAL and self.state != OPERATIONAL:
            self._left_unsafe = not self._make_safe()
        mine = data[1] in (0, self.node_id)
        if mine and data[0] == START:  # of a list before that no SYNC has come
            self._outputs.clear()
            self._mailbox.take()
        if self.state == "INITIALISING":
            self.boot()
        if mine:
            self._hear()

    def _take_service(self, can_id: int, data: bytes) -> None:
        if len(data) != 8:
            raise RemoteProtocolError("an SDO request has eight bytes")
        if self.state in _HEARD:
            self._network.notify(can_id, bytearray(data), 0.0)
            self._hear()

    def _take_outputs(self, can_id: int, data: bytes) -> None:
        if self.state != OPERATIONAL:
            return
        number = RPDO.index(can_id - self.node_id)
        if number == 0:
            self._mailbox.put(data)
            return
        first = _OUTPUTS[number]
        values = _WORDS[number].unpack(data)
        self._outputs[number] = [(OP_WRITE, first + 2 * i, value) for i, value in enumerate(values)]

    def _answer(self, _can_id: int, data: bytes) -> None:
        """A SYNC: do what was sent since the last one, and show the image."""
        if self.state != OPERATIONAL:
            return
        if len(data) > 1:
            raise RemoteProtocolError("a SYNC has one byte at most")
        self._hear()
        rows = [row for number in sorted(self._outputs) for row in self._outputs[number]]
        self._outputs.clear()
        operations = np.array(rows, np.int64).reshape(-1, OP_FIELDS)
        torn, taken = self.torn, self._mailbox.take()
        if taken is not None:
            operations = np.concatenate([operations, taken])
        self._apply(operations)
        self._lists = self._lists + (taken is not None) & 0xFF
        self._endpoint.read_image(self._image)
        self._tell_troubles(self.torn > torn)
        self.exchanges += 1
        counter = data[0] if data else 0
        for base, frame in zip(TPDO, encode_image(self._image, counter, self._lists), strict=True):
            self._network.send_message(base + self.node_id, frame)

    def _apply(self, operations: Operations) -> None:
        for kind, offset, value in operations.tolist():
            if (kind, offset) == (OP_WRITE, DISCRETE):
                self._wants_power = bool(value & DISCRETE_POWER)
        self._endpoint.apply(operations)

    def _read_own(self, *, index: int, subindex: int, **_rest: Any) -> int | None:
        """Objects of the node itself."""
        if index == ERROR_REGISTER:
            return self._error_register()
        if index == COUNTERS_OBJECT and subindex:
            return (self.exchanges, self.torn, self.meaningless, self.expired)[subindex - 1] & 0xFFFFFFFF
        if index == IMAGE_OBJECT and subindex:
            self._endpoint.read_image(self._image)
            return (0, self._lists, int(self._image[IMAGE_COUNT]) & 0xFFFF, int(self._image[IMAGE_T_NS]))[subindex - 1]
        return None

    # ------------------------------------------------------------------------------------------------------ safety

    def _hear(self) -> None:
        self._heard_ns, self._silent, self._late = self._now_ns(), False, False
        self._settle(CLIENT_SILENT)

    def _look_at_clock(self, now_ns: int) -> None:
        self._network.fire(now_ns)
        if self._left_unsafe:
            self._left_unsafe = not self._make_safe(tell=False)
        late = self._watchdog_ns and now_ns - self._heard_ns > self._watchdog_ns
        if late and self.state == OPERATIONAL and not self._silent:
            begins, self._late = not self._late, True
            self._silent = self._make_safe(tell=begins)
            if begins:
                self.expired += 1
                self._raise(CLIENT_SILENT)
                self._report(f"CAN node {self.node_id}: the client is silent; torque zero, arm power off")

    def _make_safe(self, tell: bool = True) -> bool:
        """Torque zero, power off; whether the board has taken it. Scratch bits stay as in the newest image."""
        self._outputs.clear()
        self._mailbox.take()
        try:
            with contextlib.suppress(LinkError):
                self._endpoint.read_image(self._image)
            self._apply(safe_operations(int(self._image[IMAGE_STATUS])))
        except LinkError as error:
            if tell:
                self._report(f"CAN node {self.node_id}: the board could not be made safe: {error}")
            return False
        return True

    def _tell_troubles(self, torn: bool) -> None:
        """Emergency messages of what the newest image and the newest list show."""
        status = int(self._image[IMAGE_STATUS])
        had_power, has_power = self._had_power, bool(status & STATUS_POWER)
        self._had_power = has_power
        self._settle(BOARD_FAILED)
        self._settle(WITHOUT_MEANING)
        self._raise_or_settle(LIST_TORN, torn)
        self._raise_or_settle(EMERGENCY_STOP, not status & STATUS_ESTOP_OK)
        if has_power or not self._wants_power:
            self._settle(LOST_POWER)
        elif had_power:
            self._raise(LOST_POWER)

    def _raise_or_settle(self, code: int, stands: bool) -> None:
        if stands:
            self._raise(code)
        else:
            self._settle(code)

    def _raise(self, code: int) -> None:
        if code not in self._standing:
            self._standing.add(code)
            self._node.emcy.send(code, self._error_register())

    def _settle(self, code: int) -> None:
        """Withdraw an emergency that is over; when nothing is left, say so (CiA 301, 7.2.7.1)."""
        if code in self._standing:
            self._standing.remove(code)
            if not self._standing:
                self._node.emcy.reset()

    def _error_register(self) -> int:
        register = _GENERIC if self._standing else 0
        for code in self._standing:
            register |= _REGISTER_BIT[code]
        return register


def run_node(node: BoardNode, stop: threading.Event) -> None:
    """Boot the node and serve it until `stop` is set; the board is left safe."""
    node.boot()
    try:
        while not stop.is_set():
            node.step()
    finally:
        node.release()
