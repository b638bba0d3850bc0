"""What a move request costs the program that makes it, through ARCL and through RCCL, in Python and in C; off line.

Each call is timed by itself, in batches that the queue holds; the middle one of all counts. RCCL's has the call with it
that says the time.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter_ns
from typing import Final

import numpy as np

from benchmarks.c_programs import made
from benchmarks.ctwin import compiler
from benchmarks.rows import Row, against
from benchmarks.timing import Effort
from qrobot import arcl, rccl
from qrobot.arcl.c.dispatcher import ArclDispatcher
from qrobot.c_transport.program import run_served
from qrobot.rccl.c.program import rccl_dispatcher
from qrobot.rccl.offline import OfflineLink
from qrobot.rci.machine_choice import MachineChoice, use_machine

FULL_BATCHES: Final = 100
SIZE: Final = 10
TIME_MS: Final = 112.0


def rows(effort: Effort) -> Iterator[Row]:
    """One row for each language; none in C without a compiler. The best of several turns."""
    batches = effort.times(FULL_BATCHES)
    yield _beside("Python", effort.rounds, lambda: arcl_us(batches), lambda: rccl_us(batches))
    if compiler() is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        programs = [made(f"{name}_requests", Path(folder)) for name in ("arcl", "rccl")]
        yield _beside("C", effort.rounds, *(_runner(program, batches) for program in programs))


def _beside(language: str, rounds: int, ours: Callable[[], float], theirs: Callable[[], float]) -> Row:
    turns = [(ours(), theirs()) for _ in range(rounds)]
    best = [min(times) for times in zip(*turns, strict=True)]
    return against(f"move request of ARCL in {language}", best[0], "us", f"RCCL's in {language}", best[1])


def _runner(program: Path, batches: int) -> Callable[[], float]:
    return lambda: c_us(program, batches)


def arcl_us(batches: int) -> float:
    """The middle of many calls in Python, us."""
    with use_machine(MachineChoice("offline")):
        rp = arcl.arcl_open(arcl.ARCL_PERIOD, 28)
        places = [arcl.joint_pos(rp, f"{waist}", (waist, 135.0, 0.0, 0.0, 45.0, -180.0)) for waist in (0.0, 2.0)]
        times = timed_calls(
            batches, lambda k: arcl.move(rp, places[k % 2], arcl.MOV_TIME, TIME_MS, 0), lambda: arcl.arcl_wait(rp)
        )
        arcl.arcl_close(rp)
    return times


def rccl_us(batches: int) -> float:
    """The same of RCCL."""
    with rccl.use(OfflineLink), rccl.control("puma560") as arm:
        places = [arm.jposition(f"{waist}", [waist, -45.0, 180.0, 0.0, 45.0, 0.0]) for waist in (0.0, 2.0)]

        def request(k: int) -> None:
            arm.setime(100.0, TIME_MS)
            arm.move(places[k % 2])

        return timed_calls(batches, request, lambda: arm.waitfor(arm.completed))


def timed_calls(batches: int, request: Callable[[int], object], done: Callable[[], object]) -> float:
    """The middle of the calls of `request`, us; `done` waits until none of a batch is left."""
    durations: list[int] = []
    for _ in range(batches):
        for k in range(SIZE):
            began = perf_counter_ns()
            request(k)
            durations.append(perf_counter_ns() - began)
        done()
    return float(np.median(durations)) / 1e3


def c_us(program: Path, batches: int) -> float:
    """What a program of `c/arcl_requests.c` or `c/rccl_requests.c` measures, us."""
    told = program.with_suffix(".us")
    with use_machine(MachineChoice("offline")), rccl.use(OfflineLink):
        run_served(program, [str(batches), str(SIZE), str(told)], [rccl_dispatcher(), ArclDispatcher])
    return float(told.read_text())
