"""Calibration of a wrist's force sensor in a deployment file: volts to force and torque."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from qrobot.config.document import Table
from qrobot.config.scene import FORCE_AXES, ConverterChannel, ForceSensor

Coefficient = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
Volts = Annotated[float, Field(ge=-10, le=10, allow_inf_nan=False)]
MatrixRow = Annotated[tuple[Coefficient, ...], Field(strict=False)]


class ForceCalibration(Table):
    """Force and torque of the tool on a wrist sensor, from the channels of the board's converter that carry it.

    `matrix` has a row for each of fx, fy, fz (N/V) and tx, ty, tz (N m/V), in the frame of the sensor, and a column for
    each of `channels`; it stands on the sensor's calibration sheet. `bias_v` are the volts of these channels without a
    load, all zero when it is left out. A component whose row is all zeros is not measured. The servo samples these
    channels all the time. An emulated arm's sensor is known by its own numbers when nothing stands here.
    """

    channels: tuple[ConverterChannel, ...] = Field(min_length=1, strict=False)
    matrix: tuple[MatrixRow, MatrixRow, MatrixRow, MatrixRow, MatrixRow, MatrixRow] = Field(strict=False)
    bias_v: tuple[Volts, ...] = Field(default=(), strict=False)

    @model_validator(mode="after")
    def _has_a_column_for_each(self) -> ForceCalibration:
        k = len(self.channels)
        if len(set(self.channels)) < k:
            raise ValueError("channels: the same channel twice")
        for axis, row in zip(FORCE_AXES, self.matrix, strict=True):
            if len(row) != k:
                raise ValueError(f"matrix: {len(row)} numbers for {axis}, but {k} channels")
        if len(self.bias_v) not in (0, k):
            raise ValueError(f"bias_v: {len(self.bias_v)} numbers, but {k} channels")
        return self


def calibration_of_emulated(sensor: ForceSensor) -> ForceCalibration:
    """The calibration sheet of an emulated sensor."""
    channels = tuple(sensor.channels.values())

    def row(axis: str) -> tuple[float, ...]:
        per_volt = sensor.newton_per_volt if axis.startswith("f") else sensor.newton_metre_per_volt
        return tuple(per_volt if name == axis else 0.0 for name in sensor.channels)

    fx, fy, fz, tx, ty, tz = (row(axis) for axis in FORCE_AXES)
    return ForceCalibration(channels=channels, matrix=(fx, fy, fz, tx, ty, tz), bias_v=(sensor.zero_v,) * len(channels))
