"""The emulated board as a process: free-running on the wall clock, met only through its shared memory.

The loop is compiled and never holds the interpreter; the main thread waits for a signal. Physics follows the clock:
after a stall the loop catches up in a burst, and each operation acts from the time on for which it was posted. So an
arm whose board alone was kept from running moves as its servo has told it meanwhile.

Where nobody wrote either, nobody could control the arm, and there is no hardware that went on: the arm's time stood
still (`hwif.arm_clock`), and that of emulated arms beside it follows (`sim_board.common_time`). Without that, by
option, the DACs hold as a real board's would, up to `CATCH_UP_NS`; what is beyond is given up and counted as skipped.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from types import TracebackType
from typing import Final

import numpy as np

from qrobot.arrays import Words
from qrobot.hwif.arm_clock import STALL_NS
from qrobot.hwif.board_memory import BoardMemory, BoardSegment, create_board_memory, local_board_memory
from qrobot.hwif.lanes import newest_post_ns
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.clock import monotonic_ns, sleep_until_ns
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.setup import set_fifo, tighten_timers
from qrobot.realtime.signals import set_on_signals
from qrobot.realtime.startup_order import await_turn
from qrobot.sim_board.common_time import held_ns, slipped_beside_ns
from qrobot.sim_board.emulator import Emulator, EmulatorBundle, advance, advance_unseen
from qrobot.units import NS_PER_MS

CATCH_UP_NS: Final = 100_000_000
LIVED_NS: Final = 1_000_000  # so long after its newest operation an arm was still controlled: a cycle of the servo [A]
LOOK_S: Final = 0.1  # between two looks at the boards beside this one [A]
TELL_S: Final = 1.0  # between two looks whether time has slipped [A]
TOLD_NS: Final = 20_000_000  # less is in the status alone [A]
PRIORITY: Final = 40  # below the servo's: hardware never keeps a processor from it
STOP, BESIDE, N_ORDERS = range(3)  # words of the loop's orders: to end, and what boards beside it let pass


@lean_kernel
def unlived_ns(memory: BoardMemory, due_ns: int, now_ns: int) -> int:
    """End of a stall from `due_ns` to `now_ns` in which nobody wrote to the board; 0 for what is no stall."""
    if now_ns - due_ns <= STALL_NS:
        return 0
    return max(0, now_ns - LIVED_NS - max(due_ns, min(newest_post_ns(memory), now_ns)))


@lean_kernel
def run_board(bundle: EmulatorBundle, memory: BoardMemory, orders: Words, slips: int) -> None:
    """Step the emulator at every multiple of its period until `orders[STOP]` is set.

    `orders` is int64[N_ORDERS]; `slips` is 1 where time in which nobody could control the arm does not count.
    """
    period_ns = bundle.period_ns
    slipped_ns = memory.facts.slipped_ns
    due_ns = monotonic_ns() - slipped_ns + period_ns
    while load_acquire(orders, STOP) == 0:
        sleep_until_ns(due_ns + slipped_ns)
        now_ns = monotonic_ns() - slipped_ns
        unlived = 0
        if slips != 0:
            held = held_ns(slipped_ns, load_acquire(orders, BESIDE), period_ns)
            unlived = max(unlived_ns(memory, due_ns, now_ns), held)
        if unlived > 0:
            slipped_ns, now_ns = slipped_ns + unlived, now_ns - unlived
            store_release(memory.facts, "slipped_ns", slipped_ns)
        late = (now_ns - due_ns) // period_ns - CATCH_UP_NS // period_ns
        if late > 0:
            memory.facts.skipped += late
            due_ns += late * period_ns
        catch_up(bundle, memory, due_ns, now_ns)
        due_ns += ((now_ns - due_ns) // period_ns + 1) * period_ns


@lean_kernel
def catch_up(bundle: EmulatorBundle, memory: BoardMemory, due_ns: int, now_ns: int) -> None:
    """All steps from `due_ns` up to `now_ns`; those of the past take no operation posted later than their time.

    Only the last one is shown: its image is of the present.
    """
    while due_ns + bundle.period_ns <= now_ns:
        advance_unseen(bundle, memory, due_ns, due_ns)
        due_ns += bundle.period_ns
    if due_ns <= now_ns:
        advance(bundle, memory, now_ns, due_ns)


class EmulatedBoardServer:
    """An emulated board that runs in a thread of its own behind `<arm>`'s board memory, as a context manager.

    With `slips` time in which this process was kept from running, and nobody wrote to the board, does not count, and
    no more of it counts than for the boards of the arms `beside`, as `look_beside` finds them.

    Raises:
        LinkBusy: a board already serves that arm.
    """

    def __init__(self, arm: str, emulator: Emulator, slips: bool = False, beside: Sequence[str] = ()) -> None:
        self.emulator = emulator
        self._slips = int(slips)
        warm_up(emulator)
        self.segment = create_board_memory(arm)
        self._beside, self._orders = beside, np.zeros(N_ORDERS, np.int64)
        self._thread = threading.Thread(target=self._run, name=f"{arm}-board", daemon=True)

    def _run(self) -> None:
        tighten_timers()
        set_fifo(PRIORITY)
        run_board(self.emulator.bundle, self.segment.memory, self._orders, self._slips)

    @property
    def slipped_ns(self) -> int:
        """Time that did not count, all in all."""
        return int(self.segment.memory.facts.slipped_ns)

    def look_beside(self) -> None:
        """Follow the board that has let pass most; call it now and then."""
        self._orders[BESIDE] = slipped_beside_ns(self._beside, time.monotonic_ns())

    def __enter__(self) -> EmulatedBoardServer:
        self.look_beside()
        facts = self.segment.memory.facts
        facts.slipped_ns = int(self._orders[BESIDE]) if self._slips else 0
        self.emulator.connect(self.segment.memory, time.monotonic_ns() - facts.slipped_ns)
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._orders[STOP] = 1
        self._thread.join()
        self.segment.close(unlink=True)


def warm_up(emulator: Emulator) -> None:
    """Compile the loop, or load it from the cache, before the clock matters."""
    run_board(emulator.bundle, local_board_memory(), np.ones(N_ORDERS, np.int64), 0)


def serve(
    arm: str,
    emulator: Emulator,
    ready: Callable[[], None] = lambda: None,
    server_of: Callable[[BoardSegment], AbstractContextManager[object]] = nullcontext,
    slips: bool = False,
    beside: Sequence[str] = (),
    report: Callable[[str], None] = lambda _line: None,
    needed: Callable[[], bool] | None = None,
) -> None:
    """Serve a board until SIGTERM, SIGINT or SIGHUP, then remove its memory. Call from the main thread of a process.

    Args:
        arm: instance name.
        emulator: the board.
        ready: called once the first image is there.
        server_of: what else serves the board memory meanwhile.
        slips: time in which this process was kept from running, and nobody wrote to the board, does not count.
        beside: emulated arms with which it keeps one time then.
        report: takes a line when time has slipped.
        needed: while it is true, a terminal that is closed does not end it.

    Raises:
        LinkBusy: a board already serves that arm.
    """
    warm_up(emulator)  # before its turn, not with it
    await_turn()
    with (
        set_on_signals(needed) as done,
        EmulatedBoardServer(arm, emulator, slips, beside) as server,
        server_of(server.segment),
    ):
        told_ns = server.slipped_ns
        ready()
        for look in itertools.count(1):
            if done.wait(LOOK_S):
                return
            server.look_beside()
            if look % round(TELL_S / LOOK_S) == 0 and server.slipped_ns - told_ns > TOLD_NS:
                report(slip_line(server.slipped_ns - told_ns, server.slipped_ns))
                told_ns = server.slipped_ns


def slip_line(newly_ns: int, in_all_ns: int) -> str:
    """Line for people when time has slipped."""
    return (
        f"this arm, or one beside it, was kept from running: the emulated arm's time stood still for "
        f"{newly_ns / NS_PER_MS:.0f} ms, {in_all_ns / NS_PER_MS:.0f} ms in all"
    )
