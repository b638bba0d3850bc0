"""Real-time features of this machine, and those a running process has got: looked at, never changed.

Every look takes the root of the file system as an argument, so that tests can show it another machine.
"""

from __future__ import annotations

import os
import platform
import resource
from contextlib import suppress
from pathlib import Path
from typing import Final

from qrobot.realtime.setup import DMA_LATENCY, SetupStep

ROOT: Final = Path("/")
_THROTTLE_FLOOR: Final = 0.9  # share of each second that SCHED_FIFO threads must be left
_POLICY_NAMES: Final = {os.SCHED_OTHER: "SCHED_OTHER", os.SCHED_FIFO: "SCHED_FIFO", os.SCHED_RR: "SCHED_RR"}


def _read(path: Path) -> str | None:
    with suppress(OSError):
        return path.read_text(errors="replace").strip()
    return None


def machine_steps(root: Path = ROOT) -> list[SetupStep]:
    """All looks at the machine."""
    return [
        look_at_cpus(),
        look_at_kernel(root),
        look_at_governor(root),
        look_at_throttling(root),
        look_at_quota(root),
        look_at_limits(),
    ]


def look_at_cpus() -> SetupStep:
    """The loop wants a processor of its own beside one for everything else."""
    allowed = sorted(os.sched_getaffinity(0))
    enough = len(allowed) >= 2
    remedy = "" if enough else "give the controller a second CPU (affinity mask, container's cpuset)"
    return SetupStep("processors", enough, f"allowed: {','.join(map(str, allowed))}", remedy)


def look_at_kernel(root: Path = ROOT, version: str | None = None) -> SetupStep:
    """Preemption model; `version` stands for `uname -v`."""
    name, text = "kernel", platform.version() if version is None else version
    if _read(root / "sys/kernel/realtime") == "1" or "PREEMPT_RT" in text:
        return SetupStep(name, True, "PREEMPT_RT")
    for flavour in ("PREEMPT_DYNAMIC", "PREEMPT"):
        if flavour in text:
            return SetupStep(name, True, f"{flavour}; a PREEMPT_RT kernel bounds the rare long wake-ups too")
    return SetupStep(
        name, False, "no preemption inside the kernel", "install a PREEMPT_RT kernel (Debian: linux-image-rt)"
    )


def look_at_governor(root: Path = ROOT) -> SetupStep:
    """Frequency scaling lengthens a cycle after each pause."""
    name = "governor"
    files = sorted((root / "sys/devices/system/cpu").glob("cpu[0-9]*/cpufreq/scaling_governor"))
    found = sorted({text for text in map(_read, files) if text})
    if not found:
        return SetupStep(name, True, "no frequency scaling (fixed, or left to the host)")
    good = found == ["performance"]
    return SetupStep(name, good, ", ".join(found), "" if good else "cpupower frequency-set -g performance")


def throttled_to(root: Path = ROOT) -> float | None:
    """Share of each period that the kernel leaves SCHED_FIFO threads; None where it does not throttle them."""
    kernel = root / "proc/sys/kernel"
    runtime, period = _read(kernel / "sched_rt_runtime_us"), _read(kernel / "sched_rt_period_us")
    if runtime is None or period is None or runtime == "-1":
        return None
    return int(runtime) / int(period)


def look_at_throttling(root: Path = ROOT) -> SetupStep:
    """The kernel stops SCHED_FIFO threads that use up their share of a period."""
    name, share = "throttling", throttled_to(root)
    if share is None:
        return SetupStep(name, True, "the kernel does not throttle real-time threads")
    good = share >= _THROTTLE_FLOOR
    return SetupStep(
        name, good, f"real-time threads get {share:.0%} of the time",
        "" if good else "sysctl kernel.sched_rt_runtime_us=950000",
    )  # fmt: skip


def look_at_quota(root: Path = ROOT) -> SetupStep:
    """A container's CPU quota stops every thread for the rest of its period, real-time or not."""
    name = "container quota"
    words = (_read(root / "sys/fs/cgroup/cpu.max") or "max").split()
    if words[0] == "max":
        return SetupStep(name, True, "none")
    share = int(words[0]) / int(words[1])
    return SetupStep(name, False, f"{share:.2g} CPUs", "run the container without a CPU quota (docker: no --cpus)")


def look_at_limits() -> SetupStep:
    """Read the limits of an unprivileged user. Root has none; a container may forbid it all the same (`set_fifo`)."""
    name = "limits"
    if os.geteuid() == 0:
        return SetupStep(name, True, "none for root")
    rtprio, memlock = (resource.getrlimit(which)[0] for which in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK))
    unlimited = memlock == resource.RLIM_INFINITY
    detail = f"rtprio {rtprio}, memlock {'unlimited' if unlimited else f'{memlock // 1024} kB'}"
    good = rtprio >= 80 and unlimited
    remedy = (
        "put '@realtime - rtprio 90' and '@realtime - memlock unlimited' in /etc/security/limits.d, join that group"
    )
    return SetupStep(name, good, detail, "" if good else remedy)


def observe_process(pid: int, root: Path = ROOT) -> list[SetupStep]:
    """Read what process `pid` has in force: scheduler and CPU of its most urgent thread, locked memory, idle states.

    Empty when the process has ended or belongs to somebody else.
    """
    proc = root / f"proc/{pid}"
    try:
        threads = [int(entry.name) for entry in (proc / "task").iterdir()]
        urgent = max(threads, key=lambda thread: os.sched_getparam(thread).sched_priority)
        return [_observe_scheduler(urgent), _observe_memory(proc), _observe_idle_states(proc)]
    except (OSError, ValueError):
        return []


def _observe_scheduler(thread: int) -> SetupStep:
    policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    cpus = ",".join(map(str, sorted(os.sched_getaffinity(thread))))
    priority = os.sched_getparam(thread).sched_priority
    return SetupStep(
        "scheduler", policy == os.SCHED_FIFO, f"{_POLICY_NAMES.get(policy, policy)} {priority} on CPU {cpus}"
    )


def _observe_memory(proc: Path) -> SetupStep:
    lines = (proc / "status").read_text().splitlines()
    locked_kb = next((int(line.split()[1]) for line in lines if line.startswith("VmLck:")), 0)
    return SetupStep("memory", locked_kb > 0, f"{locked_kb // 1024} MB locked")


def _observe_idle_states(proc: Path) -> SetupStep:
    held = False
    for entry in (proc / "fd").iterdir():
        with suppress(OSError):
            held = held or os.readlink(entry) == str(DMA_LATENCY)
    return SetupStep("idle states", held, "deep idle states are off" if held else "not held")
