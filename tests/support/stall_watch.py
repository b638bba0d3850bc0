"""Whether this machine kept processes from running for a while: told by one that does nothing but wake up.

    python -m tests.support.stall_watch

When its standard input is closed, it prints a line for each time that a thread on one of the processors came late: by
how much, ms, and how long ago, s. So it ends with whoever started it.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

ROOT: Final = Path(__file__).parents[2]
SLEEP_S: Final = 0.005
LATE_MS: Final = 20.0  # beyond what it slept: told
EXCUSES_MS: Final = 40.0  # a frame of 100 ms is missed when it comes 50 ms late, and its answer takes a while too
RECENT_S: Final = 5.0  # from a loss until a test has seen it
ANY_TIME_S: Final = math.inf
TRIES: Final = 3
Found = TypeVar("Found")


class Stall(NamedTuple):
    """One time that a thread came late: by how much, and how long before the end of the watch it ran again."""

    late_ms: float
    ago_s: float


class StreamLostError(Exception):
    """What has to come in time did not: setpoints of a servo, or torques of a board.

    Attributes:
        within_s: so long ago at most. `ANY_TIME_S` where nobody knows when.
    """

    def __init__(self, told: str = "", within_s: float = RECENT_S) -> None:
        super().__init__(told)
        self.within_s = within_s


def unless_stalled(run: Callable[[], Found], settle: Callable[[], object] = lambda: None) -> Found:
    """What a run finds. One that lost its stream is made again, after `settle`, if this machine stalled shortly before.

    Every run that is made again is a warning in the report of the tests.
    """
    for _ in range(TRIES):
        with watch_for_stalls() as stalls:
            try:
                return run()
            except StreamLostError as error:
                lost = error
        long = [stall for stall in stalls if stall.late_ms > EXCUSES_MS and stall.ago_s <= lost.within_s]
        assert long, f"lost without a stall of the machine that explains it ({lost}); there were {stalls}"
        warnings.warn(f"made again, for this machine stalled: {long}; lost: {lost}", stacklevel=2)
        settle()
    raise AssertionError(f"this machine stalled in each of {TRIES} runs")


@contextmanager
def watch_for_stalls() -> Iterator[list[Stall]]:
    """Gives a list that holds, after the block, what stalled meanwhile; each for more than `LATE_MS`."""
    stalls: list[Stall] = []
    command = [sys.executable, "-m", "tests.support.stall_watch"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as watch:
        assert watch.stdin is not None
        assert watch.stdout is not None
        assert watch.stdout.readline() == "watches\n"
        try:
            yield stalls
        finally:
            watch.stdin.close()
            stalls += [Stall(*map(float, line.split())) for line in watch.stdout]


def _watch(processor: int, over: threading.Event, seen: list[tuple[float, float]]) -> None:
    """Until it is over: when this thread woke too late, and by how much, s. One that is late just now is told too."""
    os.sched_setaffinity(0, {processor})  # this thread's
    slept = time.monotonic()
    while not over.is_set():
        time.sleep(SLEEP_S)
        woken = time.monotonic()
        if woken - slept > SLEEP_S + 1e-3 * LATE_MS:
            seen.append((woken, woken - slept - SLEEP_S))
        slept = woken


def main() -> None:
    """Watch until nobody holds the other end of standard input."""
    over, seen = threading.Event(), list[tuple[float, float]]()
    threads = [threading.Thread(target=_watch, args=(each, over, seen)) for each in os.sched_getaffinity(0)]
    for thread in threads:
        thread.start()
    print("watches", flush=True)
    sys.stdin.read()
    ended = time.monotonic()
    over.set()
    for thread in threads:
        thread.join()
    for woken, late in seen:
        print(f"{1e3 * late:.0f} {ended - woken:.2f}")


if __name__ == "__main__":
    main()
