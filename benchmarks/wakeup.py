"""Row 1: how late a periodic loop wakes. Ours with and without spinning, its C twin, plain Python, cyclictest.

All contenders take turns in one run, on the last processor, under SCHED_FIFO and with the idle states off, alone and
beside a Python thread that never gives up the interpreter. Figures of all turns are pooled. `cyclictest` is the one of
rt-tests (Linux Foundation), which does not spin: the share of a processor each loop takes stands beside it.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import resource
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.ctwin import pointer, twin
from benchmarks.rows import Goal, Row, against, row
from benchmarks.timing import Effort
from qrobot.realtime.clock import monotonic_ns
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.setup import hold_dma_latency, prepare_loop_thread
from qrobot.servo.process.loop import MARGIN_MAX_NS, first_deadline, next_deadline, wait_until

SPIN, SLEEP, TWIN, PYTHON, CYCLICTEST = "sleep then spin", "sleep alone", "C twin", "plain Python", "cyclictest"
IDLE, BUSY = "idle", "busy Python thread"
MARGIN_NS: Final = MARGIN_MAX_NS // 2
STALL_NS: Final = 20_000  # a spin that sees the clock jump by more was held up by the machine
FLOOR_S: Final = 2.0

GOALS: Final = {
    (SPIN, "p50"): Goal(0.1, "ratio"),
    (SPIN, "p99"): Goal(0.1, "ratio"),
    (SPIN, "p99.9"): Goal(1.0, "ratio"),
    (SLEEP, "p50"): Goal(1.1, "ratio"),
    (SLEEP, "p99"): Goal(1.1, "ratio"),
}
QUANTILES: Final = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999}

Body = Callable[[int, NDArray[np.int64]], object]  # period in ns, lateness of each wake-up in ns (out)


@dataclass(frozen=True)
class Turn:
    """Wake-ups of one turn: lateness in us; share of a processor and minor page faults where they can be had."""

    late_us: NDArray[np.float64]
    share: float | None = None
    faults: int | None = None


@lean_kernel
def wake_ups(period_ns: int, margin_ns: int, late: Any) -> None:
    """Fill `late` (int64, ns) with the wake-up errors of successive deadlines."""
    deadline = first_deadline(monotonic_ns(), period_ns)
    for k in range(late.size):
        margin_ns = wait_until(deadline, margin_ns)
        now = monotonic_ns()
        late[k] = now - deadline
        deadline = next_deadline(deadline, now, period_ns)


def python_wake_ups(period_ns: int, late: NDArray[np.int64]) -> None:
    """The same with `time.sleep`."""
    deadline = time.monotonic_ns() + period_ns
    for k in range(late.size):
        time.sleep(max(0.0, (deadline - time.monotonic_ns()) * 1e-9))
        now = time.monotonic_ns()
        late[k] = now - deadline
        deadline += (1 + max(0, now - deadline) // period_ns) * period_ns


def bodies() -> dict[str, Body]:
    """The loops that run in this process."""
    loops: dict[str, Body] = {
        SPIN: lambda period, late: wake_ups(period, MARGIN_NS, late),
        SLEEP: lambda period, late: wake_ups(period, 0, late),
        PYTHON: python_wake_ups,
    }
    if (library := twin("wakeup")) is not None:
        loops[TWIN] = lambda period, late: library.wake_ups(
            ctypes.c_long(period), ctypes.c_long(MARGIN_NS), pointer(late), ctypes.c_long(late.size)
        )
    return loops


def take_turn(body: Body, period_ns: int, duration_s: float) -> Turn:
    """Run a loop in a prepared thread of its own."""
    late = np.full(max(1, round(duration_s * 1e9 / period_ns)), -1, dtype=np.int64)
    spent: list[tuple[float, float, int]] = []

    def run() -> None:
        with hold_dma_latency():
            prepare_loop_thread()
            faults, cpu, wall = _minor_faults(), time.thread_time(), time.monotonic()
            body(period_ns, late)
            spent.append((time.thread_time() - cpu, time.monotonic() - wall, _minor_faults() - faults))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    cpu_s, wall_s, faults = spent[0]
    return Turn(late / 1e3, cpu_s / wall_s, faults)


def _minor_faults() -> int:
    return resource.getrusage(resource.RUSAGE_THREAD).ru_minflt


def cyclictest_turn(period_ns: int, duration_s: float) -> Turn | None:
    """cyclictest at the same rate and priority; None when it is not installed or may not run."""
    program = shutil.which("cyclictest")
    if program is None:
        return None
    loops, last = max(1, round(duration_s * 1e9 / period_ns)), (os.cpu_count() or 1) - 1
    command = [program, "-m", "-p80", f"-a{last}", "-t1", f"-i{period_ns // 1000}", f"-l{loops}", "-h5000", "-q"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    late = parse_histogram(ended.stdout)
    return Turn(late) if ended.returncode == 0 and late.size else None


def parse_histogram(text: str) -> NDArray[np.float64]:
    """Lateness of each wake-up, us, from cyclictest's histogram: lines of a latency and how often it was seen."""
    pairs = re.findall(r"^(\d{6}) (\d+)$", text, re.MULTILINE)
    return np.repeat([float(at) for at, _ in pairs], [int(count) for _, count in pairs])


@contextlib.contextmanager
def busy_thread(wanted: bool) -> Iterator[None]:
    """A thread that computes in Python all the time, if wanted."""
    stop = threading.Event()

    def compute() -> None:
        while not stop.is_set():
            sum(range(1000))

    thread = threading.Thread(target=compute, daemon=True)
    if wanted:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        if wanted:
            thread.join()


def measure(rate_hz: int, load: str, effort: Effort) -> dict[str, list[Turn]]:
    """Turns of all contenders at one rate, in rotated order."""
    period_ns, loops = 1_000_000_000 // rate_hz, bodies()
    names = [*loops, CYCLICTEST]
    turns: dict[str, list[Turn]] = {name: [] for name in names}
    with busy_thread(load == BUSY):
        for number in range(effort.rounds):
            for k in range(len(names)):
                name = names[(number + k) % len(names)]
                if name != CYCLICTEST:
                    turns[name].append(take_turn(loops[name], period_ns, effort.wake_up_s))
                elif (turn := cyclictest_turn(period_ns, effort.wake_up_s)) is not None:
                    turns[name].append(turn)
    return {name: taken for name, taken in turns.items() if taken}


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    wake_ups(1_000_000, MARGIN_NS, np.zeros(4, dtype=np.int64))
    for rate in effort.rates_hz:
        for load in (IDLE, BUSY):
            yield from figures(rate, load, measure(rate, load, effort))
    yield from floor_rows(effort)


def figures(rate_hz: int, load: str, turns: dict[str, list[Turn]]) -> Iterator[Row]:
    """What the turns at one rate come to; the peer is cyclictest, or plain Python where that is missing."""
    peer = CYCLICTEST if CYCLICTEST in turns else PYTHON
    theirs = _quantiles(turns[peer])
    for loop, taken in turns.items():
        case = {"table": "Wake-up", "rate": f"{rate_hz} Hz", "load": load, "loop": loop}
        name = f"wake-up at {rate_hz} Hz, {load}, {loop}"
        for label, value in _quantiles(taken).items():
            goal = GOALS.get((loop, label)) if peer == CYCLICTEST else None
            if loop == peer:
                yield row(f"{name}, {label}", value, "us", figure=label, **case)
            else:
                yield against(f"{name}, {label}", value, "us", peer, theirs[label], goal, figure=label, **case)
        for label, value, unit in _shares(taken, 1e6 / rate_hz):
            yield row(f"{name}, {label}", value, unit, figure=label, **case)
        if loop in (SPIN, SLEEP):
            faults = sum(turn.faults or 0 for turn in taken)
            yield row(f"{name}, minor page faults", faults, "", Goal(0), figure="page faults", **case)


def _pooled(turns: list[Turn]) -> NDArray[np.float64]:
    return np.concatenate([turn.late_us for turn in turns])


def _quantiles(turns: list[Turn]) -> dict[str, float]:
    late = _pooled(turns)
    return {label: float(np.quantile(late, share)) for label, share in QUANTILES.items()}


def _shares(turns: list[Turn], period_us: float) -> Iterator[tuple[str, float, str]]:
    """Parts per million of late wake-ups, and the processor's share in percent."""
    late = _pooled(turns)
    yield "> T/2", float(np.mean(late > 0.5 * period_us) * 1e6), "ppm"
    yield "> T", float(np.mean(late > period_us) * 1e6), "ppm"
    shares = [turn.share for turn in turns if turn.share is not None]
    if shares:
        yield "CPU", float(np.mean(shares) * 100.0), "%"


@lean_kernel
def stalls(duration_ns: int, counts: Any) -> None:
    """Spin on the clock; `counts` (int64[2], out) is how often it jumped by more than STALL_NS, and the ns lost."""
    last = monotonic_ns()
    end = last + duration_ns
    while last < end:
        now = monotonic_ns()
        if now - last > STALL_NS:
            counts[0] += 1
            counts[1] += now - last
        last = now


def floor_rows(effort: Effort) -> Iterator[Row]:
    """What the machine itself takes from a loop that never sleeps: no program can be better."""
    counts, duration_s = np.zeros(2, dtype=np.int64), effort.work * FLOOR_S
    stalls(1, counts)
    counts[:] = 0
    take_turn(lambda _period, _late: stalls(round(duration_s * 1e9), counts), 1_000_000_000, 1.0)
    yield row("stalls of the machine over 20 us", counts[0] / duration_s, "1/s")
    yield row("time the machine takes in them", counts[1] / duration_s * 1e-7, "%")
