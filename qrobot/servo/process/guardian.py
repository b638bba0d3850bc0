"""The guardian: a second, smaller process that takes the board away from a servo whose heartbeat stops.

The real board has no watchdog and its DACs hold the last torque, so a dead servo would leave the motors driven. The
guardian maps servo and board memory on its own. When an armed servo's heartbeat is older than the bound it marks the
takeover (the servo, should it wake, writes nothing more), drops arm power and writes zero torque, 0x800 and not 0, to
all DACs, again and again, until a servo has cleared the fault. A servo that was stopped while it posted, or wrote to a
card, still finishes that: the guardian sees the lane move within a millisecond, and makes the board safe again. The
servo in turn stops the arm when the guardian's heartbeat is gone, and makes the board safe itself when the guardian has
died after it had marked the takeover.

What it cannot do: a kernel panic or a power cut of the PC needs hardware (a charge pump and a relay).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from qrobot.arrays import Words
from qrobot.config.deployment import GUARDIAN_TIMEOUT_MS
from qrobot.errors import LinkError
from qrobot.hwif.arm_clock import STALL_NS, arm_time_ns, may_slip_ns
from qrobot.hwif.board_memory import BoardMemory, Lane, attach_board_memory, local_board_memory
from qrobot.hwif.isa.card import CARD_BASE, CARD_KIND, NO_CARD, REAL_CARD, make_card, pour_lane
from qrobot.hwif.isa.permission import require_ports
from qrobot.hwif.lanes import pending_operations, post_operations, posted_so_far, taken_so_far
from qrobot.hwif.operations import ALL_ANALOG, OP_FIELDS, put_analog, put_outputs, put_write
from qrobot.hwif.registers import DAC, DAC_ZERO, DISCRETE, DISCRETE_POWER, N_DACS
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.clock import monotonic_ns, sleep_until_ns
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.setup import HIGHEST_PRIORITY, SetupStep, freeze_garbage, lock_memory, set_fifo, tighten_timers
from qrobot.realtime.shared_memory import HEADER_WORDS, SegmentT, SharedMemory
from qrobot.report import Report
from qrobot.servo.memory.servo_memory import (
    NOT_TAKEN,
    PLACE_LAYOUT,
    TAKEN,
    TAKING,
    ServoFront,
    attach_servo_memory,
    guardian_place,
    local_servo_memory,
    servo_front,
)
from qrobot.servo.memory.telemetry import SMALLEST_RING
from qrobot.units import NS_PER_S

SERVO_LANE: Final = int(Lane.SERVO)
GUARDIAN_LANE: Final = int(Lane.GUARDIAN)
N_SAFE_OPS: Final = 3 + N_DACS
LOOKS_PER_TIMEOUT: Final = 5  # a look every fifth of the bound: reaction within 1.2 times the bound
SLICE_NS: Final = NS_PER_S // 5
HELD_LOOK_NS: Final = 1_000_000  # [A] between two looks at what a servo posts whose board is taken
LEAVE_NS: Final = NS_PER_S // 2  # [A] beyond the bound, for a board to take what makes it safe

# The guardian's own memory; outlives servo restarts. WAS_ARMED: said by a servo that beat; POSTED and POURED: where the
# servo's lane was before the board was made safe last. DUE_NS: when it wanted to look next; PATIENT_UNTIL_NS: it
# overslept by OVERSLEPT_NS, and lets others wake up as well.
TRIPPED, TRIPS, LAST_DISCRETE, LINES, KEPT, ANALOG, WAS_ARMED, POSTED, POURED = range(9)
DUE_NS, PATIENT_UNTIL_NS, OVERSLEPT_NS, N_OWN = range(9, 13)


@lean_kernel
def make_safe(own: Any, board: BoardMemory, ops: Any) -> bool:
    """Arm power off, then zero torque on every DAC; False when the board takes no more operations.

    Of DISCRETE the rest stays as the servo meant it to: the hand keeps what it holds, outputs that hold stay on, the
    counters stay calibrated. Analogue outputs of the board show 0 V, those of modules their off values.
    """
    n = put_write(ops, 0, DISCRETE, own[LAST_DISCRETE] & ~DISCRETE_POWER)
    for channel in range(N_DACS):
        n = put_write(ops, n, DAC + 2 * channel, DAC_ZERO)
    if own[LINES] != 0:
        n = put_outputs(ops, n, own[KEPT])
    if own[ANALOG] != 0:
        n = put_analog(ops, n, ALL_ANALOG, 0)
    return post_operations(board, GUARDIAN_LANE, ops, n)


@lean_kernel
def mark_takeover(own: Any, mail: ServoFront) -> None:
    """Tell the servo whether its board is taken, before it is made safe."""
    if own[TRIPPED] == 0:
        store_release(mail.guardian, "takeover", NOT_TAKEN)
    elif load_acquire(mail.guardian, "takeover") == NOT_TAKEN:
        store_release(mail.guardian, "takeover", TAKING)


@lean_kernel
def servo_has_written(own: Any, board: BoardMemory) -> bool:
    """Whether the servo has posted, or its board or card taken something of it, since the board was made safe last."""
    return bool(own[POSTED] != posted_so_far(board, SERVO_LANE) or own[POURED] != taken_so_far(board, SERVO_LANE))


@lean_kernel
def look(own: Any, mail: ServoFront, board: BoardMemory, card: Any, ops: Any, now_ns: int, timeout_ns: int) -> None:
    """One look at the servo: trip, keep the board safe, or hand it back.

    Args:
        own: int64[N_OWN], the guardian's memory.
        card: of a board on this machine's own bus; nobody but the servo and the guardian reach it, each by itself.
        ops: scratch, int64[N_SAFE_OPS, 3].
    """
    armed = load_acquire(mail.heartbeat, "armed") != 0  # before the heartbeat: a servo beats before it arms
    beat_ns = load_acquire(mail.heartbeat, "t_ns")
    fresh = -timeout_ns <= now_ns - beat_ns <= timeout_ns  # none comes from the future
    if fresh:
        own[WAS_ARMED] = 1 if armed else 0
    armed = armed or (beat_ns == 0 and own[WAS_ARMED] != 0)  # the memory of a new servo; the old one was armed
    if own[TRIPPED] == 0 and not fresh and armed:
        own[TRIPPED] = 1
        own[TRIPS] += 1
    elif own[TRIPPED] != 0 and fresh and load_acquire(mail.heartbeat, "trips_seen") == own[TRIPS]:
        own[TRIPPED] = 0
    if mail.heartbeat.discrete != 0:  # a servo that has just started has none yet
        own[LAST_DISCRETE], own[LINES], own[KEPT] = mail.heartbeat.discrete, mail.heartbeat.lines, mail.heartbeat.kept
        own[ANALOG] = mail.heartbeat.analog
    store_release(mail.guardian, "trips", own[TRIPS])
    mark_takeover(own, mail)
    store_release(mail.guardian, "t_ns", now_ns)
    if own[TRIPPED] != 0:
        own[POSTED], own[POURED] = posted_so_far(board, SERVO_LANE), taken_so_far(board, SERVO_LANE)
        make_safe(own, board, ops)
    if card[CARD_KIND] != NO_CARD:
        pour_lane(card, board, GUARDIAN_LANE, now_ns)
    if own[TRIPPED] != 0:
        store_release(mail.guardian, "takeover", TAKEN)


@lean_kernel
def await_look(own: Any, board: BoardMemory, due_ns: int) -> int:
    """Sleep until the next look is due, or, while the guardian holds the board, until the servo has written to it.

    Returns when that is.
    """
    while own[TRIPPED] != 0 and monotonic_ns() < due_ns - HELD_LOOK_NS:
        sleep_until_ns(monotonic_ns() + HELD_LOOK_NS)
        if servo_has_written(own, board):
            return monotonic_ns()
    sleep_until_ns(due_ns)
    return due_ns


@lean_kernel
def watch(
    own: Any,
    mail: ServoFront,
    board: BoardMemory,
    card: Any,
    ops: Any,
    stop: Any,
    timeout_ns: int,
    until_ns: int,
    slips: int,
) -> None:
    """Look again and again until `until_ns`, or until `stop[0]` is set.

    With `slips` the board is an emulated one that lets time stand still when everybody was kept from running. What it
    may still take back is no silence of the servo, and a guardian that overslept gives the others one bound to wake up
    in as well. On a real board it acts at once.
    """
    period_ns = timeout_ns // LOOKS_PER_TIMEOUT
    deadline = monotonic_ns() if own[DUE_NS] == 0 else min(own[DUE_NS], monotonic_ns())
    while load_acquire(stop, 0) == 0 and deadline < until_ns:
        late = monotonic_ns() - deadline
        if slips != 0 and late > STALL_NS:
            own[PATIENT_UNTIL_NS], own[OVERSLEPT_NS] = deadline + late + timeout_ns, late
        allowed = timeout_ns if deadline >= own[PATIENT_UNTIL_NS] else 2 * timeout_ns + own[OVERSLEPT_NS]
        now_ns = arm_time_ns(board, slips)
        allowed += may_slip_ns(board, slips, now_ns)
        look(own, mail, board, card, ops, now_ns, allowed)
        deadline = await_look(own, board, max(deadline + period_ns, monotonic_ns()))
        own[DUE_NS] = deadline


class Guardian:
    """Watches one arm; follows restarts of its servo and its board.

    A guardian that was killed while it held the board has an heir: the mark of the takeover stays in the servo's
    memory, and the next guardian goes on holding the board. `report` must neither wait nor raise.

    Raises:
        LinkBusy: a guardian watches this arm already; two of them would share one lane of the board.
        LinkError: there is no servo or no board to watch.
    """

    def __init__(
        self,
        arm: str,
        timeout_ms: float = GUARDIAN_TIMEOUT_MS,
        report: Report = lambda _line: None,
        card: Words | None = None,
        slips: bool = False,
    ) -> None:
        self.arm = arm
        self._slips = int(slips)
        self._card = make_card(NO_CARD) if card is None else card
        self._report = report
        self.timeout_ns = int(timeout_ms * 1e6)
        self.stop = np.zeros(1, dtype=np.int64)
        self._hung_up = False
        self._own = np.zeros(N_OWN, dtype=np.int64)
        self._ops = np.zeros((N_SAFE_OPS, OP_FIELDS), dtype=np.int64)
        self._servo = attach_servo_memory(arm)
        self._board = attach_board_memory(arm)
        self._place = SharedMemory.create(guardian_place(arm), PLACE_LAYOUT, HEADER_WORDS)
        said = self._servo.front.guardian
        self._own[TRIPPED], self._own[TRIPS] = said.takeover != NOT_TAKEN, said.trips

    @property
    def trips(self) -> int:
        """Number of times the guardian had to take the board."""
        return int(self._own[TRIPS])

    @property
    def tripped(self) -> bool:
        """True while the guardian holds the board."""
        return bool(self._own[TRIPPED])

    def hang_up(self) -> None:
        """Let it end as soon as the arm is not driven any more: its terminal was closed, the servo's perhaps too."""
        self._hung_up = True

    def run(self, linger_s: float) -> None:
        """Watch until stopped, or until there has been no servo process for `linger_s` seconds.

        Stopped beside a servo that is silent, it ends once the board has taken zero torque and no power.

        Raises ConfigError when the card's ports are refused to this thread.
        """
        if self._card[CARD_KIND] == REAL_CARD:
            require_ports(int(self._card[CARD_BASE]))
        alone_since: int | None = None
        while not self.stop[0] and not (self._hung_up and (self.tripped or not self._drives())):
            before = self.tripped
            self._watch_for(SLICE_NS, self.stop)
            self._tell(before)
            self._servo = _follow(self._servo, attach_servo_memory, self.arm)
            self._board = _follow(self._board, attach_board_memory, self.arm)
            if self._servo.owner_alive:
                alone_since = None
                continue
            now_ns = monotonic_now()
            alone_since = now_ns if alone_since is None else alone_since
            if now_ns - alone_since > linger_s * NS_PER_S:
                return
        self._leave_safe()

    def _leave_safe(self) -> None:
        """Asked to end: not before the board is safe, or the servo has shown that it can see to that itself."""
        until_ns, beat_ns = monotonic_now() + self.timeout_ns + LEAVE_NS, int(self._servo.front.heartbeat.t_ns)
        while not self._dispensable(beat_ns) and monotonic_now() < until_ns:
            self._watch_for(self.timeout_ns // LOOKS_PER_TIMEOUT, np.zeros(1, dtype=np.int64))

    def _dispensable(self, beat_ns: int) -> bool:
        """True when nothing is driven any more, or the servo has beaten after `beat_ns`."""
        if self.tripped:
            return pending_operations(self._board.memory, GUARDIAN_LANE) == 0
        return not self._drives() or bool(self._servo.front.heartbeat.t_ns != beat_ns)

    def _drives(self) -> bool:
        """True while the servo is armed, or the one before it was that has left no other in its place yet."""
        heartbeat = self._servo.front.heartbeat
        return bool(heartbeat.armed) or (not heartbeat.t_ns and bool(self._own[WAS_ARMED]))

    def _watch_for(self, duration_ns: int, stop: Words) -> None:
        memories = self._servo.front, self._board.memory, self._card
        until_ns = monotonic_now() + duration_ns
        watch(self._own, *memories, self._ops, stop, self.timeout_ns, until_ns, self._slips)

    def _tell(self, before: bool) -> None:
        if self.tripped and not before:
            self._report(f"the servo of {self.arm} is silent: torque zero, arm power off")
        elif before and not self.tripped:
            self._report(f"the servo of {self.arm} has the board again")

    def close(self) -> None:
        """Unmap both memories and leave the guardian's place to another one."""
        self._servo.close()
        self._board.close()
        self._place.close(unlink=True)


def _follow(segment: SegmentT, attach: Callable[[str], SegmentT], arm: str) -> SegmentT:
    """The segment itself, or its successor when the file behind it was replaced."""
    if segment.is_current:
        return segment
    try:
        successor = attach(arm)
    except LinkError:
        return segment  # nobody there yet: keep the old mapping and look again
    segment.close()
    return successor


def warm_up() -> None:
    """Compile, or load from the cache, what `run` calls."""
    mail = servo_front(local_servo_memory("warm-up", "", 1, NS_PER_S, SMALLEST_RING))
    ops = np.zeros((N_SAFE_OPS, OP_FIELDS), dtype=np.int64)
    own = np.ones(N_OWN, dtype=np.int64)
    watch(
        own,
        mail,
        local_board_memory(),
        make_card(NO_CARD),
        ops,
        np.zeros(1, dtype=np.int64),
        NS_PER_S,
        monotonic_now() + 1,
        0,
    )
    pending_operations(local_board_memory(), GUARDIAN_LANE)


def prepare() -> list[SetupStep]:
    """Make this process hard to delay: memory that stays, fine timers, a priority above the servo's.

    A search for garbage among all modules' objects would keep it from looking for longer than it may. The others are in
    this order: to lock the memory takes longer than a servo on the same processor can be kept waiting.
    """
    return [freeze_garbage(), lock_memory(), tighten_timers(), set_fifo(HIGHEST_PRIORITY)]


@lean_kernel
def monotonic_now() -> int:
    """CLOCK_MONOTONIC in nanoseconds, for the Python side."""
    return monotonic_ns()
