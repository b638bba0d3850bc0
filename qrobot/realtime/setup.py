"""Make a thread and its process fit for real time, one small step at a time; a refused step is reported, never fatal.

The order and the worth of each step were measured (wake-up error of a 4 kHz loop on a virtual machine): holding
/dev/cpu_dma_latency at 0 halves the median, a processor of its own and locked memory cut the tails, SCHED_FIFO keeps
other programs away. Steps come in pairs: one that acts here, and the look at what is in force in `realtime.machine`.
"""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from qrobot.errors import QRobotError

DMA_LATENCY: Final = Path("/dev/cpu_dma_latency")
HIGHEST_PRIORITY: Final = 85  # the guardian's, above the servo's
FAVOURED_NICENESS: Final = -10  # nine times the share of an ordinary thread

# constants of the C library
_MCL_CURRENT, _MCL_FUTURE = 1, 2
_M_TRIM_THRESHOLD, _M_MMAP_MAX = -1, -4
_PR_SET_TIMERSLACK = 29
_CAP_IPC_LOCK = 14


@dataclass(frozen=True)
class SetupStep:
    """One measure or one finding.

    Attributes:
        name: short and stable, for tables and logs.
        ok: in force, or as it should be.
        detail: what was found or done.
        remedy: what to do when not ok; empty otherwise.
    """

    name: str
    ok: bool
    detail: str
    remedy: str = ""


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _errno_text() -> str:
    return os.strerror(ctypes.get_errno())


def set_fifo(priority: int = 80) -> SetupStep:
    """Run the calling thread under SCHED_FIFO; its children start under the normal scheduler again.

    Where the user's limit is lower it gets that: better than to wait behind every thread that has any.
    """
    name = "scheduler"
    remedy = f"run as root, or give your user an rtprio limit of {HIGHEST_PRIORITY} or more in /etc/security/limits.d"
    try:
        _enter_fifo(priority)
    except (OSError, ValueError) as error:
        limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
        if isinstance(error, PermissionError) and 0 < limit < priority:
            with suppress(OSError):
                _enter_fifo(limit)
                return SetupStep(name, False, f"SCHED_FIFO {limit}: {priority} is above the user's limit", remedy)
        return SetupStep(name, False, f"SCHED_FIFO {priority} refused: {error}", remedy)
    return SetupStep(name, True, f"SCHED_FIFO {priority}")


def _enter_fifo(priority: int) -> None:
    os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority))


def leave_fifo() -> None:
    """Make the calling thread an ordinary one: to end a process takes longer than others can be kept from running."""
    with suppress(OSError):
        kept = os.sched_getscheduler(0) & os.SCHED_RESET_ON_FORK  # which only root may clear
        os.sched_setscheduler(0, os.SCHED_OTHER | kept, os.sched_param(0))


@contextmanager
def hard_to_delay(priority: int) -> Iterator[None]:
    """Let few others delay the calling thread while inside, where that is allowed, and no long search for garbage."""
    freeze_garbage()
    tighten_timers()
    set_fifo(priority)
    try:
        yield
    finally:
        leave_fifo()


@contextmanager
def favoured_thread(niceness: int = FAVOURED_NICENESS) -> Iterator[None]:
    """Let the calling thread stay an ordinary one, but wait for few others, where that is allowed.

    For a thread that holds what a real-time thread needs, as the lock of the interpreter: whatever keeps the one from
    running keeps the other waiting.
    """
    thread = threading.get_native_id()
    before = os.getpriority(os.PRIO_PROCESS, thread)
    _set_niceness(thread, min(before, niceness))
    try:
        yield
    finally:
        _set_niceness(thread, before)


def _set_niceness(thread: int, niceness: int) -> None:
    with suppress(OSError):  # not allowed, or the thread has ended
        os.setpriority(os.PRIO_PROCESS, thread, niceness)


def insist_on(steps: Iterable[SetupStep], required: bool, report: Callable[[str], None]) -> None:
    """Report every step that was refused. Raises QRobotError for them when they are `required`."""
    refused = [step for step in steps if not step.ok]
    for step in refused:
        report(f"real time: {step.name}: {step.detail}; {step.remedy}")
    if refused and required:
        raise QRobotError(f"real time was required, but: {', '.join(step.name for step in refused)}")


def pin_threads(cpu: int | None = None) -> SetupStep:
    """Keep the calling thread on `cpu` (default: the last allowed one) and all others of the process off it."""
    name = "affinity"
    allowed = os.sched_getaffinity(0)
    chosen = max(allowed) if cpu is None else cpu
    rest = allowed - {chosen}
    try:
        os.sched_setaffinity(0, {chosen})
    except (OSError, ValueError) as error:
        allowed_text = ",".join(map(str, sorted(allowed)))
        return SetupStep(
            name, False, f"CPU {chosen} refused: {error}", f"choose one of the allowed CPUs: {allowed_text}"
        )
    if not rest:
        return SetupStep(name, False, f"CPU {chosen} is the only one", "give the controller a second CPU")
    for thread in _other_threads():
        with suppress(OSError):  # it has ended meanwhile
            os.sched_setaffinity(thread, rest)
    return SetupStep(name, True, f"loop on CPU {chosen}, other threads on {','.join(map(str, sorted(rest)))}")


def _other_threads() -> list[int]:
    own = threading.get_native_id()
    return [int(entry) for entry in os.listdir("/proc/self/task") if int(entry) != own]


def lock_memory() -> SetupStep:
    """Keep all pages in memory, those to come as well."""
    name = "memory"
    remedy = "run as root, or set memlock to unlimited in /etc/security/limits.d"
    if not may_lock_all():  # with a finite limit later allocations would fail
        return SetupStep(name, False, "the limit of locked memory is finite", remedy)
    if _libc().mlockall(_MCL_CURRENT | _MCL_FUTURE) != 0:
        return SetupStep(name, False, f"mlockall refused: {_errno_text()}", remedy)
    return SetupStep(name, True, "all pages locked")


def may_lock_all() -> bool:
    """True when this process may lock any amount of memory."""
    unlimited = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY
    return unlimited or has_capability(_CAP_IPC_LOCK)


def has_capability(bit: int) -> bool:
    """True when capability number `bit` (linux/capability.h) is effective in this process."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith("CapEff:"):
                return bool(int(line.split()[1], 16) >> bit & 1)
    return False


def keep_heap() -> SetupStep:
    """Never give heap memory back to the system, so that it need not be faulted in again."""
    name = "heap"
    try:
        mallopt = _libc().mallopt
    except AttributeError:
        return SetupStep(name, False, "this C library has no mallopt", "use a glibc system")
    done = mallopt(_M_TRIM_THRESHOLD, -1) and mallopt(_M_MMAP_MAX, 0)
    return SetupStep(
        name, bool(done), "no trimming, no mmap" if done else "mallopt refused", "" if done else "use glibc"
    )


def tighten_timers() -> SetupStep:
    """Timer slack of the calling thread to 1 ns; the default of 50 us is added to every sleep outside SCHED_FIFO."""
    name = "timer slack"
    if _libc().prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) != 0:
        return SetupStep(name, False, f"prctl refused: {_errno_text()}", "use SCHED_FIFO, which has no slack")
    return SetupStep(name, True, "1 ns")


def freeze_garbage() -> SetupStep:
    """Collect garbage now and exempt what lives from all later collections."""
    gc.collect()
    gc.freeze()
    return SetupStep("garbage", True, f"{gc.get_freeze_count()} objects frozen")


@contextmanager
def hold_dma_latency(path: Path = DMA_LATENCY) -> Iterator[SetupStep]:
    """Forbid the deep idle states of the processors while inside; they cost 20 us per wake-up and some power."""
    name = "idle states"
    try:
        fd = os.open(path, os.O_WRONLY | os.O_CLOEXEC)
    except OSError as error:
        yield SetupStep(
            name, False, f"{path}: {error.strerror}", f"run as root, or give your group write access to {path}"
        )
        return
    try:
        os.write(fd, (0).to_bytes(4, "little"))
        yield SetupStep(name, True, "deep idle states are off")
    finally:
        os.close(fd)  # the kernel forgets the request with the last descriptor


def prepare_loop_thread(cpu: int | None = None, priority: int = 80) -> list[SetupStep]:
    """Everything for the calling thread and its process but the idle states, which go with arm power."""
    return [
        keep_heap(),
        lock_memory(),
        freeze_garbage(),
        tighten_timers(),
        pin_threads(cpu),
        set_fifo(priority),
    ]
