"""The key of a terminal as a dead man's switch, by the times at which characters come."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from qrobot.rccl.held_key import FIRST_MS, REPEAT_MS, SILENCE_MS, HeldKey


def test_one_stroke_is_pressed_and_holds_nothing() -> None:
    key = HeldKey()
    assert key.hear(".", 0.0) == ""
    assert key.hear("", FIRST_MS) == ""
    assert key.pressed == ["."]


def test_a_key_is_held_from_its_first_repeat_until_its_repeats_stay_away() -> None:
    key = HeldKey()
    key.hear(".", 0.0)
    assert key.hear(".", 500.0) == "."
    assert key.hear(".", 500.0 + REPEAT_MS) == "."
    assert key.hear("", 500.0 + 2 * REPEAT_MS) == "."
    assert key.hear("", 500.1 + 2 * REPEAT_MS) == ""


def test_repeats_that_come_late_start_nothing_again() -> None:
    key = HeldKey()
    key.hear(".", 0.0)
    assert key.hear(".", 300.0) == "."
    t = 300.0 + REPEAT_MS + 1.0
    for _ in range(20):
        assert key.hear(".", t) == ""
        t += SILENCE_MS
    t += 1.0
    assert key.hear(".", t) == ""  # pressed anew, after silence
    assert key.hear(".", t + 100.0) == "."


def test_another_key_lets_go() -> None:
    key = HeldKey()
    key.hear(".", 0.0)
    assert key.hear(".", 300.0) == "."
    assert key.hear(".x", 330.0) == ""
    assert key.hear(".", 360.0) == ""
    assert key.pressed == ["."]  # what lets go is no command


def test_a_pasted_row_of_characters_holds_nothing() -> None:
    key = HeldKey()
    assert key.hear("." * 50, 0.0) == ""
    assert key.hear("", 10.0) == ""


@given(st.lists(st.tuples(st.floats(0.0, 400.0), st.sampled_from(["", ".", ",", "x", "..", ".,"])), max_size=40))
def test_whatever_is_typed_no_key_is_held_that_was_not_typed_just_before(typed: list[tuple[float, str]]) -> None:
    key, now, last = HeldKey(), 0.0, {}
    for wait, characters in typed:
        now += wait
        held = key.hear(characters, now)
        last |= dict.fromkeys(characters, now)
        if held:
            assert now - last[held] <= REPEAT_MS
