"""A Modbus server's answers for a board, whatever carries the requests: no socket, no thread.

One client at a time has the control: the first that writes, until it goes away or is silent for too long. Then the
board is made safe - torque zero, power off - once. Readers are free.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from qrobot.errors import LinkBusy, LinkError, RemoteProtocolError
from qrobot.hwif.board_memory import IMAGES_TO_SHOW
from qrobot.hwif.bus import Endpoint, Operations, safe_operations
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_INPUTS, IMAGE_STATUS, make_image
from qrobot.hwif.modbus.map import (
    ANOTHER,
    FIRST_WRITTEN,
    IDENTITY,
    IMAGE,
    MAILBOX,
    MAILBOX_HEAD,
    NOBODY,
    ROBOT,
    WINDOW,
    WINDOW_WORDS,
    WORD_MASK,
    YOU,
    decode_operations,
    encode_identity,
    encode_image,
    written,
)
from qrobot.hwif.operations import OP_READ, OP_WRITE
from qrobot.hwif.registers import ADC_START, DISCRETE
from qrobot.realtime.deadline import sleep_between_looks
from qrobot.report import Report
from qrobot.units import NS_PER_MS

WATCHDOG_MS: Final = 100.0
LOOK_S: Final = 100e-6
LOOKS: Final = 100  # then a board that shows nothing new is read as it is
_ADC_START: Final = ADC_START // 2
_DISCRETE: Final = DISCRETE // 2 - FIRST_WRITTEN


class ModbusDevice:
    """A board behind its Modbus map.

    Args:
        endpoint: the board.
        watchdog_ms: silence of the client in control after which the board is made safe; 0 for never.
        now_ns: the clock of that silence.
        report: takes a line when somebody takes the control or the watchdog acts.
        robot: the words of a running robot (`robot.encode_robot`), asked for when they are read; None: no robot.
        holder: who has the control for good, when no client may have it: a servo that runs.
        pause: waits so many seconds, between two looks at a board that has not shown yet what was written.

    Attributes:
        trips, refused, bad, dropped: the counters of the map.
    """

    def __init__(
        self,
        endpoint: Endpoint,
        watchdog_ms: float = WATCHDOG_MS,
        now_ns: Callable[[], int] = time.monotonic_ns,
        report: Report = lambda _line: None,
        robot: Callable[[], list[int]] | None = None,
        holder: object | None = None,
        pause: Callable[[float], None] = sleep_between_looks,
    ) -> None:
        self._endpoint, self.now_ns, self._report, self._robot = endpoint, now_ns, report, robot
        self.watchdog_ns = round(watchdog_ms * NS_PER_MS)
        self.trips = self.refused = self.bad = self.dropped = 0
        self._image = make_image()
        self._count = -1  # none seen
        self._rose_ns = self._heard_ns = now_ns()
        self._holder = holder
        self._armed = self._late = False  # of a client that is late the board is made safe, tried until it is
        self._pause = pause
        self._written_at: int | None = None  # count of the image before the newest write, until one shows it
        self._applied = 0
        self._mailbox = [0] * MAILBOX_HEAD
        self._written = [0] * (WINDOW_WORDS - FIRST_WRITTEN)

    @property
    def has_robot(self) -> bool:
        """True when a running robot is shown."""
        return self._robot is not None

    @property
    def applied(self) -> int:
        """Sequence number of the newest mailbox whose operations were applied."""
        return self._applied

    def warm_up(self) -> None:
        """Load what is compiled before the first client waits for it. Raises LinkError when there is no board."""
        safe_operations(0)
        self._fetch()

    # ------------------------------------------------------------------------------------------------- who may write

    def hear(self, client: object) -> None:
        """A request of `client` has come: a sign of life when it is the one in control."""
        if client is self._holder:
            self._heard_ns = self.now_ns()

    def leave(self, client: object) -> None:
        """`client` has gone; another may take the control. What it has written stands until the watchdog acts."""
        if client is self._holder:
            self._holder = None

    def control(self, client: object) -> int:
        """The right to write, as `client` is told it: NOBODY, YOU or ANOTHER."""
        if self._holder is None:
            return NOBODY
        return YOU if client is self._holder else ANOTHER

    def watch(self) -> bool:
        """Make the board safe when the client in control has been silent for too long; True when it fell so now."""
        if not self._armed or not self.watchdog_ns or self.now_ns() - self._heard_ns <= self.watchdog_ns:
            return False
        begins, self._late, self._holder = not self._late, True, None
        if begins:
            silent_ms = self.watchdog_ns / NS_PER_MS
            self.trips += 1
            self._report(f"the Modbus client in control is silent for {silent_ms:g} ms: board made safe")
        self._armed = not self.make_safe(tell=begins)
        return begins

    def make_safe(self, tell: bool = True) -> bool:
        """Torque zero, power off; whether the board has taken it. One that is away is told of and not an error."""
        try:
            self._fetch()
            self._apply(safe_operations(self._status))
        except LinkError as error:
            if tell:
                self._report(f"the board behind the Modbus server could not be made safe: {error}")
            return False
        return True

    def _claim(self, client: object) -> None:
        """Raises LinkBusy when another client has the control."""
        if self._holder is None:
            if not self._armed or self._late:  # coils start from a safe word, not from what a predecessor had written
                self._fetch()
                self._written[_DISCRETE] = int(safe_operations(self._status)[-1, 2])
            self._holder = client
            self._report("a Modbus client takes the control of the board")
        elif self._holder is not client:
            self.refused += 1
            raise LinkBusy("another client has the control")
        self._armed, self._late, self._heard_ns = True, False, self.now_ns()

    # ----------------------------------------------------------------------------------------------------- requests

    def write(self, client: object, address: int, values: Sequence[int]) -> None:
        """Registers are written, in the order of addresses.

        Raises:
            LinkBusy: another client has the control, or the board takes nothing.
            LinkError: there is no board.
            RemoteProtocolError: the mailbox means nothing.
        """
        if address >= MAILBOX:
            self._open_mailbox(client, address, values)
            return
        self._claim(client)
        self._apply(written(address, values))

    def write_coils(self, client: object, first: int, bits: Sequence[bool]) -> None:
        """Bits of DISCRETE are written, the others stay as last written. Raises as `write`."""
        self._claim(client)
        word = self._written[_DISCRETE]
        for bit, level in enumerate(bits, first):
            word = word | 1 << bit if level else word & ~(1 << bit)
        self._apply(written(DISCRETE // 2, [word]))

    def read(self, client: object, address: int, count: int) -> dict[int, list[int]]:
        """Registers by first address: the whole group that `address` belongs to.

        ADC_START read by itself acts, as it does on the board; read with its neighbours it does not. Registers of the
        window that the client in control reads show what it has written, a fence that one read costs; the image tells
        by its count how old it is, and is read as it is.

        Raises:
            LinkError: there is no board; LinkBusy: a read that acts while another client has the control.
        """
        if (address, count) == (_ADC_START, 1):
            self._start_conversion(client)
        if address >= ROBOT and self._robot is not None:
            return {ROBOT: self._robot()}
        if address >= MAILBOX:
            return {MAILBOX: self._mailbox}
        if address >= IDENTITY:
            return {IDENTITY: encode_identity(self._endpoint.facts())}
        self._fetch()
        if address < IMAGE and client is self._holder:
            self._await_written()
        return {
            WINDOW: [*self._image[IMAGE_INPUTS:].tolist(), *self._written],
            IMAGE: [*encode_image(self._image), *self._counters(client)],
        }

    def coils(self) -> int:
        """DISCRETE as last written through Modbus."""
        return self._written[_DISCRETE]

    def discrete_inputs(self) -> int:
        """The STATUS word. Raises LinkError when there is no board."""
        self._fetch()
        return self._status

    # ------------------------------------------------------------------------------------------------------- inside

    def _open_mailbox(self, client: object, address: int, values: Sequence[int]) -> None:
        if address != MAILBOX or len(values) < MAILBOX_HEAD:
            raise RemoteProtocolError(f"a mailbox is written whole, from register {MAILBOX} on")
        operations = decode_operations(values[1:])
        self._claim(client)
        self._mailbox = list(values[:MAILBOX_HEAD])
        if values[0] != self._applied:
            self._applied = values[0]  # first: who asks again must not have it twice
            self._apply(operations)

    def _start_conversion(self, client: object) -> None:
        self._claim(client)
        self._apply(np.array([(OP_READ, ADC_START, 0)], np.int64))

    def _apply(self, operations: Operations) -> None:
        try:
            self._fetch()
            self._endpoint.apply(operations)
        except LinkError:
            self.dropped += len(operations)
            raise
        self._written_at = int(self._image[IMAGE_COUNT])
        for kind, offset, value in operations.tolist():
            if kind == OP_WRITE and offset >= 2 * FIRST_WRITTEN:
                self._written[offset // 2 - FIRST_WRITTEN] = value & WORD_MASK

    def _await_written(self) -> None:
        """Wait for the image that shows the newest write; in vain when the board shows nothing new."""
        before, self._written_at = self._written_at, None
        for _ in range(LOOKS):
            # a count that falls is that of a board started anew
            if before is None or not 0 <= int(self._image[IMAGE_COUNT]) - before < IMAGES_TO_SHOW:
                return
            self._pause(LOOK_S)
            self._fetch()

    def _fetch(self) -> None:
        """Look at the board's newest image. Raises LinkError when there is none."""
        self._endpoint.read_image(self._image)
        if self._image[IMAGE_COUNT] != self._count:
            self._count, self._rose_ns = int(self._image[IMAGE_COUNT]), self.now_ns()

    @property
    def _status(self) -> int:
        return int(self._image[IMAGE_STATUS])

    def _counters(self, client: object) -> list[int]:
        """The words from APPLIED on."""
        age_ms = (self.now_ns() - self._rose_ns) // NS_PER_MS
        wrapping = (self.trips, self.refused, self.bad, self.dropped)
        return [
            self._applied,
            self.control(client),
            min(self.watchdog_ns // NS_PER_MS, WORD_MASK),
            *(counter & WORD_MASK for counter in wrapping),
            min(age_ms, WORD_MASK),
        ]
