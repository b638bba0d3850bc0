"""The clock of an arm: it slips with an emulated board that was kept from running, and with no other."""

from __future__ import annotations

import threading
import time

import pytest

from qrobot.config import load_robot
from qrobot.config.deployment import TRANSPORTS, BoardChoice
from qrobot.hwif import arm_clock
from qrobot.hwif.arm_clock import MAY_SLIP_NS, STALL_NS, arm_time_ns, await_board, may_slip_ns, slipped_ns
from qrobot.hwif.board_memory import local_board_memory
from qrobot.hwif.lanes import post_operations
from qrobot.servo.parameters import servo_parameters
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.server import LIVED_NS, slip_line, unlived_ns
from tests.support.bus import rows_of
from tests.support.patience import wait_until

MS = 1_000_000
BOARD_PERIOD_NS = 250_000


def test_only_an_emulated_boards_word_moves_the_clock() -> None:
    """On a real board the word is not read, whatever it holds: a late servo is told of every nanosecond."""
    memory = local_board_memory()
    memory.facts.slipped_ns = 500 * MS
    assert slipped_ns(memory, 1) == 500 * MS
    assert slipped_ns(memory, 0) == 0
    memory.facts.slipped_ns = -1
    assert slipped_ns(memory, 1) == 0


@pytest.mark.realtime
def test_the_arms_time_is_the_monotonic_clock_less_what_slipped() -> None:
    memory = local_board_memory()
    memory.facts.slipped_ns = 500 * MS
    before = time.monotonic_ns()
    now = arm_time_ns(memory, 1)
    assert before <= now + 500 * MS <= time.monotonic_ns()


@pytest.mark.parametrize("stopped_at", range(3))
def test_who_is_stopped_with_its_board_as_it_reads_the_arms_time_reads_none_that_is_long_past(
    stopped_at: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, slipped, readings = 5_000 * MS, 0, 0

    def read(which: str) -> int:
        """Read one of the two; a stall follows before who reads goes on."""
        nonlocal now, slipped, readings
        value = now if which == "clock" else slipped
        if readings == stopped_at:
            now, slipped = now + 300 * MS, slipped + 300 * MS
        readings += 1
        return value

    monkeypatch.setattr(arm_clock, "monotonic_ns", lambda: read("clock"))
    monkeypatch.setattr(arm_clock, "slipped_ns", lambda _board, _slips: read("board"))
    assert getattr(arm_time_ns, "py_func", arm_time_ns)(None, 1) == 5_000 * MS


def test_slip_and_time_of_a_servo_that_need_not_wait_are_of_one_look(monkeypatch: pytest.MonkeyPatch) -> None:
    """Were the clock read again, a stall in between would be taken for time of the arm's."""
    readings = iter([5_000 * MS, 5_300 * MS])
    monkeypatch.setattr(arm_clock, "monotonic_ns", lambda: next(readings))
    monkeypatch.setattr(arm_clock, "slipped_ns", lambda *_: 1_000 * MS)
    look = getattr(await_board, "py_func", await_board)
    assert look(None, 1, 4_000 * MS - STALL_NS) == (1_000 * MS, 4_000 * MS)


@pytest.mark.realtime
def test_a_servo_that_overslept_with_its_board_waits_until_the_board_says_for_how_long() -> None:
    memory = local_board_memory()
    stalled_ns = 300 * MS
    due_ns = time.monotonic_ns() - stalled_ns
    memory.facts.now_ns = due_ns

    def wake_up() -> None:
        memory.facts.slipped_ns = stalled_ns
        memory.facts.now_ns = time.monotonic_ns()  # the board runs on from here, ahead of the arm's time at worst

    board = threading.Timer(0.02, wake_up)
    board.start()
    wait_until(lambda: await_board(memory, 1, due_ns)[0] == stalled_ns, "the board has said so")  # it waits for 50 ms
    board.join()


@pytest.mark.realtime
def test_nobody_waits_for_a_real_board_nor_for_one_that_runs_nor_for_ever() -> None:
    memory = local_board_memory()
    due_ns = time.monotonic_ns() - 300 * MS
    memory.facts.now_ns = due_ns
    assert await_board(memory, 0, due_ns)[0] == 0
    memory.facts.now_ns = time.monotonic_ns() + 10_000 * MS
    assert await_board(memory, 1, due_ns)[0] == 0
    memory.facts.now_ns = due_ns
    assert await_board(memory, 1, due_ns)[0] == 0


def test_of_a_stall_counts_what_somebody_wrote_in() -> None:
    """Nobody wrote: all but a cycle slips. The servo wrote to the end: nothing does. It stopped half-way: the rest."""
    memory, due = local_board_memory(), 1_000 * MS
    assert unlived_ns(memory, due, due + STALL_NS) == 0
    assert unlived_ns(memory, due, due + 50 * MS) == 50 * MS - LIVED_NS
    post_operations(memory, 0, rows_of([(1, 0x30, 0x800)]), 1, due + 20 * MS)
    assert unlived_ns(memory, due, due + 50 * MS) == 30 * MS - LIVED_NS
    post_operations(memory, 0, rows_of([(1, 0x30, 0x800)]), 1, due + 50 * MS)
    assert unlived_ns(memory, due, due + 50 * MS) == 0


def test_what_may_still_slip_is_what_the_board_will_find_that_nobody_wrote_in() -> None:
    """Whenever its board wakes up, an arm's time less what may slip is the time that will count, but for a cycle."""
    memory, due, after = local_board_memory(), 1_000 * MS, BOARD_PERIOD_NS
    memory.facts.now_ns = due - after
    for wrote_ms in (0, 20, 45):
        if wrote_ms:
            post_operations(memory, 0, rows_of([(1, 0x30, 0x800)]), 1, due + wrote_ms * MS)
        for slept_ms in (50, 200, 900):
            may_slip = may_slip_ns(memory, 1, due + slept_ms * MS)
            assert 0 <= may_slip - unlived_ns(memory, due, due + slept_ms * MS) <= LIVED_NS + after


def test_nothing_may_slip_beside_a_board_that_runs_or_is_real_nor_more_than_a_dead_one_is_given() -> None:
    memory, sampled = local_board_memory(), 1_000 * MS
    memory.facts.now_ns = sampled
    assert may_slip_ns(memory, 1, sampled + STALL_NS) == 0
    assert may_slip_ns(memory, 1, sampled - 50 * MS) == 0
    assert may_slip_ns(memory, 0, sampled + 200 * MS) == 0
    assert may_slip_ns(memory, 1, sampled + 200 * MS) == 200 * MS
    assert may_slip_ns(memory, 1, sampled + 9 * MAY_SLIP_NS) == MAY_SLIP_NS
    post_operations(memory, 0, rows_of([(1, 0x30, 0x800)]), 1, 1 << 62)
    assert may_slip_ns(memory, 1, sampled + 200 * MS) == 0  # a damaged time gives a dead servo no time


def test_a_damaged_time_of_a_post_neither_stops_time_nor_turns_it_back() -> None:
    memory, due = local_board_memory(), 1_000 * MS
    post_operations(memory, 0, rows_of([(1, 0x30, 0x800)]), 1, 1 << 62)
    assert unlived_ns(memory, due, due + 50 * MS) == 0
    post_operations(memory, 0, rows_of([(1, 0x30, 0x800)]), 1, -(1 << 62))
    assert 0 < unlived_ns(memory, due, due + 50 * MS) < 50 * MS


def test_people_are_told_how_long_time_stood_still() -> None:
    assert slip_line(23 * MS, 1200 * MS).endswith("stood still for 23 ms, 1200 ms in all")


@pytest.mark.parametrize("kind", TRANSPORTS)
def test_no_real_board_lets_time_stand_still(kind: str) -> None:
    assert not BoardChoice.model_construct(kind=kind, time_slip=True).slips
    assert servo_parameters(load_robot("puma560"), ServoSettings()).board_slips == 0


def test_an_emulated_board_does_unless_the_file_says_no() -> None:
    assert BoardChoice().slips
    assert not BoardChoice(time_slip=False).slips
