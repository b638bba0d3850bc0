"""What a program in C waits for: its start, and what a function of it costs at a sample."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final
from unittest.mock import patch

import numpy as np

from benchmarks.ctwin import SOURCES, compiler
from benchmarks.rows import Goal, Row, against
from benchmarks.timing import Effort, interleaved
from qrobot import rccl
from qrobot.c_transport import engine
from qrobot.c_transport.message import BRIEF, Op
from qrobot.cli import toolchain
from qrobot.rccl.c.program import run_executable
from qrobot.rccl.offline import OfflineLink
from qrobot.wire import Command, Hello, State

PERIOD_S: Final = 0.028
FULL_SAMPLES: Final = 700
CALLS: Final = 4  # of callbacks.c at a sample
RUN: Final = (
    "import sys; from pathlib import Path; from qrobot import rccl; from qrobot.rccl.offline import OfflineLink\n"
    "from qrobot.rccl.c.program import run_executable\n"
    "with rccl.use(OfflineLink): sys.exit(run_executable(Path(sys.argv[1])))"
)
ECHO: Final = (
    f"import socket, sys; end = socket.socket(fileno=int(sys.argv[1]))\nwhile data := end.recv({BRIEF}): end.send(data)"
)
START: Final = "start of a C program, compiled before, to its first setpoint"
FIRST: Final = "first function of a C program at a sample"
OTHERS: Final = "each further one at the same sample"
LAST: Final = "the one at the end of the sample"


class PacedLink(OfflineLink):
    """An ideal arm with the period of a real one; every sample begins a new list of durations, ns."""

    def __init__(self, hello: Hello, samples: list[list[int]]) -> None:
        super().__init__(hello)
        self._samples = samples

    def exchange(self, command: Command | None) -> State:
        """As of an ideal arm, after a period."""
        time.sleep(PERIOD_S)
        self._samples.append([])
        return super().exchange(command)


def rows(effort: Effort) -> Iterator[Row]:
    """The rows; none without a C compiler."""
    if compiler() is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        yield start_row(Path(folder), effort)
        yield from call_rows(Path(folder), effort)


def made(name: str, folder: Path) -> Path:
    """The program of `c/name.c`."""
    program = folder / name
    subprocess.run(toolchain.command_line(["-O2", str(SOURCES / f"{name}.c"), "-o", str(program)]), check=True)
    return program


def start_row(folder: Path, effort: Effort) -> Row:
    """From the start of the interpreter to the end of the program's only motion."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(folder / "pycache")
    program = str(made("one_move", folder))

    def run(*arguments: str) -> None:
        subprocess.run([sys.executable, *arguments], env=environment, check=True)

    contenders = {"program": lambda: run("-c", RUN, program), "numba": lambda: run("-c", "import numba")}
    interleaved(contenders, 1)
    best = interleaved(contenders, effort.rounds)
    return against(START, best["program"], "s", "import of Numba", best["numba"], Goal(2.0))


def call_rows(folder: Path, effort: Effort) -> Iterator[Row]:
    """The middle one of many, beside a bare message to a process that sleeps, and its answer."""
    samples = effort.times(FULL_SAMPLES)
    first, second, third, last = np.median(call_times_us(made("callbacks", folder), samples), axis=0)
    bare, peer = bare_exchange_us(samples), "bare message to a sleeping process and back"
    yield against(FIRST, float(first), "us", peer, bare, Goal(20.0))
    yield against(OTHERS, float((second + third) / 2), "us", peer, bare, Goal(20.0))
    yield against(LAST, float(last), "us", peer, bare, Goal(20.0))


def call_times_us(program: Path, samples: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """How long each call takes in a process that computes nothing else. Shape (samples, CALLS)."""
    durations: list[list[int]] = [[]]

    class TimedBackground(engine.Background):
        def call(self, op: Op, place: int) -> None:
            began = time.perf_counter_ns()
            super().call(op, place)
            if op is not Op.SIGNAL:
                durations[-1].append(time.perf_counter_ns() - began)

    with patch.object(engine, "Background", TimedBackground), rccl.use(lambda hello: PacedLink(hello, durations)):
        run_executable(program, [str(samples * PERIOD_S * 1e3)])
    return np.array([each for each in durations if len(each) == CALLS]) / 1e3


def bare_exchange_us(samples: int) -> float:
    """The same message over the same kind of channel, without anything that could be saved: the middle one of many."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    command = [sys.executable, "-c", ECHO, str(theirs.fileno())]
    with ours, theirs, subprocess.Popen(command, pass_fds=[theirs.fileno()]) as echo:
        theirs.close()
        times = [exchange_ns(ours) for _ in range(samples)]
        ours.close()
        echo.wait()
    return float(np.median(times)) / 1e3


def exchange_ns(channel: socket.socket) -> int:
    """One message and its answer, a period after the one before."""
    time.sleep(PERIOD_S)
    began = time.perf_counter_ns()
    channel.send(bytes(BRIEF))
    channel.recv(BRIEF)
    return time.perf_counter_ns() - began
