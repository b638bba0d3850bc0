"""The emulated board as a process: free-running on the wall clock, met only through its shared memory.

The loop is compiled and never holds the interpreter; the main thread waits for a signal. Physics follows the clock:
after a stall the loop catches up in a burst, the DACs held as a real board would hold them, up to `CATCH_UP_NS`; what
is beyond is given up and counted in BOARD_SKIPPED.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from types import TracebackType
from typing import Final

import numpy as np

from qrobot.hwif.memory import BOARD_SKIPPED, create_board_memory, local_board_memory
from qrobot.realtime.atomics import load_acquire
from qrobot.realtime.clock import monotonic_ns, sleep_until_ns
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.segment import Words
from qrobot.realtime.setup import set_fifo, tighten_timers
from qrobot.realtime.signals import set_on_signals
from qrobot.realtime.turn import await_turn
from qrobot.sim_board.emulator import Emulator, EmulatorBundle, advance

CATCH_UP_NS: Final = 100_000_000
PRIORITY: Final = 40  # below the servo's: hardware never keeps a processor from it


@lean_kernel
def run_board(bundle: EmulatorBundle, memory: Words, stop: Words) -> None:
    """Step the emulator at every multiple of its period until `stop[0]` is set. `stop` is int64[1]."""
    period_ns = bundle.period_ns
    due_ns = monotonic_ns() + period_ns
    while load_acquire(stop, 0) == 0:
        sleep_until_ns(due_ns)
        now_ns = monotonic_ns()
        late = (now_ns - due_ns) // period_ns - CATCH_UP_NS // period_ns
        if late > 0:
            memory[BOARD_SKIPPED] += late
            due_ns += late * period_ns
        while due_ns <= now_ns:
            advance(bundle, memory, now_ns, due_ns)
            due_ns += period_ns


class BoardServer:
    """An emulated board that runs in a thread of its own behind `<arm>`'s board memory, as a context manager.

    Raises:
        LinkBusy: a board already serves that arm.
    """

    def __init__(self, arm: str, emulator: Emulator) -> None:
        self.emulator = emulator
        _warm_up(emulator)
        self.segment = create_board_memory(arm)
        self._stop = np.zeros(1, np.int64)
        self._thread = threading.Thread(target=self._run, name=f"{arm}-board", daemon=True)

    def _run(self) -> None:
        tighten_timers()
        set_fifo(PRIORITY)
        run_board(self.emulator.bundle, self.segment.words, self._stop)

    def __enter__(self) -> BoardServer:
        self.emulator.connect(self.segment.words, time.monotonic_ns())
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop[0] = 1
        self._thread.join()
        self.segment.close(unlink=True)


def _warm_up(emulator: Emulator) -> None:
    """Compile the loop, or load it from the cache, before the clock matters."""
    run_board(emulator.bundle, local_board_memory(), np.ones(1, np.int64))


def serve(
    arm: str,
    emulator: Emulator,
    ready: Callable[[], None] = lambda: None,
    beside: Callable[[Words], AbstractContextManager[object]] = nullcontext,
) -> None:
    """Serve a board until SIGTERM or SIGINT, then remove its memory. Call from the main thread of a process.

    Args:
        arm: instance name.
        emulator: the board.
        ready: called once the first image is there.
        beside: what else serves the board memory meanwhile.

    Raises:
        LinkBusy: a board already serves that arm.
    """
    _warm_up(emulator)  # before its turn, not with it
    await_turn()
    with set_on_signals() as done, BoardServer(arm, emulator) as server, beside(server.segment.words):
        ready()
        done.wait()
