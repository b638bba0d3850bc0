"""Turns of the tests on the wall clock (tests/support/turns.py)."""

from __future__ import annotations

import fcntl
from pathlib import Path

import pytest

from tests.support import turns


def is_free(alone: bool) -> bool:
    """Whether a test of another row could have its turn now."""
    with turns.LOCK.open("a") as file:
        try:
            fcntl.flock(file, (fcntl.LOCK_EX if alone else fcntl.LOCK_SH) | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
    return True


def test_tests_run_beside_each_other_and_one_that_starves_others_by_itself(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(turns, "LOCK", tmp_path / "cache" / "live tests")
    with turns.turn(alone=False):
        assert (is_free(alone=False), is_free(alone=True)) == (True, False)
    with turns.turn(alone=True):
        assert (is_free(alone=False), is_free(alone=True)) == (False, False)
    assert is_free(alone=True)
