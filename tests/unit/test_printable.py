"""Text from elsewhere: what a terminal would obey is replaced, everything else stays."""

from __future__ import annotations

import csv
import unicodedata

from hypothesis import given
from hypothesis import strategies as st

from qrobot.printable import csv_line, printable


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


@given(st.lists(st.text(st.characters(exclude_categories=("Cc", "Zl", "Zp", "Cs"))), min_size=1))
def test_a_line_of_csv_has_the_cells_that_went_in(cells: list[str]) -> None:
    line = csv_line(cells)
    assert next(csv.reader([line])) == cells
    assert line == ",".join(cells) or set(line) & {",", '"'} or cells == [""]
