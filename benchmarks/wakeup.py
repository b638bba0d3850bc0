"""How late a periodic loop wakes: ours with and without spinning, plain Python, and cyclictest where installed."""

from __future__ import annotations

import re
import shutil
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks.rows import Row, against
from qrobot.realtime.clock import monotonic_ns
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.setup import hold_dma_latency, prepare_loop_thread
from qrobot.servo.loop import MARGIN_MAX_NS, first_deadline, next_deadline, wait_until

RATES_HZ = (1000, 4000)
SECONDS = 4.0


@lean_kernel
def wake_ups(period_ns: int, margin_ns: int, late: Any) -> None:
    """Fill `late` (int64, ns) with the wake-up errors of successive deadlines."""
    deadline = first_deadline(monotonic_ns(), period_ns)
    for k in range(late.size):
        margin_ns = wait_until(deadline, margin_ns)
        now = monotonic_ns()
        late[k] = now - deadline
        deadline = next_deadline(deadline, now, period_ns)


def python_wake_ups(period_ns: int, late: Any) -> None:
    """The same with `time.sleep`."""
    deadline = time.monotonic_ns() + period_ns
    for k in range(late.size):
        time.sleep(max(0.0, (deadline - time.monotonic_ns()) * 1e-9))
        now = time.monotonic_ns()
        late[k] = now - deadline
        deadline += (1 + (now - deadline) // period_ns) * period_ns


def percentiles(body: Callable[[Any], None], period_ns: int) -> tuple[float, float]:
    """p50 and p99 in us of `body`, run in a prepared thread of its own."""
    late = np.zeros(round(SECONDS * 1e9 / period_ns), dtype=np.int64)

    def run() -> None:
        with hold_dma_latency():
            prepare_loop_thread()
            body(late)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    p50, p99 = np.percentile(late, [50, 99]) / 1e3
    return float(p50), float(p99)


def cyclictest(period_us: int) -> tuple[float, float] | None:
    """p50 and p99 in us of cyclictest at the same rate and priority; None when it is not installed or may not run."""
    program = shutil.which("cyclictest")
    if program is None:
        return None
    loops = round(SECONDS * 1e6 / period_us)
    command = [program, "-m", "-p80", "-a1", "-t1", f"-i{period_us}", f"-l{loops}", "-h5000", "-q"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    counts = np.array([[int(x) for x in m] for m in re.findall(r"^(\d{6}) (\d+)$", ended.stdout, re.MULTILINE)])
    if ended.returncode != 0 or not counts.size:
        return None
    share = np.cumsum(counts[:, 1]) / counts[:, 1].sum()
    p50, p99 = (float(counts[np.searchsorted(share, q), 0]) for q in (0.5, 0.99))
    return p50, p99


def rows() -> Iterator[Row]:
    """The rows."""
    wake_ups(1_000_000, MARGIN_MAX_NS // 2, np.zeros(4, dtype=np.int64))
    for rate in RATES_HZ:
        period_ns = 1_000_000_000 // rate
        contenders: dict[str, tuple[float, float]] = {
            "sleep then spin": percentiles(lambda late: wake_ups(period_ns, MARGIN_MAX_NS // 2, late), period_ns),  # noqa: B023
            "sleep alone": percentiles(lambda late: wake_ups(period_ns, 0, late), period_ns),  # noqa: B023
        }
        plain = percentiles(lambda late: python_wake_ups(period_ns, late), period_ns)  # noqa: B023
        peer, peer_name = cyclictest(period_ns // 1000), "cyclictest"
        if peer is None:
            peer, peer_name = plain, "plain Python"
        else:
            contenders["plain Python"] = plain
        for name, figures in contenders.items():
            for label, ours, theirs in zip(("p50", "p99"), figures, peer, strict=True):
                yield against(f"wake-up {label} at {rate} Hz, {name} against {peer_name}", ours, "us", theirs)
