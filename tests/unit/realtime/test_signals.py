"""A process that is asked to end ends, wherever the signal meets it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from qrobot.realtime.signals import NEEDED_S, SignalEvent, SignalledEnd, ends_as_ctrl_c, handled, set_on_signals
from tests.support.patience import PATIENCE_S
from tests.support.signals import at_once, default_signals

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


def meets(*numbers: signal.Signals) -> bool:
    """Whether the signals that come at one moment interrupt."""
    try:
        at_once(*numbers)
    except KeyboardInterrupt:
        return True
    return False


def ended_with(error: BaseException, *numbers: signal.Signals) -> BaseException | None:
    """What leaves the block in which these signals interrupt, and then the error is raised."""
    try:
        with ends_as_ctrl_c():
            assert all(map(meets, numbers))
            raise error
    except BaseException as left:
        return left


@pytest.mark.parametrize("first", [(signal.SIGTERM,), (signal.SIGHUP,), (signal.SIGHUP, signal.SIGTERM)])
def test_what_closes_a_terminal_interrupts_once_and_sigterm_and_ctrl_c_do_so_again(
    first: tuple[signal.Signals, ...],
) -> None:
    """The kernel sends SIGHUP, and the shell another one, while an arm is brought to rest."""
    with default_signals(signal.SIGTERM, signal.SIGHUP):
        with ends_as_ctrl_c() as came:
            assert not came()
            assert meets(*first)
            assert came()
            assert not meets(signal.SIGHUP)
            assert meets(signal.SIGTERM) == (signal.SIGTERM in first)
            assert meets(signal.SIGTERM)
            assert meets(signal.SIGINT)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_DFL


def test_what_a_script_runs_in_the_background_hears_sigterm_though_ctrl_c_is_ignored_there() -> None:
    with default_signals(signal.SIGTERM), handled({signal.SIGINT: signal.SIG_IGN}), ends_as_ctrl_c() as came:
        assert not meets(signal.SIGINT)
        assert not came()
        assert meets(signal.SIGTERM)
        assert meets(signal.SIGTERM)
        assert came()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_the_status_tells_the_signal_also_when_a_closed_terminal_takes_no_word_any_more(
    number: signal.Signals,
) -> None:
    with default_signals(number):
        for error in (KeyboardInterrupt(), OSError(5, "Input/output error")):
            left = ended_with(error, number)
            assert isinstance(left, SignalledEnd)
            assert left.status == 128 + number
    for error in (KeyboardInterrupt(), OSError(5, "Input/output error")):
        assert ended_with(error) is error


def test_a_command_under_nohup_does_not_hear_of_its_terminal() -> None:
    with handled({signal.SIGHUP: signal.SIG_IGN}), ends_as_ctrl_c() as came:
        assert not meets(signal.SIGHUP)
        assert not came()
