"""Modbus modules beside an emulated board: they work its operator's panel as the wires of a real one would."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Final

from qrobot.hwif.board_memory import PANEL_MICRO, BoardMemory
from qrobot.hwif.modbus.io import RemoteModule
from qrobot.hwif.registers import DISCRETE
from qrobot.hwif.trace import load_head, read_trace

STEP_S: Final = 0.005
_OFFSET, _VALUE = 2, 3  # of a row of the trace


class PanelModules:
    """Carries what modules see to the panel of a board memory, and what its hand and its outputs do to the modules.

    An analogue input without a value reads 0 V: the emulated converter always converts.

    Args:
        memory: of an emulated board.
        modules: each with inputs of its own.
    """

    def __init__(self, memory: BoardMemory, modules: Sequence[RemoteModule]) -> None:
        self._memory, self._modules = memory, modules
        self._followed = 0

    def step(self, now_ns: int) -> None:
        """Pass on what is new at `now_ns`."""
        memory = self._memory
        for module in self._modules:
            module.switch(int(memory.panel.outputs))
            for k, microvolts in enumerate(memory.panel.analog_outputs.tolist()):
                said = int(memory.panel.analog_told) >> k & 1
                module.drive(k + 1, microvolts / PANEL_MICRO if said else None)
            show_inputs(memory, module.mask, module.bits(now_ns))
            for channel in module.channels:
                memory.panel.analog[channel] = round((module.maybe_volt(channel, now_ns) or 0.0) * PANEL_MICRO)
        memory.facts.module_losses = sum(module.losses for module in self._modules)
        self._follow_hand()

    def _follow_hand(self) -> None:
        """Tell the modules of the newest write to DISCRETE, if there is a new one."""
        head = int(load_head(self._memory))
        rows = read_trace(self._memory, self._followed)
        self._followed = head  # rows that came since are read again: the hand does not mind
        for value in rows[rows[:, _OFFSET] == DISCRETE][-1:, _VALUE]:
            for module in self._modules:
                module.command(int(value))

    def run(self, stop: threading.Event) -> None:
        """Step until `stop` is set."""
        while not stop.wait(STEP_S):
            self.step(time.monotonic_ns())


def show_inputs(memory: BoardMemory, mask: int, bits: int) -> None:
    """Write the inputs of `mask` where they differ: others force some of the same word, also between look and write."""
    shown = int(memory.panel.inputs)
    if shown & mask != bits:
        memory.panel.inputs = shown & ~mask | bits


@contextmanager
def panel_modules(memory: BoardMemory, modules: Sequence[RemoteModule]) -> Iterator[None]:
    """Let the modules work the panel while the block runs."""
    stop = threading.Event()
    work = [PanelModules(memory, modules).run, *(module.run for module in modules)]
    threads = [threading.Thread(target=each, args=(stop,), daemon=True) for each in work]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()
