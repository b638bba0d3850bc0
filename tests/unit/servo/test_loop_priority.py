"""A loop that runs no cycle has no real-time priority, until it runs cycles again."""

from __future__ import annotations

import os

import pytest

from qrobot.servo.process.loop_priority import LOOK_NS, PATIENCE_NS, TAKEN_WEIGHT, LoopPriority
from qrobot.units import NS_PER_S

THREAD = 4711
FIFO = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
ORDINARY = os.SCHED_OTHER | os.SCHED_RESET_ON_FORK


class FakeScheduler:
    """The system's, of one thread."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, policy: int, priority: int) -> None:
        self.now, self.refuses = (policy, priority), False
        monkeypatch.setattr(os, "sched_getscheduler", lambda thread: self.now[0] if thread == THREAD else 0)
        monkeypatch.setattr(os, "sched_getparam", lambda _thread: os.sched_param(self.now[1]))
        monkeypatch.setattr(os, "sched_setscheduler", self._set)

    def _set(self, thread: int, policy: int, param: os.sched_param) -> None:
        assert thread == THREAD
        if self.refuses:
            raise PermissionError(1, "Operation not permitted")
        self.now = policy, param.sched_priority


LOOK_EVERY_NS = 50_000_000
PATIENT_LOOKS = PATIENCE_NS // LOOK_EVERY_NS


class Looks:
    """Looks at a loop, 50 ms apart where no time is given."""

    def __init__(self, said: list[str]) -> None:
        self._priority, self._now_ns = LoopPriority(THREAD, said.append), 10**12

    def look(self, beat: int, times: int = 1, every_ns: int = LOOK_EVERY_NS, taken: bool = False) -> None:
        for _ in range(times):
            self._now_ns += every_ns
            self._priority.look(beat, self._now_ns, taken)


def test_a_loop_that_hangs_is_an_ordinary_thread_until_it_runs_cycles_again(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    scheduler, priority = FakeScheduler(monkeypatch, FIFO, 80), Looks(said)
    for beat in range(5 * PATIENT_LOOKS):
        priority.look(beat)
    priority.look(1000, PATIENT_LOOKS)
    assert (scheduler.now, said) == ((FIFO, 80), [])
    priority.look(1000)
    assert scheduler.now == (ORDINARY, 0)
    priority.look(1000, 5 * PATIENT_LOOKS)
    assert len(said) == 1
    priority.look(1001)
    assert scheduler.now == (FIFO, 80)
    assert "runs again, at its real-time priority" in said[1]
    priority.look(1001, PATIENT_LOOKS)
    assert scheduler.now == (ORDINARY, 0)


def test_once_the_guardian_has_the_board_a_tenth_of_the_patience_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    scheduler, looks = FakeScheduler(monkeypatch, FIFO, 80), Looks(said)
    looks.look(1, taken=True)
    looks.look(1, PATIENT_LOOKS // TAKEN_WEIGHT - 1, taken=True)
    assert scheduler.now == (FIFO, 80)
    looks.look(1, taken=True)
    assert scheduler.now == (ORDINARY, 0)
    looks.look(2, taken=True)
    assert scheduler.now == (FIFO, 80)


def test_with_one_processor_two_looks_of_the_twentieth_that_is_left_to_others_are_enough(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    said: list[str] = []
    scheduler, looks = FakeScheduler(monkeypatch, FIFO, 80), Looks(said)
    looks.look(1)
    looks.look(1, 2, every_ns=NS_PER_S)
    assert scheduler.now == (ORDINARY, 0)


def test_a_process_that_was_stopped_as_a_whole_keeps_its_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    scheduler, looks = FakeScheduler(monkeypatch, FIFO, 80), Looks(said)
    for beat in range(5):
        looks.look(beat)
        looks.look(beat, every_ns=60 * NS_PER_S, taken=beat % 2 == 0)
        looks.look(beat, LOOK_NS // LOOK_EVERY_NS - 1)
    assert (scheduler.now, said) == ((FIFO, 80), [])


def test_a_priority_that_cannot_be_given_back_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    scheduler, priority = FakeScheduler(monkeypatch, FIFO, 80), Looks(said)
    priority.look(1, PATIENT_LOOKS + 1)
    scheduler.refuses = True
    priority.look(2)
    assert "without a real-time priority" in said[-1]
    assert "start the servo anew" in said[-1]


def test_an_ordinary_thread_stays_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    scheduler, priority = FakeScheduler(monkeypatch, os.SCHED_OTHER, 0), Looks(said)
    priority.look(1, 5 * PATIENT_LOOKS)
    assert (scheduler.now, said) == ((os.SCHED_OTHER, 0), [])
