"""The command whose tests stand back for those on the wall clock: where it runs, how it ends, and what is passed on."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.idle import LITTLE
from tests.support.patience import PATIENCE_S

TELL = """
import os
print(os.sched_getscheduler(0) == os.SCHED_IDLE or os.nice(0) == 19, os.getsid(0) == os.getpid())
try:
    print(open("/proc/self/autogroup").read().split()[-1])
except OSError:
    print("none")
"""
HEAR = """
import signal, sys
signal.signal(signal.{name}, lambda *_: sys.exit(7))
print("listens", flush=True)
while True:
    signal.pause()
"""


def idle(*command: str) -> subprocess.Popen[str]:
    words = [sys.executable, "-m", "tests.support.idle", *command]
    return subprocess.Popen(words, stdout=subprocess.PIPE, text=True)


def test_a_command_has_a_session_of_its_own_that_gets_little() -> None:
    with idle(sys.executable, "-c", TELL) as process:
        told, _ = process.communicate(timeout=PATIENCE_S)
    stands_back, niceness = told.splitlines()
    assert stands_back == "True True"
    assert niceness == (str(LITTLE) if Path("/proc/self/autogroup").exists() else "none")


@pytest.mark.parametrize(("ends", "status"), [("sys.exit(5)", 5), ("os.kill(os.getpid(), 9)", 137), ("pass", 0)])
def test_its_status_is_the_commands(ends: str, status: int) -> None:
    with idle(sys.executable, "-c", f"import os, sys; {ends}") as process:
        assert process.wait(PATIENCE_S) == status


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_what_would_end_it_ends_the_command(name: str) -> None:
    with idle(sys.executable, "-c", HEAR.format(name=name)) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "listens\n"
        process.send_signal(getattr(signal, name))
        assert process.wait(PATIENCE_S) == 7


def test_the_command_does_not_outlive_it() -> None:
    with idle(sys.executable, "-c", "import signal\nprint('runs', flush=True)\nsignal.pause()") as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "runs\n"
        process.kill()
        assert process.stdout.read() == ""  # nobody has its end any more
