"""The outputs of an arm as its servo has them: which lines there are, and what becomes of each when the arm stops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from qrobot.config.outputs import N_OUTPUTS
from qrobot.errors import ConfigError
from qrobot.hwif.registers import DISCRETE_LINES

OUTPUT_PATIENCE_NS: Final = 300_000_000  # three of the longest sample periods


@dataclass(frozen=True)
class OutputWire:
    """One line.

    Attributes:
        output: its number, from 1.
        name: what people call it.
        holds: it stays as it is when the arm stops; otherwise it goes off.
        bit: of the board's DISCRETE register; None for a line of a module beside the board.
    """

    output: int
    name: str
    holds: bool = False
    bit: int | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.output <= N_OUTPUTS:
            raise ConfigError(f"output {self.output}: there are 1 to {N_OUTPUTS}")
        if self.bit is not None and not 1 << max(self.bit, 0) & DISCRETE_LINES:
            raise ConfigError(f"output {self.output}: bit {self.bit} of DISCRETE is no line's, take 3, 4 or 5")

    @property
    def mask(self) -> int:
        """Its bit of the outputs of the arm."""
        return 1 << (self.output - 1)


class OutputParams(NamedTuple):
    """Parameters of output lines for the cycle. Bits of lines: output 1 is bit 0."""

    lines: int  # those that there are
    off: int  # those that go off at a stop
    discrete: Any  # int64[N_OUTPUTS] mask in DISCRETE of each line that is the board's own, 0 for the others
    off_discrete: int  # those that go off at a stop, in DISCRETE
    patience_ns: int  # a commander that says nothing for so long has gone


def output_params(wires: Sequence[OutputWire]) -> OutputParams:
    """The numbers of these lines."""
    discrete = np.zeros(N_OUTPUTS, np.int64)
    for wire in wires:
        if wire.bit is not None:
            discrete[wire.output - 1] = 1 << wire.bit
    return OutputParams(
        lines=sum(wire.mask for wire in wires),
        off=sum(wire.mask for wire in wires if not wire.holds),
        discrete=discrete,
        off_discrete=sum(1 << wire.bit for wire in wires if wire.bit is not None and not wire.holds),
        patience_ns=OUTPUT_PATIENCE_NS,
    )
