"""An interrupt in the middle of what must not be torn apart waits for its end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from qrobot.rig.interrupts import interrupted_by_signals, interrupts_deferred
from qrobot.rig.processes import Child, ProcessPlan, ProcessRig
from tests.support.processes import shared_starter
from tests.support.signals import at_once, default_signals

REPORT = "import signal; print(signal.getsignal(signal.SIGTERM) == signal.SIG_DFL)"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_comes_into_force_when_the_block_ends(tmp_path: Path, number: signal.Signals) -> None:
    done = []

    def work() -> None:
        with interrupts_deferred():
            os.kill(os.getpid(), number)
            done.append("work")
        done.append("more")

    with ProcessRig(tmp_path, shared_starter()), pytest.raises(KeyboardInterrupt):
        work()
    assert done == ["work"]


def test_without_one_everything_is_as_before() -> None:
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    with interrupts_deferred():
        process = subprocess.run([sys.executable, "-c", REPORT], check=True, stdout=subprocess.PIPE, text=True)
    assert process.stdout == "True\n"
    assert [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == before


def test_what_comes_together_interrupts_once_and_sigterm_that_comes_again_does_again() -> None:
    """A session that is closed may send both signals: what takes down after the first is not torn by the second."""
    taken_down = list[signal.Signals]()

    def meet(*numbers: signal.Signals) -> None:
        try:
            at_once(*numbers)
        finally:
            taken_down.append(numbers[-1])

    with default_signals(signal.SIGTERM, signal.SIGHUP), interrupted_by_signals():
        for numbers in ((signal.SIGTERM, signal.SIGHUP), (signal.SIGTERM,)):
            with pytest.raises(KeyboardInterrupt):
                meet(*numbers)
        meet(signal.SIGHUP)
    assert taken_down == [signal.SIGHUP, signal.SIGTERM, signal.SIGHUP]


def test_a_terminal_that_is_closed_interrupts_once_though_kernel_and_shell_tell_of_it() -> None:
    with default_signals(signal.SIGTERM, signal.SIGHUP), interrupted_by_signals():
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGHUP)
        signal.raise_signal(signal.SIGTERM)  # beside the other
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)


def test_a_process_that_was_being_started_when_ctrl_c_came_is_ended_with_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[subprocess.Popen[bytes]] = []
    spawn = ProcessRig._spawn

    def interrupted(rig: ProcessRig, plan: ProcessPlan) -> Child:
        child = spawn(rig, plan)
        started.append(child.process)
        os.kill(os.getpid(), signal.SIGINT)
        return child

    monkeypatch.setattr(ProcessRig, "_spawn", interrupted)
    with pytest.raises(KeyboardInterrupt), ProcessRig(tmp_path, shared_starter()) as rig:
        rig.start(ProcessPlan("board", ["board"], None))
    assert [process.returncode is None for process in started] == [False]
