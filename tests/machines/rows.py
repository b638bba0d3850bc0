"""Machines that are slower, busier or out of step, made out of this one: each a row of the matrix."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

VIRTUAL: Final = ("-m", "not realtime")
REALTIME: Final = ("-m", "realtime")
SPIN: Final = "while True: pass"
# Folder of groups, quota of 50 ms in each 100, and weight: beside others the group gets its half first
# (Linux, admin-guide/cgroup-v2, scheduler/sched-bwc and cgroup-v1/cgroups).
QUOTAS: Final = (
    (Path("/sys/fs/cgroup"), (("cpu.max", "50000 100000"), ("cpu.weight", "10000"))),
    (Path("/sys/fs/cgroup/cpu"), (("cpu.cfs_quota_us", "50000"), ("cpu.shares", "262144"))),
)
# Factors of how long the tests wait before they give up: what comes late on a machine that is slow may still come.
BUSY_PATIENCE, HALF_PATIENCE = 2.0, 5.0
# A quota stops all for 50 ms at a time: a test whose stream of setpoints is lost by that is run again, and named.
HALF_RERUNS: Final = "2"
CLOCK: Final = Path(__file__).with_name("scaled_clock.c")


@dataclass(frozen=True)
class Place:
    """Where the tests run; processors and quota are inherited from this process.

    Attributes:
        environment: variables besides those of this process.
        workers: tests on virtual time that run at once.
    """

    environment: Mapping[str, str]
    workers: int


@dataclass(frozen=True)
class Row:
    """A machine.

    Attributes:
        what: in a few words.
        parts: what is run there, as arguments of pytest.
        make: gives the place, while its block runs.
    """

    what: str
    parts: tuple[tuple[str, ...], ...]
    make: Callable[[ExitStack], Place]


def _here(_stack: ExitStack) -> Place:
    return Place({}, len(os.sched_getaffinity(0)) + 1)


def _patient(place: Place, factor: float) -> Place:
    return replace(place, environment={**place.environment, "QROBOT_PATIENCE": f"{factor:g}"})


def _busy(stack: ExitStack) -> Place:
    for processor in os.sched_getaffinity(0):
        stack.enter_context(_busy_loop(processor))
    return _patient(_here(stack), BUSY_PATIENCE)


def _one(stack: ExitStack) -> Place:
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(before)})
    stack.callback(os.sched_setaffinity, 0, before)
    return _patient(Place({}, 1), BUSY_PATIENCE)


def _half(stack: ExitStack) -> Place:
    """Half the time of one processor: by a quota where that is allowed, else beside somebody who wants as much."""
    if not any(_quota(stack, *quota) for quota in QUOTAS):
        print("no quota can be had here: pinned to one processor, beside a busy loop", flush=True)
        stack.enter_context(_busy_loop(min(os.sched_getaffinity(0))))
    place = _patient(_one(stack), HALF_PATIENCE)
    return replace(place, environment={**place.environment, "QROBOT_RERUNS": HALF_RERUNS})


def _quota(stack: ExitStack, groups: Path, controls: Sequence[tuple[str, str]]) -> bool:
    """Move this process into a group with half a processor until the stack is closed; False where it may not."""
    group = groups / f"half-{uuid.uuid4().hex[:8]}"
    try:
        group.mkdir()
        stack.callback(group.rmdir)
        for control, value in controls:
            if not (group / control).exists():
                return False
            (group / control).write_text(value)
        (group / "cgroup.procs").write_text(str(os.getpid()))
    except OSError:
        return False
    stack.callback((groups / "cgroup.procs").write_text, str(os.getpid()))
    return True


def _scaled(factor: float) -> Callable[[ExitStack], Place]:
    def make(stack: ExitStack) -> Place:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        library = folder / "scaled_clock.so"
        compiler = os.environ.get("CC", "cc")
        subprocess.run([compiler, "-O2", "-Wall", "-Wextra", "-shared", "-fPIC", "-o", library, CLOCK], check=True)
        environment = {
            "LD_PRELOAD": str(library),
            "SCALED_CLOCK": f"{factor:g}",
            "SCALED_CLOCK_ORIGIN": f"{time.monotonic_ns()},{time.time_ns()}",
            "QROBOT_PATIENCE": f"{max(1.0, factor):g}",  # what the machine is given to do has not become less
            "ASAN_OPTIONS": "verify_asan_link_order=0",  # the library of the clock comes before the sanitizer's
        }
        return Place(environment, len(os.sched_getaffinity(0)) + 1)

    return make


ROWS: Final = {
    "quiet": Row("this machine as it is", (VIRTUAL, REALTIME), _here),
    "busy": Row("beside one busy loop per processor", (VIRTUAL, REALTIME), _busy),
    "one": Row("pinned to one processor", (VIRTUAL, REALTIME), _one),
    "half": Row("with half a processor", (VIRTUAL, REALTIME), _half),
    "fast": Row("wall clock ten times as fast", (VIRTUAL,), _scaled(10.0)),
    "slow": Row("wall clock ten times as slow", (VIRTUAL,), _scaled(0.1)),
}


@contextmanager
def _busy_loop(processor: int) -> Iterator[None]:
    loop = subprocess.Popen([sys.executable, "-c", SPIN])
    os.sched_setaffinity(loop.pid, {processor})
    try:
        yield
    finally:
        loop.kill()
        loop.wait()
