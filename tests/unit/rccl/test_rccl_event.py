"""Event counts as the papers describe them."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.rccl import Event, Position
from qrobot.rccl.event import Level


def test_a_signal_is_used_up_by_one_wait() -> None:
    event = Event("e")
    assert not event.take()
    event.signal()
    event.signal()
    assert [event.take(), event.take(), event.take()] == [True, True, False]


def test_a_level_stays_true_until_it_is_lowered() -> None:
    level = Level("completed", 1)
    assert level.take()
    assert level.take()
    level.count = 0
    assert not level.take()


def test_assigning_to_end_resets_the_count() -> None:
    p = Position("p", np.zeros(2))
    p.end.signal()
    p.end = 0
    assert (p.end.count, p.end.name) == (0, "p.end")


def test_a_position_keeps_its_own_copy_of_the_joints() -> None:
    q = np.zeros(2)
    p = Position("p", q)
    q[0] = 1.0
    assert p.q[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        p.q[0] = 1.0
