"""Whether this machine kept processes from running for a while: told by one that does nothing but wake up.

    python -m tests.support.stall_watch

A line for each time that a thread on one of the processors came late, ms, until the process is ended.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Final, TypeVar

SLEEP_S: Final = 0.005
LATE_S: Final = 0.02  # beyond what it slept
TRIES: Final = 5
Found = TypeVar("Found")


class StreamLostError(Exception):
    """The servo had no setpoints for longer than the program is allowed to be late."""


def unless_stalled(run: Callable[[], Found], settle: Callable[[], object] = lambda: None) -> Found:
    """What a run finds. One that lost its stream is made again, after `settle`, if this machine stalled meanwhile."""
    for _ in range(TRIES):
        with watch_for_stalls() as late, suppress(StreamLostError):
            return run()
        assert late, "the stream was lost, and each processor was free for those that wanted it"
        settle()
    raise AssertionError(f"this machine stalled in each of {TRIES} runs")


@contextmanager
def watch_for_stalls() -> Iterator[list[float]]:
    """Gives a list that holds, after the block, by how much threads came late meanwhile, ms; each above `LATE_S`."""
    late: list[float] = []
    command = [sys.executable, "-m", "tests.support.stall_watch"]
    watch = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert watch.stdout is not None
    assert watch.stdout.readline() == "watches\n"
    try:
        yield late
    finally:
        watch.terminate()
        late += map(float, watch.communicate()[0].split())


def _watch(processor: int) -> None:
    os.sched_setaffinity(0, {processor})  # this thread's
    slept = time.monotonic()
    while True:
        time.sleep(SLEEP_S)
        woken = time.monotonic()
        if woken - slept > SLEEP_S + LATE_S:
            print(f"{1e3 * (woken - slept - SLEEP_S):.0f}", flush=True)
        slept = woken


def main() -> None:
    """Watch until the process is ended."""
    for processor in os.sched_getaffinity(0):
        threading.Thread(target=_watch, args=(processor,), daemon=True).start()
    print("watches", flush=True)
    threading.Event().wait()


if __name__ == "__main__":
    main()
