"""What `qrobot ctl status` says of hand, inputs and outputs."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from qrobot.cli.ctl import _lines_line


@pytest.mark.parametrize(
    ("inputs", "outputs", "line"),
    [
        ((2, 5), {"glue": False, "clamp": True}, "hand closed, inputs on: 2 5, glue off, clamp on"),
        ((), {}, "hand closed, inputs on: none"),
    ],
)
def test_the_status_names_what_is_on(inputs: tuple[int, ...], outputs: dict[str, bool], line: str) -> None:
    now: Any = SimpleNamespace(hand="closed", inputs=inputs, outputs=outputs)
    assert _lines_line(now) == line
