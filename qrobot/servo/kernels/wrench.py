"""Force and torque of the tool on the wrist's sensor, from the volts at the board's converter.

    wrench[i] = sum over channels c of  matrix[i, c] (volts[c] - zero[c])

`zero` is what the channels show without a load: the calibration's bias, until somebody zeroes the sensor
(`servo.operator.force_zero`).

NaN is what is not known: a component that is not wired, and every one that needs a channel without a value - not
sampled yet, given up by the converter, no longer heard of on CAN - or a board that is gone. A sensor on CAN or on a
Modbus module is a channel like any other here.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from qrobot.config.force_calibration import ForceCalibration
from qrobot.hwif.registers import N_ADCS
from qrobot.realtime.jit import lean_kernel

N_COMPONENTS: Final = 6  # fx fy fz tx ty tz


class WrenchParams(NamedTuple):
    """A force sensor's calibration for the kernels; all zeros without a sensor."""

    matrix: Any  # (6, 8) N/V and N m/V
    bias: Any  # (8,) V without a load, by the calibration


def wrench_params(calibration: ForceCalibration | None) -> WrenchParams:
    """Spread the columns of a calibration over the converter's channels."""
    matrix, bias = np.zeros((N_COMPONENTS, N_ADCS)), np.zeros(N_ADCS)
    if calibration is not None:
        channels = list(calibration.channels)
        matrix[:, channels] = calibration.matrix
        bias[channels] = calibration.bias_v or 0.0
    return WrenchParams(matrix, bias)


@lean_kernel
def measure_wrench(matrix: Any, zero: Any, volts: Any, done: Any, seen: bool, wrench: Any) -> None:
    """Fill `wrench`, N and N m, shape (6,).

    Args:
        matrix: of `WrenchParams`. zero, volts: without a load and now, shape (8,). done: conversions of each channel
        so far, int64[8]. seen: the board's image is whole.
    """
    for i in range(N_COMPONENTS):
        total, wired = 0.0, False
        for c in range(N_ADCS):
            gain = matrix[i, c]
            if gain != 0.0:
                wired = True
                total += gain * (volts[c] - zero[c]) if done[c] > 0 else math.nan
        wrench[i] = total if wired and seen else math.nan
