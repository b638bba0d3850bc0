"""Lines to people that nobody waits for, whatever becomes of them."""

from __future__ import annotations

import errno
import logging
import threading
from dataclasses import dataclass, field

import pytest

from qrobot.report import KEPT_LINES, QueuedReport, ReportHandler
from tests.support.patience import PATIENCE_S, wait_until


@dataclass
class Terminal:
    """Takes lines while it is not held; may raise instead."""

    error: BaseException | None = None
    taken: list[str] = field(default_factory=list)
    asked: threading.Event = field(default_factory=threading.Event)
    free: threading.Event = field(default_factory=threading.Event)

    def __call__(self, line: str) -> None:
        self.asked.set()
        assert self.free.wait(PATIENCE_S)
        self.taken.append(line)
        if self.error is not None:
            raise self.error


@pytest.fixture(autouse=True)
def patient_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """The end waits for the last lines as long as this machine needs for them."""
    monkeypatch.setattr("qrobot.report.LAST_LINES_S", PATIENCE_S)


def test_lines_are_written_in_their_order_before_the_end() -> None:
    terminal = Terminal()
    terminal.free.set()
    with QueuedReport(terminal) as told:
        for number in range(100):
            told(str(number))
    assert terminal.taken == [str(number) for number in range(100)]


def test_a_terminal_that_is_held_makes_nobody_wait_and_has_its_lines_when_it_is_let_go() -> None:
    terminal = Terminal()
    with QueuedReport(terminal) as told:
        told("0")
        assert terminal.asked.wait(PATIENCE_S)  # this line is under way: no other one leaves the queue
        for number in range(1, 2 * KEPT_LINES):
            told(str(number))
        assert terminal.taken == []
        terminal.free.set()
        wait_until(lambda: len(terminal.taken) > KEPT_LINES, "the lines that were kept")
    assert terminal.taken == [str(number) for number in range(KEPT_LINES + 1)]


def test_a_flush_waits_for_what_was_told_and_once_for_a_terminal_that_is_held() -> None:
    terminal = Terminal()
    terminal.free.set()
    with QueuedReport(terminal) as told:
        for number in range(100):
            told(str(number))
        told.flush(PATIENCE_S)
        assert len(terminal.taken) == 100
        terminal.free.clear()
        told("held")
        told.flush(0.001)
        told.flush(threading.TIMEOUT_MAX)  # the wait before is still in vain
        assert len(terminal.taken) == 100
        terminal.free.set()
        wait_until(lambda: len(terminal.taken) == 101, "the line that was held")


def test_the_end_does_not_wait_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("qrobot.report.LAST_LINES_S", 0.01)
    terminal = Terminal()
    with QueuedReport(terminal) as told:
        told("never read")
    assert terminal.taken == []
    terminal.free.set()


def test_the_thread_gets_ready_itself_before_its_first_line() -> None:
    done: list[tuple[str, str]] = []

    def take(what: str) -> None:
        done.append((threading.current_thread().name, what))

    with QueuedReport(take, lambda: take("ready")) as told:
        told("one")
    assert done == [("report", "ready"), ("report", "one")]


@pytest.mark.parametrize(
    "error", [OSError(errno.ENOSPC, "No space left on device"), SystemExit(1), ZeroDivisionError()]
)
def test_a_line_that_cannot_be_written_is_lost_and_the_next_one_is_tried(error: BaseException) -> None:
    terminal = Terminal(error)
    terminal.free.set()
    with QueuedReport(terminal) as told:
        told("one")
        told("two")
    assert terminal.taken == ["one", "two"]


def test_what_a_process_logs_is_told_also_where_words_and_values_do_not_fit_together() -> None:
    told: list[str] = []
    log = logging.Logger("some library")
    log.addHandler(ReportHandler(told.append))
    log.info("%s has gone", "127.0.0.1:5")
    log.info("%d has gone", "no number")
    assert told == ["127.0.0.1:5 has gone", "%d has gone ('no number',)"]


class Wordless:
    """Has no words of its own, or none at all."""

    def __init__(self, told: str) -> None:
        self._told = told

    def __str__(self) -> str:
        raise RuntimeError("no words")

    def __repr__(self) -> str:
        if not self._told:
            raise AttributeError("no name")
        return self._told


def test_a_record_whose_words_cannot_be_had_is_told_by_its_place_and_raises_nothing() -> None:
    told: list[str] = []
    log = logging.Logger("some library")
    log.addHandler(ReportHandler(told.append))
    log.info("%s has gone", Wordless("a client"))
    log.info("%s has gone", Wordless(""))
    log.info(Wordless(""))
    assert told[0] == "%s has gone (a client,)"
    assert [line.partition(" ")[0] for line in told[1:]] == ["test_report.py:"] * 2
