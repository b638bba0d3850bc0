"""Processor time of a thread, from compiled code: that of Python, and how often the kernel says that it gave way."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import threading
import time

import pytest

from qrobot.realtime.clock import monotonic_ns
from qrobot.realtime.jit import kernel
from qrobot.realtime.thread_time import thread_time
from qrobot.units import NS_PER_S
from tests.support.patience import PATIENCE_S

pytestmark = pytest.mark.realtime  # the clock is what they are about; no bound depends on how fast it goes

KEPT_OFF_NS = 20_000_000


@kernel
def now() -> tuple[int, int]:
    """The compiled reading."""
    return thread_time()


def python_now() -> tuple[int, int]:
    """Oracle."""
    return time.thread_time_ns(), resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw


def test_it_is_what_python_reads() -> None:
    now()
    for _ in range(20):
        before, found, after = python_now(), now(), python_now()
        assert before[0] <= found[0] <= after[0]
        assert before[1] <= found[1] <= after[1]


def test_who_sleeps_uses_no_processor_time_and_gives_the_processor_away() -> None:
    now()
    before = now()
    time.sleep(0.05)
    after = now()
    assert after[0] - before[0] < 50_000_000
    assert after[1] > before[1]


@kernel
def computes_until_it_is_kept_off(most_ns: int) -> tuple[int, int]:
    """Nanoseconds kept from running, `KEPT_OFF_NS` or more unless that took too long, and times it gave way itself."""
    began_ns, began = monotonic_ns(), thread_time()
    while True:
        seen = thread_time()
        passed_ns = monotonic_ns() - began_ns
        kept_off_ns = passed_ns - (seen[0] - began[0])
        if kept_off_ns > KEPT_OFF_NS or passed_ns > most_ns:
            return kept_off_ns, seen[1] - began[1]


def test_who_computes_beside_others_on_its_processor_does_not_give_it_away() -> None:
    computes_until_it_is_kept_off(0)
    processor, found = min(os.sched_getaffinity(0)), []
    beside = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    os.sched_setaffinity(beside.pid, {processor})

    def share() -> None:
        os.sched_setaffinity(0, {processor})  # of this thread
        until_s = time.monotonic() + PATIENCE_S
        while (not found or found[-1][1] > 0) and time.monotonic() < until_s:  # a page of memory may be waited for
            found.append(computes_until_it_is_kept_off(round(PATIENCE_S * NS_PER_S)))

    thread = threading.Thread(target=share)
    thread.start()
    thread.join()
    beside.kill()
    beside.wait()
    kept_off_ns, gave_way = found[-1]
    assert kept_off_ns > KEPT_OFF_NS
    assert gave_way == 0
