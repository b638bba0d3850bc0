"""Processor time of a thread, from compiled code: that of Python, and the kernel's count of times it was taken away."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import threading
import time

import pytest

from qrobot.realtime.jit import kernel
from qrobot.realtime.thread_time import thread_time
from tests.support.patience import PATIENCE_S

pytestmark = pytest.mark.realtime  # the clock is what they are about; no bound depends on how fast it goes


@kernel
def now() -> tuple[int, int]:
    """The compiled reading."""
    return thread_time()


def python_now() -> tuple[int, int]:
    """Oracle."""
    return time.thread_time_ns(), resource.getrusage(resource.RUSAGE_THREAD).ru_nivcsw


def test_it_is_what_python_reads() -> None:
    now()
    for _ in range(20):
        before, found, after = python_now(), now(), python_now()
        assert before[0] <= found[0] <= after[0]
        assert before[1] <= found[1] <= after[1]


def test_who_sleeps_uses_no_processor_time() -> None:
    now()
    before = now()
    time.sleep(0.05)
    assert now()[0] - before[0] < 50_000_000


def test_who_shares_a_processor_has_it_taken_away() -> None:
    now()
    processor, found = min(os.sched_getaffinity(0)), []
    beside = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    os.sched_setaffinity(beside.pid, {processor})

    def share() -> None:
        os.sched_setaffinity(0, {processor})  # of this thread
        before, until_s = now(), time.monotonic() + PATIENCE_S
        while now()[1] == before[1] and time.monotonic() < until_s:
            pass
        found.append(now()[1] - before[1])

    thread = threading.Thread(target=share)
    thread.start()
    thread.join()
    beside.kill()
    beside.wait()
    assert found[0] > 0
