"""A process that is started with others waits, ready, until its turn has come."""

from __future__ import annotations

import os

import pytest

from qrobot.errors import LinkLost
from qrobot.realtime.startup_order import TURN_VARIABLE, await_turn, turn_is_awaited


@pytest.fixture
def turn(monkeypatch: pytest.MonkeyPatch) -> int:
    """The supervisor's end of the pipe this process is told to wait at."""
    awaited, turn = os.pipe()
    monkeypatch.setenv(TURN_VARIABLE, str(awaited))
    return turn


def test_a_process_started_alone_begins_at_once() -> None:
    assert not turn_is_awaited()
    await_turn()


def test_a_process_begins_when_it_is_told_to_and_waits_once_only(turn: int) -> None:
    assert turn_is_awaited()
    os.write(turn, b"!")
    await_turn()
    assert not turn_is_awaited()
    await_turn()
    os.close(turn)


def test_a_process_whose_supervisor_has_ended_does_not_begin(turn: int) -> None:
    os.close(turn)
    with pytest.raises(LinkLost, match="ended before it could begin"):
        await_turn()
    assert not turn_is_awaited()
