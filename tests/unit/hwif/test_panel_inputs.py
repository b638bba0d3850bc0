"""Inputs of modules beside an emulated board share a word of its panel with those that somebody forces."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from qrobot.hwif.board_memory import local_board_memory
from qrobot.hwif.modbus.panel import show_inputs


class ForcedPanel:
    """The panel of a board; as soon as somebody has looked at its inputs, another one forces input 1."""

    def __init__(self, panel: Any) -> None:
        self._panel = panel

    def __getattr__(self, name: str) -> Any:
        return getattr(self._panel, name)

    @property
    def inputs(self) -> int:
        seen = int(self._panel.inputs)
        self._panel.inputs = seen | 0b00010
        return seen

    @inputs.setter
    def inputs(self, levels: int) -> None:
        self._panel.inputs = levels


@pytest.mark.parametrize("bits", [0b00100, 0b00000])
def test_a_module_without_news_loses_no_input_that_somebody_forces_meanwhile(bits: int) -> None:
    memory, mask = local_board_memory(), 0b00100
    show_inputs(memory, mask, bits)
    assert memory.panel.inputs == bits
    forced: Any = SimpleNamespace(panel=ForcedPanel(memory.panel))
    show_inputs(forced, mask, bits)
    assert memory.panel.inputs == 0b00010 | bits
