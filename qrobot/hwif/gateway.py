"""A bus behind the board memory: what servo, guardian and tools post goes over the bus, what comes back is published.

While the bus is away nothing is published, so that the servo sees the image stand still and stops; what is posted
meanwhile is dropped and counted, for nobody may act later on what was meant for an arm that was moving. A board found
again is first made safe - torque zero, power off - and whoever wants more has to ask again.

Images are numbered by exchanges, whatever the board counts: the far end may apply what an exchange brings after it has
taken the image that goes back. That of the exchange after it shows what was done, if the board has made one meanwhile:
of a board that has made none, the number stands still. What is posted while an exchange is under way goes with the next
one, hence the number of the newest exchange stands in the memory as soon as it begins (`board_memory.newest_count`).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Final

import numpy as np

from qrobot.errors import LinkError, ProtocolError
from qrobot.hwif.board_memory import LANE_CAPACITY, N_LANES, BoardMemory, create_board_memory, publish_image
from qrobot.hwif.bus import (
    NO_OPERATIONS,
    REGISTER_MASK,
    BoardFacts,
    Bus,
    Operations,
    for_the_transport,
    safe_operations,
    sane_operations,
)
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_STATUS, make_image
from qrobot.hwif.lanes import take_all_operations
from qrobot.hwif.operations import OP_FIELDS, OP_OUTPUTS, OP_WRITE
from qrobot.hwif.registers import DISCRETE, DISCRETE_LINES
from qrobot.hwif.trace import OWN_LANE, trace_operations
from qrobot.realtime.signals import set_on_signals
from qrobot.report import Report

RETRY_NS: Final = 200_000_000


class Gateway:
    """Exchanges the image of one board over one bus.

    Args:
        bus: to the board.
        memory: board memory to serve.
        period_ns: time from one exchange to the next, as the servo is told.
        report: takes a line when the board is found or lost.
        module_losses: how often remote modules, and interfaces of sensors, beside the board have been lost; told to the
            servo.
        held_lines: the board's own outputs that hold when the arm stops, in their bits of DISCRETE.
        settle: waits, at the end, for what the bus lets go of meanwhile.
    """

    def __init__(
        self,
        bus: Bus,
        memory: BoardMemory,
        period_ns: int,
        report: Report = lambda _line: None,
        module_losses: Callable[[], int] = lambda: 0,
        held_lines: int = 0,
        settle: Callable[[], None] = lambda: None,
    ) -> None:
        self._settle = settle
        self._bus, self._memory, self._period_ns, self._report = bus, memory, period_ns, report
        self._module_losses = module_losses
        self._operations = np.zeros((N_LANES * LANE_CAPACITY, OP_FIELDS), np.int64)
        self._lanes = np.zeros(len(self._operations), np.int64)
        self._image, self._shown = make_image(), make_image()  # the board's newest, and as shown here
        self._exchange = 0  # number of the newest
        self._far_count: int | None = None  # of the image shown, as the board counts
        self._retry_ns = 0
        self._told = ""
        self._references = self._outputs = False
        self._held_lines, self._lines = held_lines & DISCRETE_LINES, 0  # those that hold, and of these what is on
        self._said_meanwhile: int | None = None  # the outputs, for modules, as asked for since the board was lost
        self.connected = False

    @property
    def dropped(self) -> int:
        """Operations that may never have reached the board."""
        return int(self._memory.facts.dropped)

    @property
    def losses(self) -> int:
        """Number of times that the board was lost."""
        return int(self._memory.facts.losses)

    def step(self, now_ns: int) -> bool:
        """One exchange, or one attempt to find the board; False when there is none."""
        if not self.connected:
            self._drop_posted()
            return now_ns >= self._retry_ns and self._find(now_ns)
        self._begin()
        taken = self._take_posted()
        try:
            self._bus.exchange(self._sane(taken), self._image)
        except (LinkError, ProtocolError) as error:
            self._memory.facts.dropped += taken
            self._lose(error, now_ns)
            return False
        trace_operations(self._memory, now_ns, self._lanes[:taken], self._operations[:taken])
        self._memory.facts.module_losses = self._module_losses()
        self._publish(now_ns)
        return True

    def _begin(self) -> None:
        """Tell that an exchange begins: before anything is taken, for what is posted after that is not in it."""
        self._exchange += 1
        self._memory.facts.asked = self._exchange

    def _take_posted(self) -> int:
        taken = take_all_operations(self._memory, self._operations, self._lanes)
        self._remember_outputs(self._operations[:taken])
        return taken

    def _drop_posted(self) -> None:
        taken = self._take_posted()  # counts there too, so first
        self._memory.facts.dropped += taken

    def _publish(self, asked_ns: int) -> None:
        """Show the image, with the time at which it was asked for: the board's own clock is not ours, nor its count."""
        far_count, number = int(self._image[IMAGE_COUNT]), int(self._shown[IMAGE_COUNT])
        self._shown[:] = self._image
        self._shown[IMAGE_COUNT] = number if far_count == self._far_count else self._exchange
        self._far_count = far_count
        self._memory.facts.taken_ns = asked_ns
        publish_image(self._memory, self._shown)

    def _sane(self, taken: int) -> Operations:
        """Filter the operations taken by sense; the rest, out of a memory that somebody damaged, is counted."""
        operations = sane_operations(self._operations[:taken], self._references)
        self._memory.facts.illegal_ops += taken - len(operations)
        return operations if self._outputs else for_the_transport(operations)

    def _remember_outputs(self, operations: Operations) -> None:
        """Remember the outputs requested last, as the safe state while disconnected."""
        for word in operations[(operations[:, 0] == OP_WRITE) & (operations[:, 1] == DISCRETE), 2][-1:].tolist():
            self._lines = word & self._held_lines
        for word in operations[operations[:, 0] == OP_OUTPUTS, 2][-1:].tolist():
            self._said_meanwhile = word & REGISTER_MASK

    def _safe(self) -> Operations:
        return safe_operations(int(self._image[IMAGE_STATUS]), self._lines)

    def _welcome(self, facts: BoardFacts) -> Operations:
        """Make a board that was found safe, and tell its modules what they have missed."""
        if self._said_meanwhile is None or not facts.outputs:
            return self._safe()
        return np.vstack([self._safe(), (OP_OUTPUTS, 0, self._said_meanwhile)])

    def _write(self, operations: Operations, now_ns: int) -> None:
        """Write what no lane has asked for."""
        self._bus.exchange(operations, self._image)
        trace_operations(self._memory, now_ns, np.full(len(operations), OWN_LANE), operations)

    def _make_safe(self, facts: BoardFacts, now_ns: int) -> None:
        """Welcome a board, and drop what was posted while it was being found: nobody had seen anything of it yet."""
        told = None
        self._drop_posted()
        while told != (self._lines, self._said_meanwhile):  # outputs that somebody asked for meanwhile are told
            told = self._lines, self._said_meanwhile
            self._write(self._welcome(facts), now_ns)
            self._drop_posted()

    def _find(self, now_ns: int) -> bool:
        """Find the board, make it safe, and show it."""
        self._begin()
        try:
            facts = self._bus.connect()
            self._bus.exchange(NO_OPERATIONS, self._image)
            self._make_safe(facts, now_ns)
        except (LinkError, ProtocolError) as error:
            self._retry_ns = now_ns + RETRY_NS
            self._bus.close()
            self._tell(f"no board at {self._bus.name}: {error}")
            return False
        self._memory.facts.period_ns = max(self._period_ns, facts.period_ns)
        self._memory.facts.joints, self._memory.facts.revision = facts.joints, ord(facts.revision)
        self._references, self._outputs, self.connected = facts.references, facts.outputs, True
        self._publish(now_ns)
        self._tell(f"board found at {self._bus.name}: revision {facts.revision}, {facts.joints} joints")
        return True

    def _lose(self, error: Exception, now_ns: int) -> None:
        self.connected, self._said_meanwhile = False, None
        self._memory.facts.losses += 1
        self._retry_ns = now_ns  # at once, the first time
        self._bus.close()
        self._tell(f"board at {self._bus.name} lost: {error}")

    def _tell(self, line: str) -> None:
        if line != self._told:
            self._told = line
            self._report(line)

    def release(self) -> None:
        """Leave the board safe and let go of it, and of what stands beside it."""
        try:
            if self.connected:
                self._write(self._safe(), int(self._memory.facts.taken_ns))
        except (LinkError, ProtocolError) as error:
            self._tell(f"board at {self._bus.name} could not be left safe: {error}")
        finally:
            self.connected = False
            self._bus.close()
            self._settle()


def run_gateway(gateway: Gateway, period_ns: int, stop: threading.Event) -> None:
    """Step at every multiple of `period_ns` of the wall clock until `stop` is set; late steps are not made up for."""
    due_ns = time.monotonic_ns()
    try:
        while not stop.is_set():
            gateway.step(time.monotonic_ns())
            due_ns = max(due_ns + period_ns, time.monotonic_ns())
            stop.wait(max(0, due_ns - time.monotonic_ns()) * 1e-9)
    finally:
        gateway.release()


def serve(
    arm: str,
    bus: Bus,
    period_ns: int,
    report: Report,
    module_losses: Callable[[], int] = lambda: 0,
    held_lines: int = 0,
    needed: Callable[[], bool] | None = None,
    settle: Callable[[], None] = lambda: None,
) -> None:
    """Be the board process of `arm` until SIGTERM, SIGINT or SIGHUP, then leave the board safe. From the main thread.

    SIGHUP, of a closed terminal, counts as soon as this process is not `needed` any more.

    Raises:
        LinkBusy: a board already serves that arm.
    """
    with set_on_signals(needed) as stop, create_board_memory(arm) as memory:
        gateway = Gateway(bus, memory.memory, period_ns, report, module_losses, held_lines, settle)
        run_gateway(gateway, period_ns, stop)
