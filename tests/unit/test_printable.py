"""Text from elsewhere: what a terminal would obey is replaced, everything else stays."""

from __future__ import annotations

import unicodedata

from hypothesis import given
from hypothesis import strategies as st

from qrobot.printable import printable


@given(st.text())
def test_no_control_character_is_left_and_the_rest_is_as_it_was(text: str) -> None:
    clean = printable(text)
    assert len(clean) == len(text)
    assert not any(unicodedata.category(c) in ("Cc", "Zl", "Zp") for c in clean)
    assert not any(unicodedata.bidirectional(c) in ("LRE", "RLE", "PDF", "LRO", "RLO", "LRI", "RLI") for c in clean)
    assert all(b in (a, "?") for a, b in zip(text, clean, strict=True))


def test_a_sequence_that_clears_the_screen_becomes_plain_text_and_names_stay() -> None:
    assert printable("a\x1b[2J\r\nb\x9b1m") == "a?[2J??b?1m"
    assert printable("Bestückung №7 — ελ 机器人") == "Bestückung №7 — ελ 机器人"
