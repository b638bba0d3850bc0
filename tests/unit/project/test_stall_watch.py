"""What excuses a lost stream in a test (tests/support/stall_watch.py): a long stall shortly before it alone."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.support import stall_watch
from tests.support.patience import give_time
from tests.support.stall_watch import (
    ANY_TIME_S,
    EXCUSES_MS,
    RECENT_S,
    ROOT,
    TRIES,
    Stall,
    StreamLostError,
    unless_stalled,
    watch_for_stalls,
)

SHORT, LONG, LONG_AGO = Stall(30.0, 0.1), Stall(EXCUSES_MS + 1.0, 0.1), Stall(500.0, RECENT_S + 1.0)
STOPPED_S = 0.2


class Losing:
    """A run that loses its stream so many times, on a machine with these stalls, and then is well."""

    def __init__(
        self, monkeypatch: pytest.MonkeyPatch, losses: int, *stalls: Stall, within_s: float = RECENT_S
    ) -> None:
        self._losses, self._within_s = losses, within_s
        self.runs = self.settled = 0

        @contextmanager
        def fake() -> Iterator[list[Stall]]:
            seen: list[Stall] = []
            yield seen
            seen += stalls  # not before the end of the block, as the watch itself

        monkeypatch.setattr(stall_watch, "watch_for_stalls", fake)

    def run(self) -> str:
        self.runs += 1
        if self.runs <= self._losses:
            raise StreamLostError("told", self._within_s)
        return "found"

    def settle(self) -> None:
        self.settled += 1


@pytest.mark.parametrize("stalls", [(), (SHORT,), (LONG_AGO,), (SHORT, LONG_AGO)])
def test_a_loss_beside_a_short_stall_or_long_after_one_is_not_excused(
    monkeypatch: pytest.MonkeyPatch, stalls: tuple[Stall, ...]
) -> None:
    losing = Losing(monkeypatch, 1, *stalls)
    with pytest.raises(AssertionError, match=r"without a stall of the machine that explains it \(told\)"):
        unless_stalled(losing.run, losing.settle)
    assert (losing.runs, losing.settled) == (1, 0)


@pytest.mark.parametrize(("stall", "within_s"), [(LONG, RECENT_S), (LONG_AGO, ANY_TIME_S)])
def test_a_loss_shortly_after_a_long_stall_is_made_again_and_told(
    monkeypatch: pytest.MonkeyPatch, stall: Stall, within_s: float
) -> None:
    losing = Losing(monkeypatch, 1, SHORT, stall, within_s=within_s)
    with pytest.warns(UserWarning, match=rf"made again, for this machine stalled: .*{stall.late_ms}"):
        assert unless_stalled(losing.run, losing.settle) == "found"
    assert (losing.runs, losing.settled) == (2, 1)


def test_a_run_that_is_well_needs_no_excuse(monkeypatch: pytest.MonkeyPatch) -> None:
    losing = Losing(monkeypatch, 0, LONG)
    assert unless_stalled(losing.run, losing.settle) == "found"
    assert (losing.runs, losing.settled) == (1, 0)


def test_a_run_that_is_lost_each_time_fails_and_so_does_one_that_fails_otherwise(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    losing = Losing(monkeypatch, TRIES, LONG)
    with pytest.warns(UserWarning, match="made again"), pytest.raises(AssertionError, match=f"in each of {TRIES} runs"):
        unless_stalled(losing.run)
    with pytest.raises(ZeroDivisionError):
        unless_stalled(lambda: 1 / 0)


@pytest.mark.realtime
def test_the_watch_tells_for_how_long_it_was_kept_from_running_and_ends_with_its_standard_input() -> None:
    command = [sys.executable, "-m", "tests.support.stall_watch"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT) as watch:
        assert watch.stdin is not None
        assert watch.stdout is not None
        assert watch.stdout.readline() == "watches\n"
        os.kill(watch.pid, signal.SIGSTOP)
        give_time(STOPPED_S)
        os.kill(watch.pid, signal.SIGCONT)
        watch.stdin.close()
        stalls = [Stall(*map(float, line.split())) for line in watch.stdout]
    assert watch.returncode == 0
    assert max(stalls).late_ms > 900.0 * STOPPED_S
    assert all(stall.ago_s <= RECENT_S for stall in stalls)


@pytest.mark.realtime
def test_what_a_watched_block_raises_is_raised_and_the_watch_ends() -> None:
    with pytest.raises(ZeroDivisionError), watch_for_stalls():
        1 / 0  # noqa: B018
