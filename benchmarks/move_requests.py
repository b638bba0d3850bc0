"""What a move request costs the program that makes it, through ARCL and through RCCL, in Python and in C, and a step
of VAL; off line.

Each call is timed by itself, in batches that the queue holds; the middle one of all counts. RCCL's has the call with it
that says the time.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from time import perf_counter_ns
from typing import Final
from unittest.mock import patch

import numpy as np

from benchmarks.c_programs import made
from benchmarks.ctwin import compiler
from benchmarks.rows import Row, against, row
from benchmarks.timing import Effort
from qrobot import arcl, rccl
from qrobot.arcl.c.dispatcher import ArclDispatcher
from qrobot.c_transport.program import run_served
from qrobot.rccl.c.program import rccl_dispatcher
from qrobot.rccl.connect import open_channel
from qrobot.rccl.offline import OfflineLink
from qrobot.rci.machine_choice import MachineChoice, use_machine
from qrobot.val import interpreter, tree
from qrobot.val.interpreter import Interpreter, do_step
from qrobot.val.rccl_arm import RcclArm
from qrobot.val.source import read_source
from qrobot.val.task import ValTask, Waits

FULL_BATCHES: Final = 100
SIZE: Final = 10
TIME_MS: Final = 112.0
VAL_PROGRAM: Final = """\
.PROGRAM main
    SPEED 100 ALWAYS
    SET #a = #PPOINT(0, -45, 180, 0, 45, 0)
    SET #b = #PPOINT(2, -45, 180, 0, 45, 0)
    FOR batch = 1 TO {batches}
        FOR k = 1 TO {half}
            x = 2*k+1
            MOVE #a
            y = x-k
            MOVE #b
        END
        BREAK
    END
.END
"""


def rows(effort: Effort) -> Iterator[Row]:
    """One row for each language; none in C without a compiler. The best of several turns."""
    batches = effort.times(FULL_BATCHES)
    python = _beside("Python", effort.rounds, lambda: arcl_us(batches), lambda: rccl_us(batches))
    yield python
    moves, assignments = (min(times) for times in zip(*(val_us(batches) for _ in range(effort.rounds)), strict=True))
    yield against("MOVE of a VAL program", moves, "us", python.peer, python.reference or 0.0)
    yield row("assignment of a VAL program", assignments, "us")
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


def val_us(batches: int) -> tuple[float, float]:
    """The middle one of many steps MOVE, and of as many assignments, us; parsed before, as a program's steps are."""
    source, _ = read_source(VAL_PROGRAM.format(batches=batches, half=SIZE // 2))
    durations: dict[bool, list[int]] = {True: [], False: []}

    def timed(run: Interpreter, task: ValTask, action: tree.StepAction) -> Waits | None:
        began = perf_counter_ns()
        waits = do_step(run, task, action)
        moves = isinstance(action, tree.Instruction) and action.word == "MOVE"
        first = [] if waits is None or not moves else [next(waits)]  # until then the motion is queued
        if moves or isinstance(action, tree.Assignment):
            durations[moves].append(perf_counter_ns() - began)
        return waits if waits is None else (wait for part in (first, waits) for wait in part)

    with open_channel(OfflineLink, "puma560") as channel, patch.object(interpreter, "do_step", timed):
        run = Interpreter(RcclArm(channel))
        run.machine.load(source)
        run.execute("main")
    return float(np.median(durations[True])) / 1e3, float(np.median(durations[False])) / 1e3


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
