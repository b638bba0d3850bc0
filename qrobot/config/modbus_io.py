"""Modbus modules beside a board: remote inputs, discrete and analogue, outputs, and a gripper."""

from __future__ import annotations

from typing import Annotated, Final, Literal

from pydantic import Field, model_validator

from qrobot.config.document import Table
from qrobot.config.outputs import AnalogOutputLine, OutputLine
from qrobot.config.values import Scale

LARGEST_NUMBER: Final = 32767  # of a signed register
PERIODS_TO_BELIEVE: Final = 2  # [A] an answer counts until the next one is there, which takes a period and its own time
RegisterWords = Annotated[tuple[Annotated[int, Field(ge=0, le=65535)], ...], Field(min_length=1, max_length=16)]


class RemoteInput(Table):
    """A discrete input of the module that stands for one of the board's: STATUS bit `input`.

    While the module is silent it reads as `safe`.
    """

    address: int = Field(ge=0, le=65535)
    input: int = Field(ge=1, le=5)
    safe: bool = False


class RemoteAnalog(Table):
    """An analogue input of the module that stands for a channel of the board's converter: a signed input register.

    The servo sees its number x `volt_per_count` - `zero_v`, within 10 V. While the module is silent it has no value.
    """

    address: int = Field(ge=0, le=65535)
    channel: int = Field(ge=0, le=7)
    volt_per_count: Scale
    zero_v: float = Field(default=0.0, allow_inf_nan=False)


class RemoteOutput(OutputLine):
    """An output of the module: the coil or holding register at `address` gets `on` or `off`."""

    address: int = Field(ge=0, le=65535)
    kind: Literal["coil", "register"] = "coil"
    on: int = Field(default=1, ge=0, le=65535)
    off: int = Field(default=0, ge=0, le=65535)

    @model_validator(mode="after")
    def _can_be_told_apart(self) -> RemoteOutput:
        if self.on == self.off:
            raise ValueError(f"an output that is {self.on} both on and off does nothing")
        if self.kind == "coil" and max(self.on, self.off) > 1:
            raise ValueError('a coil is 0 or 1; kind = "register" takes other numbers')
        return self


class RemoteAnalogOutput(AnalogOutputLine):
    """An analogue output of the module: the holding register at `address` gets a signed number.

    That is (volts + `zero_v`) / `volt_per_count`, rounded. While it is off, and until somebody says what it is to be,
    it shows `off_v`.
    """

    address: int = Field(ge=0, le=65535)
    volt_per_count: Scale
    zero_v: float = Field(default=0.0, allow_inf_nan=False)
    off_v: float = Field(default=0.0, allow_inf_nan=False)

    @property
    def off_volts(self) -> float:
        """See `AnalogOutputLine`."""
        return self.off_v

    @model_validator(mode="after")
    def _fits_a_register(self) -> RemoteAnalogOutput:
        for volts in (self.min_v, self.max_v):
            if not abs(number := (volts + self.zero_v) / self.volt_per_count) <= LARGEST_NUMBER:
                raise ValueError(
                    f"analogue output {self.output}: {volts:g} V would be {number:g} in its register, which takes "
                    f"{-LARGEST_NUMBER} to {LARGEST_NUMBER}"
                )
        return self

    def number(self, volts: float) -> int:
        """The signed number of the register; that of `off_v` for what is not within the range."""
        shown = volts if self.min_v <= volts <= self.max_v else self.off_v
        return round((shown + self.zero_v) / self.volt_per_count)


class RemoteGripper(Table):
    """A gripper that follows the hand of the arm: registers from `address` on get the words of what the hand does."""

    address: int = Field(ge=0, le=65535)
    open: RegisterWords = Field(strict=False)
    close: RegisterWords = Field(strict=False)
    relax: RegisterWords | None = Field(default=None, strict=False)

    @property
    def registers(self) -> range:
        """Addresses that any of its words goes to."""
        return range(self.address, self.address + max(map(len, (self.open, self.close, self.relax or ()))))


class ModbusIo(Table):
    """A Modbus TCP module beside an emulated board or one behind a gateway, asked every `period_ms` at its own pace.

    What is older than `timeout_ms` is not believed: inputs then read as `safe`, and analogue ones have no value.
    It is two periods at least, for a value is to count until the next one is there.
    """

    host: str
    port: int = Field(default=502, ge=1, le=65535)
    device_id: int = Field(default=1, ge=0, le=255)
    period_ms: float = Field(default=20.0, ge=1, le=1000, allow_inf_nan=False)
    timeout_ms: float = Field(default=100.0, ge=1, le=10_000, allow_inf_nan=False)
    inputs: tuple[RemoteInput, ...] = Field(default=(), strict=False)
    analog: tuple[RemoteAnalog, ...] = Field(default=(), strict=False)
    outputs: tuple[RemoteOutput, ...] = Field(default=(), strict=False)
    analog_outputs: tuple[RemoteAnalogOutput, ...] = Field(default=(), strict=False)
    gripper: RemoteGripper | None = None

    @model_validator(mode="after")
    def _does_something(self) -> ModbusIo:
        lines = (*self.inputs, *self.analog, *self.outputs, *self.analog_outputs)
        if not lines and self.gripper is None:
            raise ValueError("a module without inputs, outputs and a gripper does nothing")
        return self

    @model_validator(mode="after")
    def _is_asked_before_it_is_too_old(self) -> ModbusIo:
        least = PERIODS_TO_BELIEVE * self.period_ms
        if (self.inputs or self.analog) and self.timeout_ms < least:
            raise ValueError(
                f"timeout_ms {self.timeout_ms:g} is too short for inputs asked for every {self.period_ms:g} ms: "
                f"at least {least:g}, or they have no value in between"
            )
        return self

    @model_validator(mode="after")
    def _outputs_have_places_of_their_own(self) -> ModbusIo:
        taken: set[tuple[str, int]] = set()
        if self.gripper is not None:
            taken |= {("register", each) for each in self.gripper.registers}
        for each in self.outputs:
            if (each.kind, each.address) in taken:
                raise ValueError(f"output {each.output}: {each.kind} {each.address} has another use already")
            taken.add((each.kind, each.address))
        for analog in self.analog_outputs:
            if ("register", analog.address) in taken:
                raise ValueError(f"analogue output {analog.output}: register {analog.address} has another use already")
            taken.add(("register", analog.address))
        return self

    @property
    def written_places(self) -> frozenset[str]:
        """Coils and registers that it writes: no other module, and no other arm, can have them."""
        taken: list[tuple[str, int]] = [(each.kind, each.address) for each in self.outputs]
        taken += [("register", each.address) for each in self.analog_outputs]
        taken += [("register", each) for each in self.gripper.registers] if self.gripper else []
        host = "127.0.0.1" if self.host == "localhost" else self.host.lower()
        return frozenset(f"{kind} {at} of device {self.device_id} at {host}:{self.port}" for kind, at in taken)
