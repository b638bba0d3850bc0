"""Benchmarks of running processes, as short as can be: that they see what they are there for."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.busy import busy
from benchmarks.guardian import reactions
from tests.support.processes import GUARDIAN_MS, write_deployment

pytestmark = pytest.mark.realtime

SECONDS = 2.0


@pytest.mark.thorough
def test_how_soon_an_arm_whose_servo_was_killed_is_safe_is_told_by_the_boards_stamps(tmp_path: Path) -> None:
    found = reactions(write_deployment(tmp_path), tmp_path / "processes", 1)
    assert found.bound_ms == GUARDIAN_MS
    (safe_ms,) = found.safe_ms
    assert safe_ms > GUARDIAN_MS  # not before it may
    assert found.late == (safe_ms > 2.0 * GUARDIAN_MS)


@pytest.mark.thorough
def test_an_arm_swings_for_as_long_as_is_asked_for(tmp_path: Path) -> None:
    found = busy(write_deployment(tmp_path), tmp_path / "processes", SECONDS, loops=0)
    assert (found.loops, found.events) == (0, [])
    assert found.seconds >= SECONDS
    assert found.largest_error > 0.0
