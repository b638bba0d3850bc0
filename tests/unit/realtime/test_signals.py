"""A process that is asked to end ends, wherever the signal meets it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from qrobot.realtime.signals import NEEDED_S, SignalEvent, set_on_signals
from tests.support.patience import PATIENCE_S
from tests.support.signals import default_signals

STORM = """
import os, signal, threading
from qrobot.realtime.signals import set_on_signals

def storm():
    for _ in range(20_000):
        os.kill(os.getpid(), signal.SIGTERM)

with set_on_signals() as done:
    thread = threading.Thread(target=storm)
    thread.start()
    while thread.is_alive():
        done.wait(1e-5)
print(done.is_set())
"""


def test_a_signal_that_comes_while_the_event_is_waited_for_never_hangs() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", STORM], capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )
    assert (ended.stdout, ended.returncode) == ("True\n", 0), ended.stderr


def test_either_signal_ends_a_wait_without_a_limit_and_then_does_what_it_did_before() -> None:
    before = signal.getsignal(signal.SIGTERM)
    for number in (signal.SIGTERM, signal.SIGINT):
        with set_on_signals() as done:
            assert not done.is_set()
            assert not done.wait(0.0)
            os.kill(os.getpid(), number)
            assert done.wait()
            assert done.is_set()
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_terminal_that_is_closed_ends_a_wait_once_the_process_is_not_needed_any_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = [0.0]
    monkeypatch.setattr("qrobot.realtime.signals.monotonic", lambda: now[0])
    with default_signals(signal.SIGHUP):
        with set_on_signals() as done:
            os.kill(os.getpid(), signal.SIGHUP)
            assert done.wait()
        needed = [True]
        with set_on_signals(lambda: needed[0]) as done:
            assert not done.is_set()
            needed[0] = False
            assert not done.is_set()
            needed[0] = True
            os.kill(os.getpid(), signal.SIGHUP)
            assert not done.wait(0.0)
            assert not done.is_set()
            needed[0] = False
            now[0] += NEEDED_S
            assert done.wait(0.0)
            needed[0] = True
            assert done.is_set()
            assert done.wait()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_DFL


def test_whether_the_process_is_needed_is_asked_now_and_then_not_at_each_look(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes files and locks, and loops of a millisecond look twice a round."""
    now, asked = [5.0], list[float]()

    def needed() -> bool:
        asked.append(now[0])
        return True

    monkeypatch.setattr("qrobot.realtime.signals.monotonic", lambda: now[0])
    event = SignalEvent()
    event.set_unless(needed)
    for _ in range(100):
        assert not event.is_set()
        assert not event.wait(0.0)
    now[0] += NEEDED_S
    assert not event.wait(0.0)
    assert not event.is_set()
    assert asked == [5.0, 5.0 + NEEDED_S]
    event.close()


def test_a_process_under_nohup_stays_when_its_terminal_is_closed() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with set_on_signals() as done:
        os.kill(os.getpid(), signal.SIGHUP)
        assert not done.is_set()
    signal.signal(signal.SIGHUP, before)


def test_it_may_be_set_more_often_than_anybody_looks() -> None:
    event = SignalEvent()
    for _ in range(70_000):  # a pipe holds 65,536 bytes
        event.set()
    assert event.wait()
    event.close()
