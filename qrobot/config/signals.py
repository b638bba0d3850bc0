"""Names by which programs read and switch the lines and analogue channels of an arm."""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Final

from pydantic import Field, model_validator

from qrobot.config.document import Table
from qrobot.config.outputs import N_ANALOG_OUTPUTS, N_OUTPUTS
from qrobot.config.values import GivenName, Scale

N_BOARD_INPUTS: Final = 6  # discrete inputs of the board, 0 to 5
N_CHANNELS: Final = 8  # of its converter
_KINDS: Final = ("inputs", "outputs", "analog", "analog_output")
_Input = Annotated[int, Field(ge=0, lt=N_BOARD_INPUTS)]
_Output = Annotated[int, Field(ge=1, le=N_OUTPUTS)]


def no_output(what: str, outputs: Collection[int]) -> str:
    """Reason against an output, `what` by name, that is not among those of the deployment file."""
    there = ", ".join(map(str, sorted(outputs))) or "none"
    return (
        f"{what} is not configured; the deployment file has {there}: add it to [[arm.board.outputs]], or to a module's"
    )


class NamedSignal(Table):
    """A name for lines that belong together, for a channel of the board's converter, or for an analogue output.

    `inputs` and `outputs` are the first line and the last one, numbered as those of the board and of modules are; the
    first is bit 0 of the value. `analog` is a channel that the servo samples (`servo.sensor_channels`): its value is
    (volts - `zero_v`) x `per_volt`, in `unit`. `analog_output` is an analogue output, from 1, likewise.
    """

    name: GivenName
    inputs: tuple[_Input, _Input] | None = Field(default=None, strict=False)
    outputs: tuple[_Output, _Output] | None = Field(default=None, strict=False)
    analog: int | None = Field(default=None, ge=0, lt=N_CHANNELS)
    analog_output: int | None = Field(default=None, ge=1, le=N_ANALOG_OUTPUTS)
    per_volt: Scale = 1.0
    zero_v: float = Field(default=0.0, ge=-10, le=10, allow_inf_nan=False)
    unit: str = Field(default="V", min_length=1, max_length=16)

    @model_validator(mode="after")
    def _names_one_thing(self) -> NamedSignal:
        given = [kind for kind in _KINDS if getattr(self, kind) is not None]
        if len(given) != 1:
            raise ValueError(f"signal {self.name!r}: one of {', '.join(_KINDS)} is needed, not {len(given)}")
        for lines in (self.inputs, self.outputs):
            if lines is not None and lines[0] > lines[1]:
                raise ValueError(f"signal {self.name!r}: the first line comes first, as in [{lines[1]}, {lines[0]}]")
        binary = self.analog is None and self.analog_output is None
        if binary and {"per_volt", "zero_v", "unit"} & self.model_fields_set:
            raise ValueError(f"signal {self.name!r}: lines are numbers; per_volt, zero_v and unit are for analog")
        return self
