"""A held button that dies of silence and stays dead; and the lease of the page that drives."""

from __future__ import annotations

import pytest

from qrobot.errors import RemoteProtocolError
from qrobot.pendant.held_press import BEAT_S, PATIENCE_S, HeldPress, Press
from qrobot.pendant.lease import ANSWER_S, SILENCE_S, DriverLease
from qrobot.pendant.messages import decode_message

FIRST, SECOND = Press(1, "joint", "1"), Press(2, "axis", "dx", -1.0)


def test_a_press_lasts_while_it_is_told_of() -> None:
    held = HeldPress()
    assert held.held(0.0) is None
    assert held.begin(FIRST, 0.0)
    for k in range(1, 40):
        held.beat(1, k * BEAT_S)
        assert held.held(k * BEAT_S) is FIRST
    held.end()
    assert held.held(40 * BEAT_S) is None


@pytest.mark.parametrize("looked_at", [False, True])
def test_a_press_that_fell_silent_is_dead_whatever_is_told_of_it_later(looked_at: bool) -> None:
    """Whether the arm's thread looked meanwhile or all came at once after a stall."""
    held, late = HeldPress(), PATIENCE_S + 0.01
    held.begin(FIRST, 0.0)
    if looked_at:
        assert held.held(PATIENCE_S) is FIRST
        assert held.held(late) is None
    for k in range(20):
        held.beat(1, late + k * BEAT_S)
        assert held.held(late + k * BEAT_S) is None
    assert not held.begin(FIRST, 2.0)  # the same number again is no new press
    assert held.held(2.0) is None
    assert held.begin(SECOND, 3.0)
    assert held.held(3.0) is SECOND


def test_beats_of_another_press_keep_none_alive_and_a_new_press_ends_the_old_one() -> None:
    held = HeldPress()
    held.begin(FIRST, 0.0)
    held.begin(SECOND, 0.1)
    held.beat(1, 0.3)
    assert held.held(0.1 + PATIENCE_S + 0.01) is None
    assert not held.begin(FIRST, 0.5)


def test_an_instant_in_the_future_holds_nothing() -> None:
    held = HeldPress()
    held.begin(FIRST, 5.0)
    assert held.held(4.9) is None


def test_what_is_done_moves_nothing_any_more_and_leaves_a_newer_press_alone() -> None:
    held = HeldPress()
    held.begin(FIRST, 0.0)
    held.end_of(SECOND)
    assert held.held(0.0) is FIRST
    held.end_of(FIRST)
    held.beat(1, 0.01)
    assert held.held(0.01) is None


def test_one_page_drives_until_it_gives_up_or_sleeps() -> None:
    lease = DriverLease()
    assert lease.take(1, 0.0)
    assert not lease.take(2, 1.0)
    assert not lease.give(2)
    lease.hear(2, 4.0)  # somebody else's words
    lease.hear(1, 1.0)
    assert not lease.expire(1.0 + SILENCE_S)
    assert lease.expire(1.1 + SILENCE_S)
    assert lease.take(2, 7.0)
    assert lease.holder == 2
    assert lease.give(2)
    assert lease.holder is None


def test_a_page_that_asks_gets_the_lease_when_it_is_given_up_or_nobody_answers_and_not_when_it_is_kept() -> None:
    lease = DriverLease()
    lease.take(1, 0.0)
    assert not lease.take(2, 1.0)
    assert not lease.take(3, 2.0)  # the first that asks is asked for
    assert lease.asker == 2
    assert lease.keep(3) is None
    assert [lease.keep(1), lease.asker, lease.holder] == [2, None, 1]
    lease.take(2, 3.0)
    assert lease.give(1)
    assert [lease.holder, lease.asker] == [2, None]
    lease.take(3, 4.0)
    lease.give(3)  # it has gone
    assert lease.asker is None
    for second in range(5, 5 + int(ANSWER_S)):
        lease.hear(2, float(second))
        lease.take(1, float(second))  # whoever asks again waits no longer
        assert not lease.expire(float(second))
    lease.hear(2, 5.1 + ANSWER_S)
    assert lease.expire(5.1 + ANSWER_S)
    assert lease.holder == 1


@pytest.mark.parametrize(
    "text",
    [
        "", "[]", "null", '{"do": "fly"}', '{"do": "press", "arm": 0}', '{"do": "act", "arm": 0, "name": "format"}',
        '{"do": "press", "arm": 0, "number": 1, "target": "joint", "name": "1", "way": 2}',
        '{"do": "press", "arm": 0, "number": 1, "target": "joint", "name": "1", "share": 1e9}',
        '{"do": "press", "arm": 0, "number": 1, "target": "joint", "name": "1", "share": NaN}',
        '{"do": "beat", "arm": -1, "number": 1}', '{"do": "stop", "arm": 0}', "x" * 5000,
    ],
)  # fmt: skip
def test_what_is_no_message_of_a_page_is_refused(text: str) -> None:
    with pytest.raises(RemoteProtocolError, match="message of a page"):
        decode_message(text)
