"""Wake-ups of RCI tasks, in Python, compiled and in C, and what messages and shared memory take between processors.

The peer of all is a bare loop in C, measured in the same run; where cyclictest is installed it stands beside it.
"""

from __future__ import annotations

import subprocess
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from benchmarks.c_programs import made
from benchmarks.ctwin import compiler
from benchmarks.rci_answers import answers
from benchmarks.rci_pairs import latencies
from benchmarks.rows import Goal, Row, against, row
from benchmarks.timing import Effort
from benchmarks.wakeup import BUSY, CYCLICTEST, IDLE, busy_thread, cyclictest_turn
from qrobot import rci
from qrobot.rci.compiled import time_of_tick
from qrobot.realtime.clock import monotonic_ns
from qrobot.realtime.jit import lean_kernel

LAST: Final = 0.99
RATES_HZ: Final = (36, 100, 250, 1000)
TASKS: Final = (1, 3, 5)
QUANTILES: Final = {"p50": 0.5, "p99": LAST}
ANSWER: Final = Goal(100.0)  # us, beside an idle machine
TWIN: Final = "C loop"
TURNS: Final = 3.0  # of a wake-up loop that each case takes: 6 s of a full run, 68 cases in seven minutes
NOTES: Final = 3  # words of a compiled task in front of its notes
CLOSE_NS: Final = 5000  # to which the instant of a tick is found
NS_PER_S: Final = 1_000_000_000
Latencies = NDArray[np.float64]


def rows(effort: Effort) -> Iterator[Row]:
    """The rows; those of C only with a compiler, those of cyclictest where it may run."""
    with tempfile.TemporaryDirectory() as folder:
        program = None if compiler() is None else made("rci_wakeup", Path(folder))
        for rate in RATES_HZ:
            yield from rate_rows(program, rate, max(20, round(rate * TURNS * effort.wake_up_s)))
        if program is not None:
            for what in ("messages", "memory"):
                late, _ = measured_in_c(program, what, 1000, 1, max(100, round(5000 * effort.wake_up_s)))
                yield from lone(f"RCI in C, {what} from one processor to another", late)
            late, _ = answers(program, max(100, round(5000 * effort.wake_up_s)))
            yield from lone("RCI in C, from a STATE sent to its COMMAND received, at 1000 Hz", late, ANSWER)
        for what in ("messages", "memory"):
            late = latencies(what, max(20, round(1000 * effort.wake_up_s)))
            yield from lone(f"RCI in Python, {what} from one processor to another", late)


def rate_rows(program: Path | None, rate: int, runs: int) -> Iterator[Row]:
    """One to five tasks at a rate: in C, and in Python and compiled beside an interpreter at rest or at work."""
    peer = None if program is None else measured_in_c(program, "twin", rate, 1, runs)[0]
    if (turn := cyclictest_turn(NS_PER_S // rate, runs / rate)) is not None:
        yield from beside(case(rate, IDLE, CYCLICTEST), turn.late_us, peer)
    if peer is not None:
        yield from beside(case(rate, IDLE, TWIN), peer, None)
    for count in TASKS:
        if program is not None and peer is not None:
            late, missed = measured_in_c(program, "tasks", rate, count, runs)
            yield from beside(case(rate, IDLE, f"C, tasks: {count}"), late, peer, missed)
        for load in (IDLE, BUSY):
            with busy_thread(load == BUSY):
                measured = {"Python": measured_in_python(rate, count, runs)}
                measured["compiled"] = measured_compiled(rate, count, runs)
            for kind, (late, missed) in measured.items():
                yield from beside(case(rate, load, f"{kind}, tasks: {count}"), late, peer, missed)


def case(rate: int, load: str, loop: str) -> dict[str, str]:
    """Labels of a line of the page's table."""
    return {"table": "RCI", "rate": f"{rate} Hz", "load": load, "loop": loop}


def measured_in_c(program: Path, what: str, rate: int, count: int, runs: int) -> tuple[Latencies, int]:
    """Latencies, us, and missed wake-ups of `c/rci_wakeup.c`."""
    command = [program, what, str(rate), str(count), str(runs)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return np.array(said[:-1], float) / 1e3, int(said[-1])


def measured_in_python(rate: int, count: int, runs: int) -> tuple[Latencies, int]:
    """The same of tasks on the processor "host"."""
    late: list[int] = []
    rci.rci_clock(rate)
    tds = [rci.rci_create(f"task{k}") for k in range(count)]
    epoch_ns = _epoch_ns(rate)
    for td in tds:
        rci.rci_control(td, partial(_note, late, epoch_ns, rate))
        rci.rci_onclock(td, 1)
    rci.rci_start(sum(td.bit for td in tds))
    rci.rci_wait(lambda: tds[0].runs >= runs)
    missed = sum(td.missed for td in tds)
    rci.rci_close()
    return np.array(late, float) / 1e3, missed


def measured_compiled(rate: int, count: int, runs: int) -> tuple[Latencies, int]:
    """The same of tasks on the processors "compiled", one each."""
    rci.rci_clock(rate)
    tds = [rci.rci_create(f"task{k}", f"compiled{k}") for k in range(count)]
    memories = [rci.rci_shared_memory(td.name, 8 * (NOTES + runs)).view(np.float64) for td in tds]
    epoch_ns = _epoch_ns(rate)
    for td, memory in zip(tds, memories, strict=True):
        memory[:NOTES] = epoch_ns, rate, 0.0
        rci.rci_control(td, note_compiled)
        rci.rci_onclock(td, 1)
    rci.rci_start(sum(td.bit for td in tds))
    rci.rci_wait(lambda: all(memory[2] >= runs for memory in memories))
    missed = sum(td.missed for td in tds)
    rci.rci_close()
    return np.concatenate([memory[NOTES:] for memory in memories]) / 1e3, missed


@lean_kernel
def note_compiled(tick: int, memory: Latencies) -> None:
    """Words 0 to 2 are the instant of tick 0, the clock's rate and the number of notes; notes follow, ns."""
    late_ns = monotonic_ns() - int(memory[0]) - time_of_tick(tick, int(memory[1]))
    at = NOTES + int(memory[2])
    if at < memory.size:
        memory[at] = late_ns
        memory[2] += 1.0


def _note(late: list[int], epoch_ns: int, rate: int, _td: rci.TaskDescriptor) -> None:
    due_ns = epoch_ns + rci.rci_ticks() * NS_PER_S // rate
    late.append(time.monotonic_ns() - due_ns)


def _epoch_ns(rate: int) -> int:
    """The instant of tick 0, by looking at clock and ticks until they leave no room; preemption cannot mislead it."""
    earliest, latest = -NS_PER_S, time.monotonic_ns()
    while latest - earliest > CLOSE_NS:
        before = time.monotonic_ns()
        tick = rci.rci_ticks()
        earliest = max(earliest, before - (tick + 1) * NS_PER_S // rate)
        latest = min(latest, time.monotonic_ns() - tick * NS_PER_S // rate)
    return (earliest + latest) // 2


def beside(case: dict[str, str], late: Latencies, peer: Latencies | None, missed: int | None = None) -> Iterator[Row]:
    """Quantiles beside those of the bare loop, and what was missed where that is counted."""
    name = f"RCI at {case['rate']}, {case['loop']}, {case['load']}"
    for label, share in QUANTILES.items():
        value = float(np.quantile(late, share))
        if peer is None:
            yield row(f"{name}, {label}", value, "us", figure=label, **case)
        else:
            yield against(f"{name}, {label}", value, "us", TWIN, float(np.quantile(peer, share)), figure=label, **case)
    if missed is not None:
        yield row(f"{name}, missed", missed, "", figure="missed", **case)


def lone(name: str, late: Latencies, goal: Goal | None = None) -> Iterator[Row]:
    """Quantiles; a goal is one of the last."""
    for label, share in QUANTILES.items():
        yield row(f"{name}, {label}", float(np.quantile(late, share)), "us", goal if share == LAST else None)
