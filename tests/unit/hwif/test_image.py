"""The inputs of an image by name: they stand where the register table says."""

from __future__ import annotations

import pytest

from qrobot.hwif import image
from qrobot.hwif.image import IMAGE_INPUTS, IMAGE_WORDS, input_at, make_image
from qrobot.hwif.registers import REGISTERS, Access

READABLE = [row for row in REGISTERS if row.access is Access.READ]


@pytest.mark.parametrize("row", READABLE, ids=lambda row: row.name)
def test_every_register_that_is_only_read_has_its_name(row: object) -> None:
    offsets = row.offsets  # type: ignore[attr-defined]
    first = vars(image)[f"IMAGE_{row.name}"]  # type: ignore[attr-defined]
    assert [first + k for k in range(len(offsets))] == [input_at(offset) for offset in offsets]


def test_inputs_fill_the_image_behind_time_and_count() -> None:
    assert [input_at(offset) for offset in range(0, 0x20, 2)] == list(range(IMAGE_INPUTS, IMAGE_WORDS))
    assert make_image().size == IMAGE_WORDS
