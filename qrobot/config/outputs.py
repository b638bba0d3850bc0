"""Outputs of an arm: what each is called, where it goes, and what becomes of it when the arm stops."""

from __future__ import annotations

from typing import Final, Literal

from pydantic import Field, model_validator

from qrobot.config.document import Table
from qrobot.config.values import MaybeGivenName

N_OUTPUTS: Final = 16  # as many as the wire's STATE has bits for
ALL_OUTPUTS: Final = (1 << N_OUTPUTS) - 1
N_ANALOG_OUTPUTS: Final = 8  # as many as the wire's ANALOG carries


class OutputLine(Table):
    """Line `output` of the arm, from 1: bit `output` - 1 of what a program says in `chg.outputs`.

    With `on_stop = "off"` it goes off whenever the arm stops otherwise than at the end of a motion, or nobody commands
    it, and comes on again only after its program has let go of it; with "hold" it stays as its program has left it.
    """

    output: int = Field(ge=1, le=N_OUTPUTS)
    name: MaybeGivenName = ""
    on_stop: Literal["off", "hold"] = "off"

    @property
    def label(self) -> str:
        """Name of the output for people."""
        return self.name or f"output_{self.output}"


class BoardOutput(OutputLine):
    """One of the board's own lines: bit 3, 4 or 5 of its DISCRETE register, 1 for on.

    A board that is reset shows a 0 there, so wire the line that 0 does no harm. Whether a bit has a driver, on which
    pin and of which polarity, is not published: measure it.
    """

    bit: int = Field(ge=3, le=5)


class AnalogOutputLine(Table):
    """Analogue output `output` of the arm, from 1, between `min_v` and `max_v`: other values are refused.

    With `on_stop = "off"` it goes to its off value whenever the arm stops otherwise than at the end of a motion, or
    nobody commands it; with "hold" it stays as its program has left it. Every one goes to its off value when arm power
    goes, when the board is lost and when the servo has died, and stays there until its program says another.
    """

    output: int = Field(ge=1, le=N_ANALOG_OUTPUTS)
    name: MaybeGivenName = ""
    min_v: float = Field(default=-10.0, ge=-10, le=10, allow_inf_nan=False)
    max_v: float = Field(default=10.0, ge=-10, le=10, allow_inf_nan=False)
    on_stop: Literal["off", "hold"] = "off"

    @model_validator(mode="after")
    def _can_be_off(self) -> AnalogOutputLine:
        if not self.min_v < self.max_v:
            raise ValueError(f"analogue output {self.output}: min_v {self.min_v:g} is not below max_v {self.max_v:g}")
        if not self.min_v <= self.off_volts <= self.max_v:
            raise ValueError(
                f"analogue output {self.output}: {self.off_volts:g} V, which it shows while it is off, is not within "
                f"{self.min_v:g} to {self.max_v:g} V"
            )
        return self

    @property
    def off_volts(self) -> float:
        """Volts while it is off."""
        return 0.0

    @property
    def label(self) -> str:
        """Name of the output for people."""
        return self.name or f"analog_output_{self.output}"


class BoardAnalogOutput(AnalogOutputLine):
    """A converter of the board that drives no motor: DAC `dac`, from 0. Its off value is 0 V.

    A board that is reset, and one that the guardian has taken, shows 0 V there. The first converters drive the motors,
    joint by joint: those of an arm with six joints leave 6 and 7.
    """

    dac: int = Field(ge=0, le=7)
