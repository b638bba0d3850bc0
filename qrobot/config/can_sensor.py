"""A force and torque sensor, or any other, that sends its values on CAN, in a deployment file."""

from __future__ import annotations

from typing import Final

from pydantic import Field, model_validator

from qrobot.config.document import Table
from qrobot.config.values import Scale

LAST_BASE_ID: Final = 0x7FF  # of 11 bits


class CanSignal(Table):
    """One value of a sensor: where it is in which frame, and the converter channel on which the servo reads it.

    The value begins at byte `first` of frame `id` and has `size` bytes. An `id` beyond 0x7FF is one of 29 bits. The
    servo sees value x `volt_per_count` - `zero_v`, within 10 V.
    """

    channel: int = Field(ge=0, le=7)
    id: int = Field(ge=1, le=0x1FFFFFFF)
    first: int = Field(default=0, ge=0, le=7)
    size: int = Field(default=2, ge=1, le=4)
    signed: bool = True
    big_endian: bool = False
    volt_per_count: Scale
    zero_v: float = Field(default=0.0, allow_inf_nan=False)

    @property
    def is_extended(self) -> bool:
        """The identifier has 29 bits, not 11."""
        return self.id > LAST_BASE_ID

    @model_validator(mode="after")
    def _is_within_a_frame(self) -> CanSignal:
        if self.first + self.size > 8:
            raise ValueError(f"bytes {self.first} to {self.first + self.size - 1}: a frame has bytes 0 to 7")
        return self


class CanSensor(Table):
    """A sensor on CAN beside a board that is behind a gateway. Values older than `timeout_ms` are no values."""

    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: int = Field(default=1_000_000, ge=10_000, le=1_000_000)
    timeout_ms: float = Field(default=50.0, gt=0, le=1000, allow_inf_nan=False)
    signals: tuple[CanSignal, ...] = Field(min_length=1, strict=False)

    @model_validator(mode="after")
    def _has_a_channel_for_each(self) -> CanSensor:
        if len({signal.channel for signal in self.signals}) < len(self.signals):
            raise ValueError("two signals of the sensor have the same channel")
        return self
