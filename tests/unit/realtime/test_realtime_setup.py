"""Each step of the real-time recipe acts where it may, and is reported where it may not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from contextlib import nullcontext
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from qrobot.errors import LinkError, QRobotError
from qrobot.realtime import machine, setup
from qrobot.realtime.setup import SetupStep
from tests.support.patience import PATIENCE_S

# Acts on a process of its own: pinning, locking and SCHED_FIFO must not outlive the test.
PROBE = """
import json, os, resource, signal, sys, threading
from dataclasses import asdict
from qrobot.realtime import machine, setup

if sys.argv[1] == "bounded":
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
    setup.has_capability = lambda bit: False
release = threading.Event()
other = threading.Thread(target=release.wait)
other.start()
found = {}

def loop():
    found["steps"] = [asdict(step) for step in setup.prepare_loop_thread()]
    found["own_cpus"] = sorted(os.sched_getaffinity(0))
    found["other_cpus"] = sorted(os.sched_getaffinity(other.native_id))
    found["policy"] = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    found["observed"] = [asdict(step) for step in machine.observe_process(os.getpid())]
    setup.leave_fifo()
    found["left"] = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK

allowed = sorted(os.sched_getaffinity(0))
thread = threading.Thread(target=loop)
thread.start()
thread.join()
release.set()
print(json.dumps(found | {"allowed": allowed, "fifo": os.SCHED_FIFO}))
"""


def probe(how: str = "free") -> dict[str, Any]:
    run = subprocess.run(
        [sys.executable, "-c", PROBE, how], capture_output=True, text=True, check=True, timeout=PATIENCE_S
    )
    found: dict[str, Any] = json.loads(run.stdout)
    return found


def named(steps: list[dict[str, Any]], name: str) -> dict[str, Any]:
    return next(step for step in steps if step["name"] == name)


def test_a_prepared_thread_has_the_last_cpu_for_itself_and_every_refusal_comes_with_a_remedy() -> None:
    found = probe()
    assert [step["name"] for step in found["steps"]] == [
        "heap", "memory", "garbage", "timer slack", "affinity", "scheduler",
    ]  # fmt: skip
    assert all(step["ok"] or step["remedy"] for step in found["steps"])
    assert found["own_cpus"] == [found["allowed"][-1]]
    if len(found["allowed"]) > 1:
        assert found["other_cpus"] == found["allowed"][:-1]


def test_what_a_step_reports_is_what_the_kernel_says() -> None:
    found = probe()
    assert named(found["steps"], "scheduler")["ok"] == (found["policy"] == found["fifo"])
    assert found["left"] == os.SCHED_OTHER
    for name in ("scheduler", "memory"):
        assert named(found["observed"], name)["ok"] == named(found["steps"], name)["ok"]


def test_memory_is_not_locked_under_a_finite_limit_because_later_allocations_would_fail() -> None:
    found = probe("bounded")
    step = named(found["steps"], "memory")
    assert not step["ok"]
    assert "memlock" in step["remedy"]
    assert named(found["observed"], "memory")["detail"] == "0 MB locked"


def test_a_cpu_that_does_not_exist_is_refused_with_the_allowed_ones() -> None:
    before = os.sched_getaffinity(0)
    step = setup.pin_threads(4095)
    assert not step.ok
    assert str(min(before)) in step.remedy
    assert os.sched_getaffinity(0) == before


def test_a_priority_out_of_range_is_refused_and_changes_nothing() -> None:
    before = os.sched_getscheduler(0)
    assert not setup.set_fifo(1000).ok
    assert os.sched_getscheduler(0) == before


def test_a_priority_above_the_users_limit_becomes_the_limit_and_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    got: list[int] = []

    def enter(priority: int) -> None:
        if priority > 50:
            raise PermissionError(1, "Operation not permitted")
        got.append(priority)

    monkeypatch.setattr(setup, "_enter_fifo", enter)
    monkeypatch.setattr(setup.resource, "getrlimit", lambda _which: (50, 50))
    step = setup.set_fifo(85)
    assert got == [50]
    assert not step.ok
    assert "SCHED_FIFO 50" in step.detail
    assert "rtprio" in step.remedy


@pytest.mark.parametrize(
    ("user", "limit", "told", "ok"),
    [(0, 0, "none for root", True), (1000, 0, "rtprio 0, memlock 0 kB", False), (1000, -1, "memlock unlimited", False)],
)
def test_limits_are_told_of_users_who_have_any(
    monkeypatch: pytest.MonkeyPatch, user: int, limit: int, told: str, ok: bool
) -> None:
    monkeypatch.setattr(machine.os, "geteuid", lambda: user)
    monkeypatch.setattr(machine.resource, "getrlimit", lambda _which: (limit, limit))
    step = machine.look_at_limits()
    assert told in step.detail
    assert (step.ok, bool(step.remedy)) == (ok, not ok)


def test_without_any_limit_nothing_is_got(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_priority: int) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(setup, "_enter_fifo", refuse)
    monkeypatch.setattr(setup.resource, "getrlimit", lambda _which: (0, 0))
    assert "SCHED_FIFO 85 refused" in setup.set_fifo(85).detail


def test_a_thread_that_was_hard_to_delay_ends_as_an_ordinary_one_even_by_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done: list[object] = []
    for name in ("freeze_garbage", "tighten_timers", "leave_fifo"):
        monkeypatch.setattr(setup, name, partial(done.append, name))
    monkeypatch.setattr(setup, "set_fifo", done.append)

    def lose_the_board() -> None:
        with setup.hard_to_delay(70):
            done.append("serves")
            raise LinkError("the board has gone")

    with pytest.raises(LinkError):
        lose_the_board()
    assert done == ["freeze_garbage", "tighten_timers", 70, "serves", "leave_fifo"]


@pytest.mark.parametrize("required", [False, True])
def test_what_was_refused_is_told_and_ends_a_process_that_requires_it(required: bool) -> None:
    steps = [setup.SetupStep("memory", True, "locked"), setup.SetupStep("scheduler", False, "refused", "run as root")]
    said: list[str] = []
    with pytest.raises(QRobotError, match="real time was required, but: scheduler") if required else nullcontext():
        setup.insist_on(steps, required, said.append)
    assert said == ["real time: scheduler: refused; run as root"]


def test_idle_states_are_held_while_inside_and_only_then(tmp_path: Path) -> None:
    device = tmp_path / "cpu_dma_latency"
    device.write_bytes(b"")
    open_before = len(os.listdir("/proc/self/fd"))
    with setup.hold_dma_latency(device) as step:
        assert step.ok
        assert device.read_bytes() == bytes(4)
        assert len(os.listdir("/proc/self/fd")) == open_before + 1
    assert len(os.listdir("/proc/self/fd")) == open_before


def test_a_missing_idle_state_device_is_reported_and_the_body_still_runs(tmp_path: Path) -> None:
    ran = False
    with setup.hold_dma_latency(tmp_path / "absent") as step:
        ran = True
    assert ran
    assert not step.ok
    assert step.remedy


def write(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return root


@pytest.mark.parametrize(
    ("version", "files", "ok", "word"),
    [
        ("#1 SMP PREEMPT_RT Debian", {}, True, "PREEMPT_RT"),
        ("#1 SMP", {"sys/kernel/realtime": "1\n"}, True, "PREEMPT_RT"),
        ("#1 SMP PREEMPT_DYNAMIC Debian", {}, True, "PREEMPT_DYNAMIC"),
        ("#1 SMP Debian", {"sys/kernel/realtime": "0\n"}, False, "no preemption"),
    ],
)
def test_the_kernel_is_known_by_its_preemption_model(
    tmp_path: Path, version: str, files: dict[str, str], ok: bool, word: str
) -> None:
    step = machine.look_at_kernel(write(tmp_path, files), version)
    assert (step.ok, word in step.detail, bool(step.remedy)) == (ok, True, not ok)


GOVERNOR = "sys/devices/system/cpu/cpu{}/cpufreq/scaling_governor"


def throttle(runtime: str) -> dict[str, str]:
    kernel = "proc/sys/kernel/sched_rt_{}_us"
    return {kernel.format("runtime"): runtime, kernel.format("period"): "1000000"}


@pytest.mark.parametrize(
    ("look", "files", "ok"),
    [
        (machine.look_at_governor, {}, True),
        (machine.look_at_governor, {GOVERNOR.format(0): "performance\n", GOVERNOR.format(1): "performance\n"}, True),
        (machine.look_at_governor, {GOVERNOR.format(0): "performance\n", GOVERNOR.format(1): "powersave\n"}, False),
        (machine.look_at_throttling, {}, True),
        (machine.look_at_throttling, throttle("-1"), True),
        (machine.look_at_throttling, throttle("950000"), True),
        (machine.look_at_throttling, throttle("500000"), False),
        (machine.look_at_quota, {}, True),
        (machine.look_at_quota, {"sys/fs/cgroup/cpu.max": "max 100000\n"}, True),
        (machine.look_at_quota, {"sys/fs/cgroup/cpu.max": "150000 100000\n"}, False),
    ],
)  # fmt: skip
def test_a_machine_is_judged_by_its_files(tmp_path: Path, look: Any, files: dict[str, str], ok: bool) -> None:
    step = look(write(tmp_path, files))
    assert step.ok == ok
    assert bool(step.remedy) == (not ok)


def test_a_process_that_has_ended_is_observed_as_nothing() -> None:
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    assert machine.observe_process(child.pid) == []


def test_every_look_at_this_machine_gives_a_step_with_a_remedy_when_not_ok() -> None:
    for step in machine.machine_steps():
        assert isinstance(step, SetupStep)
        assert step.ok or step.remedy
        assert json.dumps(asdict(step))


def test_a_favoured_thread_waits_for_few_others_until_it_no_longer_is(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[tuple[int, int]] = []
    monkeypatch.setattr(os, "setpriority", lambda _which, thread, niceness: said.append((thread, niceness)))
    thread, before = threading.get_native_id(), os.getpriority(os.PRIO_PROCESS, 0)
    with setup.favoured_thread():
        assert said == [(thread, min(before, setup.FAVOURED_NICENESS))]
    assert said[1:] == [(thread, before)]


def test_a_thread_that_may_not_be_favoured_goes_on_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: int) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(os, "setpriority", refuse)
    with setup.favoured_thread():
        assert os.getpriority(os.PRIO_PROCESS, 0) == os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
