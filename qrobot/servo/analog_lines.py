"""The analogue outputs of an arm as its servo has them: where each goes, its range, what becomes of it at a stop."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from qrobot.config.outputs import N_ANALOG_OUTPUTS
from qrobot.errors import ConfigError
from qrobot.hwif.registers import N_DACS


@dataclass(frozen=True)
class AnalogWire:
    """One analogue output.

    Attributes:
        output: its number, from 1.
        name: what people call it.
        least_v, most_v: its range.
        off_v: volts while it is off.
        holds: it stays as it is when the arm stops; otherwise it goes off.
        dac: converter of the board, from 0; None for an output of a module beside the board.
    """

    output: int
    name: str
    least_v: float = -10.0
    most_v: float = 10.0
    off_v: float = 0.0
    holds: bool = False
    dac: int | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.output <= N_ANALOG_OUTPUTS:
            raise ConfigError(f"analogue output {self.output}: there are 1 to {N_ANALOG_OUTPUTS}")
        if not -10.0 <= self.least_v <= self.off_v <= self.most_v <= 10.0:
            raise ConfigError(
                f"analogue output {self.output}: {self.off_v:g} V while it is off, {self.least_v:g} to {self.most_v:g} "
                "V else; needed is a range within 10 V with that value in it"
            )
        if self.dac is not None and self.off_v != 0.0:
            raise ConfigError(f"analogue output {self.output}: a converter of the board shows 0 V while it is off")

    @property
    def mask(self) -> int:
        """Its bit among the analogue outputs of the arm."""
        return 1 << (self.output - 1)


class AnalogParams(NamedTuple):
    """Parameters of the analogue outputs for the cycle. Bits of outputs: output 1 is bit 0."""

    lines: int  # those that there are
    holds: int  # those that stay as they are at a stop
    modules: int  # those of modules beside the board
    least: Any  # V. Shape (N_ANALOG_OUTPUTS,), as the next two
    most: Any
    off: Any
    at_dac: Any  # int64[N_DACS] place of the output at each converter of the board, -1 for none


def analog_params(wires: Sequence[AnalogWire], n: int) -> AnalogParams:
    """The numbers of these outputs of an arm with `n` joints. Raises ConfigError: a converter drives a motor."""
    least, most, off = (np.zeros(N_ANALOG_OUTPUTS) for _ in range(3))
    at_dac = np.full(N_DACS, -1, np.int64)
    for wire in wires:
        k = wire.output - 1
        least[k], most[k], off[k] = wire.least_v, wire.most_v, wire.off_v
        if wire.dac is not None:
            if wire.dac not in range(n, N_DACS):
                free = f"free are {n} to {N_DACS - 1}" if n < N_DACS else "none is free"
                raise ConfigError(f"analogue output {wire.output}: DAC {wire.dac} drives a motor of the arm; {free}")
            at_dac[wire.dac] = k
    return AnalogParams(
        lines=sum(wire.mask for wire in wires),
        holds=sum(wire.mask for wire in wires if wire.holds),
        modules=sum(wire.mask for wire in wires if wire.dac is None),
        least=least,
        most=most,
        off=off,
        at_dac=at_dac,
    )
