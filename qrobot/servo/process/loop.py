"""The real-time loop: sleep short of the deadline, spin to it, run one cycle, never catch up in a burst.

Deadlines lie on a fixed grid of CLOCK_MONOTONIC, half a period off its multiples: the kernel's own tick fires on
multiples of its period and would otherwise cost some 20 us every few cycles. A loop that missed deadlines skips them,
before the cycle as well as after it: the image is of now, and so must be the reference that it is compared with.
Beside an emulated board the time is the arm's (`hwif.arm_clock`). Everything between two deadlines is compiled; no
Python runs, nothing is allocated.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.hwif.arm_clock import await_board, slipped_ns
from qrobot.hwif.board_memory import BoardMemory, Lane, fetch_image, newest_count
from qrobot.hwif.image import IMAGE_T_NS
from qrobot.hwif.isa.card import CARD_KIND, NO_CARD, serve_card, show_card
from qrobot.hwif.lanes import discard_operations, post_operations
from qrobot.realtime.atomics import load_acquire
from qrobot.realtime.clock import monotonic_ns, pause, sleep_until_ns
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.thread_time import thread_time
from qrobot.servo.checks.guardian_arming import disarm_when_safe, guardian_holds, stands_down
from qrobot.servo.checks.timing_checks import own_ns
from qrobot.servo.cycle import cycle
from qrobot.servo.kernels.converter import note_post
from qrobot.servo.memory.telemetry import append_telemetry
from qrobot.servo.modes import wants_power
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.stages.inputs import note_losses
from qrobot.servo.state import (
    ServoState,
)

SERVO_LANE: Final = int(Lane.SERVO)

# The spin margin follows the 99.9 % quantile of the wake-up error: a thousand small steps down weigh one step up.
MARGIN_UP_NS: Final = 2_000
MARGIN_DOWN_NS: Final = 2
MARGIN_MAX_NS: Final = 150_000
SPIN_PERCENT: Final = (
    60  # [A] of the period at most: with the cycle itself it stays below what `servo.process.rate_test` allows
)

END_PATIENCE_NS: Final = (
    300_000_000  # [A] with a board that does not show that power is off, beyond what tells that a guardian is dead
)

ENDED: Final = 0
BOARD_AWAY: Final = 1


@lean_kernel
def first_deadline(now_ns: int, period_ns: int) -> int:
    """The next point of the grid that leaves at least one period to get ready."""
    return (now_ns // period_ns + 2) * period_ns + period_ns // 2


@lean_kernel
def newest_point(deadline_ns: int, now_ns: int, period_ns: int) -> int:
    """The newest point of the grid that is past, the deadline or a later one: whole periods are skipped."""
    return deadline_ns + max(0, (now_ns - deadline_ns) // period_ns) * period_ns


@lean_kernel
def next_deadline(deadline_ns: int, now_ns: int, period_ns: int) -> int:
    """The next point of the grid that is not past: none is made up for."""
    return newest_point(deadline_ns, now_ns, period_ns) + period_ns


@lean_kernel
def longest_margin(period_ns: int) -> int:
    """The most that is spun before each deadline: a thread that hardly sleeps is throttled by the kernel."""
    return min(MARGIN_MAX_NS, period_ns * SPIN_PERCENT // 100)


@lean_kernel
def wait_until(deadline_ns: int, margin_ns: int, most_ns: int = MARGIN_MAX_NS) -> int:
    """Sleep to `margin_ns` before the deadline and spin the rest (margin 0: sleep only).

    Returns the next margin, `most_ns` at most.
    """
    sleep_until_ns(deadline_ns - margin_ns)
    if margin_ns == 0:
        return 0
    if monotonic_ns() > deadline_ns:
        return min(margin_ns + MARGIN_UP_NS, most_ns)
    while monotonic_ns() < deadline_ns:
        pause()
    return max(margin_ns - MARGIN_DOWN_NS, MARGIN_UP_NS)


@lean_kernel
def one_cycle(
    params: ServoParameters, state: ServoState, mail: Any, ring: Any, board: BoardMemory, now_ns: int, late_ns: int
) -> None:
    """Image in, cycle, operations out, telemetry: the same for every clock."""
    taken_ns = board.facts.taken_ns  # before the image: of the two it may be the older one, never the newer
    state.image_ok = 1 if fetch_image(board, state.image) else 0
    state.image_taken_ns = taken_ns if taken_ns != 0 else state.image[IMAGE_T_NS]
    state.image_age_ns = now_ns + late_ns - state.image_taken_ns
    state.revision, state.module_losses = board.facts.revision, board.facts.module_losses
    state.board_joints = board.facts.joints
    note_losses(state, board.facts.losses, now_ns + late_ns)
    n_ops = cycle(params, state, mail, now_ns, late_ns)
    held = guardian_holds(params, state, mail)  # looked at again: the cycle may have stalled since it looked
    posted = not held and post_operations(board, SERVO_LANE, state.ops, n_ops, now_ns)
    note_post(state.adc, newest_count(board), now_ns)
    if not posted:
        state.discrete_sent = -1  # the board takes nothing at present: to be said again
        state.adc.busy = 0  # nor has it begun a conversion
    disarm_when_safe(state, mail, board, held, posted)
    append_telemetry(ring, state.row)


@lean_kernel
def write_card(
    params: ServoParameters, state: ServoState, mail: Any, board: BoardMemory, card: Any, now_ns: int
) -> None:
    """Write to a card what was posted; what the servo has posted is void once the guardian has the board."""
    if guardian_holds(params, state, mail):
        discard_operations(board, SERVO_LANE)
    serve_card(card, board, now_ns)


@lean_kernel
def run(
    params: ServoParameters,
    state: ServoState,
    mail: Any,
    ring: Any,
    board: BoardMemory,
    card: Any,
    margin_ns: int,
    away_ns: int,
) -> int:
    """Run until shutdown is requested and the arm is without power, as its board shows.

    Args:
        ring: words of the telemetry ring.
        card: see `hwif.isa.card`; one on this machine's own bus is read before and written after each cycle.
        margin_ns: initial spin margin; 0 never spins. away_ns: without an image for this long, and without power,
            return BOARD_AWAY so that the board can be mapped anew.
    """
    slipped = slipped_ns(board, params.board_slips)
    deadline = first_deadline(monotonic_ns() - slipped, params.period_ns)
    seen_ns, asked_ns = deadline, deadline
    most_ns = longest_margin(params.period_ns)
    margin_ns = min(margin_ns, most_ns)
    while True:
        margin_ns = wait_until(deadline + slipped, margin_ns, most_ns)
        slipped, started = await_board(board, params.board_slips, deadline)
        mail.heartbeat.slipped_ns = slipped
        if started < deadline:
            continue  # time has slipped: the deadline is still to come
        missed, deadline = deadline, newest_point(deadline, started, params.period_ns)
        state.skipped_ns = deadline - missed
        state.late_cycles += state.skipped_ns // params.period_ns
        was_long = 2 * state.busy_ns > params.period_ns  # several in a row are looked at more closely
        used = thread_time() if was_long else (0, 0)
        if card[CARD_KIND] != NO_CARD:
            show_card(card, board, started)
        one_cycle(params, state, mail, ring, board, deadline, started - deadline)
        if card[CARD_KIND] != NO_CARD:
            write_card(params, state, mail, board, card, started)
        slipped, now = await_board(board, params.board_slips, started)  # a stall inside the cycle slips as well
        mail.heartbeat.slipped_ns = slipped
        finished = max(started, now)
        state.busy_ns = finished - started
        if was_long:
            state.busy_ns = own_ns(state.busy_ns, used, thread_time())
        powered = wants_power(state.mode)
        if load_acquire(mail.command, "shutdown") == 0 or powered:
            asked_ns = deadline
        elif stands_down(state, mail) or deadline - asked_ns > END_PATIENCE_NS + params.guardian_timeout_ns:
            return ENDED
        if state.image_ok != 0:
            seen_ns = deadline
        elif not powered and deadline - seen_ns > away_ns:
            return BOARD_AWAY
        following = next_deadline(deadline, finished, params.period_ns)
        state.late_cycles += (following - deadline) // params.period_ns - 1
        deadline = following
