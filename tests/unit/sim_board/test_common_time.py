"""Emulated arms beside each other let the same time pass: who has let pass less stands still for most of the time."""

from __future__ import annotations

from pathlib import Path

import pytest

from qrobot.hwif.board_memory import create_board_memory
from qrobot.realtime.shared_memory import segment_path
from qrobot.sim_board.common_time import held_ns, slipped_beside_ns

pytestmark = pytest.mark.usefixtures("runtime_folder")
MS = 1_000_000
PERIOD_NS = 250_000
NOW_NS = 1_000_000 * MS


def test_an_arm_that_has_let_pass_less_goes_on_slowly_until_it_is_in_step() -> None:
    slipped, beside, periods = 20 * MS, 50 * MS, 0
    while slipped < beside:
        held = held_ns(slipped, beside, PERIOD_NS)
        assert 0 < held < PERIOD_NS
        slipped, periods = slipped + held, periods + 1
    assert slipped == beside
    assert 30 * MS <= periods * PERIOD_NS <= 1.5 * 30 * MS


def test_an_arm_that_is_in_step_or_behind_waits_for_nobody() -> None:
    assert held_ns(20 * MS, 20 * MS, PERIOD_NS) == 0
    assert held_ns(20 * MS, 0, PERIOD_NS) == 0


def test_the_living_board_that_has_let_pass_most_is_followed() -> None:
    assert slipped_beside_ns(["right", "third"], NOW_NS) == 0
    with create_board_memory("right") as right, create_board_memory("third") as third:
        right.memory.facts.slipped_ns, third.memory.facts.slipped_ns = 5 * MS, 3 * MS
        assert slipped_beside_ns(["right", "third"], NOW_NS) == 5 * MS
        assert slipped_beside_ns(["third"], NOW_NS) == 3 * MS
        assert slipped_beside_ns([], NOW_NS) == 0
    assert slipped_beside_ns(["right", "third"], NOW_NS) == 0


def test_a_killed_board_and_a_damaged_time_are_passed_over() -> None:
    killed = create_board_memory("right")
    killed.memory.facts.slipped_ns = 5 * MS
    with create_board_memory("third") as third:
        for damaged in (-1, NOW_NS, 1 << 62):
            third.memory.facts.slipped_ns = damaged
            assert slipped_beside_ns(["right", "third"], NOW_NS) == 5 * MS
        killed.close()  # its file stays
        assert segment_path("right-board").exists()
        assert slipped_beside_ns(["right", "third"], NOW_NS) == 0


def test_what_is_no_board_is_passed_over(runtime_folder: Path) -> None:
    (runtime_folder / "torn-board").write_bytes(b"")
    assert slipped_beside_ns(["torn"], NOW_NS) == 0
