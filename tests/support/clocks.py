"""Who may read a clock: tests marked `realtime`, and nobody else but the exceptions listed here.

`install` puts a checked function in the place of every clock of the `time` module before a module of ours is imported,
and in the place of `clock_gettime` and `clock_nanosleep` before a kernel is linked. They ask who calls: code of ours is
refused while a test on virtual time runs; pytest, hypothesis, Numba and the standard library are not. `datetime.now`
and its kind cannot be replaced: the linter forbids them (`pyproject.toml`).
"""

from __future__ import annotations

import ctypes
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Final

import llvmlite.binding as llvm

ROOT: Final = str(Path(__file__).resolve().parents[2])
OURS: Final = ("qrobot/", "tests/", "examples/")  # not benchmarks, which are there to measure
READINGS: Final = ("time", "monotonic", "perf_counter", "process_time", "thread_time", "clock_gettime")
CLOCKS: Final = (*READINGS, *(f"{name}_ns" for name in READINGS), "sleep")
CALENDARS: Final = ("localtime", "gmtime", "ctime", "asctime", "strftime")  # clocks when they are not told a time

# Files that may read a clock in any test, and why.
CALLERS: Final[dict[str, str]] = {
    "tests/support/patience.py": "bounds a wait for an event of another thread or process, by a minute",
    "qrobot/realtime/deadline.py": "bounds a wait for another process or thread, and pauses between two looks at it",
    "qrobot/servo/process/daemon.py": "its main thread owns a clock; each look at the priority is told the time",
    "qrobot/servo/operator/status.py": "tells the age of the board's image, and decides nothing by it",
    "qrobot/servo/laws/trial.py": "measures how long a law takes",
    "qrobot/hwif/bus.py": "pauses between two tries of a read of the board's image, which another thread writes",
    "qrobot/hwif/gateway.py": "its loop owns a clock; each step of a gateway is told the time",
    "qrobot/rccl_bridge/arm_time.py": "is asked by the server, whose loop owns a clock",
    "qrobot/rccl_bridge/server.py": "its loop owns a clock; a session is told the time, and tests make it patient",
    "qrobot/rci/tcp.py": "a program on a real socket lives on the wall clock; its motion goes by the states it gets",
    "qrobot/rccl/transforms.py": "tells how long a function of a program took, and decides nothing by it",
    "qrobot/realtime/interpreter.py": "tells how long a search for garbage took, and decides nothing by it",
    "qrobot/rig/lockstep.py": "tells how much faster than real time a rig ran, and decides nothing by it",
    "qrobot/rig/experiment.py": "tells how long an experiment took, and decides nothing by it",
    "qrobot/rig/deployed.py": "remembers when it asked for a guardian, to tell it from its predecessor",
    "qrobot/c_transport/callback_slot.py": "bounds a wait for the answer of a program in C",
    "qrobot/cli/identify_fit.py": "dates a model when nobody says from which day it is",
    "qrobot/log/follow.py": "names a log by the time it begins; each step of a follower is told the time",
    "qrobot/servo/memory/mailbox.py": "pauses between two tries of a read, of which it makes a number",
    "qrobot/hwif/modbus/panel.py": "its loop owns a clock; each step of the panel is told the time",
}

# Tests that may, though they are not `realtime`, by the beginning of their name, and why.
TESTS: Final[dict[str, str]] = {
    "tests/system/test_wrong_commands.py::test_a_wrong_command_is_one_line[guardian": "beats before it looks",
    "tests/unit/hwif/test_modbus_io.py::test_modules_of_a_deployment_file": "runs the loops of modules",
    "tests/unit/hwif/test_port.py::test_the_servo_owns_the_memory_of_its_card": "stamped by the servo",
    "tests/unit/hwif/test_port.py::test_the_servos_loop_reads_the_card": "runs the servo's loop, which owns a clock",
}


class ClockReadError(AssertionError):
    """A test on virtual time has read a clock, or has slept."""


class Watch:
    """What the test that runs now may do, and what it did."""

    def __init__(self) -> None:
        self.forbidden = False
        self.read: list[str] = []

    def refuse(self, what: str) -> ClockReadError:
        """Remember it too: the caller may catch what is raised, and a kernel cannot raise."""
        self.read.append(what)
        return ClockReadError(
            f"{what} in a test on virtual time: hand the time over as an argument, wait with "
            "tests/support/patience.py, or mark the test realtime if the wall clock is what it is about"
        )


WATCH: Final = Watch()


# ------------------------------------------------------------------------------------------------ clocks of kernels

_LIBC: Final = ctypes.CDLL(None)


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_void_p)
def clock_gettime(clock: int, now: int) -> int:
    """What kernels read, `qrobot/realtime/clock.py`."""
    _kernel_may("reads the clock")
    return int(_LIBC.clock_gettime(clock, ctypes.c_void_p(now)))


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p)
def clock_nanosleep(clock: int, flags: int, until: int, left: int) -> int:
    """What kernels sleep by; not at all where that is forbidden."""
    if _kernel_may("sleeps"):
        return int(_LIBC.clock_nanosleep(clock, flags, ctypes.c_void_p(until), ctypes.c_void_p(left)))
    return 0


def _kernel_may(what: str) -> bool:
    """Whether the Python function that called the kernel may read a clock; if not, it is remembered."""
    caller = _file_of(sys._getframe(2))
    allowed = not WATCH.forbidden or not _is_checked(caller)
    if not allowed:
        WATCH.refuse(f"a kernel called by {caller} {what}")
    return allowed


_COMPILED: Final = {"clock_gettime": clock_gettime, "clock_nanosleep": clock_nanosleep}


def may_read_clocks(name: str, realtime: bool) -> bool:
    """Whether the test of this name is marked so, or is an exception."""
    return realtime or any(name.startswith(exception) for exception in TESTS)


@contextmanager
def virtual_time_only() -> Iterator[None]:
    """Code of ours is refused every clock inside. Raises ClockReadError also at the end, for what nobody was told."""
    before = WATCH.forbidden, WATCH.read
    WATCH.forbidden, WATCH.read = True, []
    try:
        yield
        if WATCH.read:
            raise WATCH.refuse(WATCH.read[0])
    finally:
        WATCH.forbidden, WATCH.read = before


def install() -> None:
    """Check every clock of this process from now on. Modules of ours must not have been imported before."""
    for name in CLOCKS:
        setattr(time, name, _checked(getattr(time, name), name))
    for name in CALENDARS:
        setattr(time, name, _checked(getattr(time, name), name, given=2 if name == "strftime" else 1))
    for symbol, function in _COMPILED.items():
        llvm.add_symbol(symbol, ctypes.cast(function, ctypes.c_void_p).value)


def _file_of(frame: FrameType) -> str:
    """File of the code that runs in a frame, from the root of this project if it lies there."""
    return frame.f_code.co_filename.removeprefix(f"{ROOT}/")


def _is_checked(caller: str) -> bool:
    return caller.startswith(OURS) and caller not in CALLERS


def _checked(clock: Callable[..., Any], name: str, given: int | None = None) -> Callable[..., Any]:
    """The clock, refused to code of ours; `given` that many arguments it is none."""

    def checked(*arguments: Any) -> Any:
        if WATCH.forbidden and (given is None or len(arguments) < given or arguments[given - 1] is None):
            caller = _file_of(sys._getframe(1))
            if _is_checked(caller):
                raise WATCH.refuse(f"{caller} called time.{name}")
        return clock(*arguments)

    checked.__name__ = name
    return checked
