"""Gains that an operator asks for, row by row, within reason."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.config.robot import Control
from qrobot.errors import ConfigError
from qrobot.servo.laws.law import KP, KV, M0
from qrobot.servo.operator.messages import ChangeGains

MOST_GAIN: Final = 4.0  # times the robot file's, without force
LEAST_GAIN: Final = {KP: 0.0, KV: 0.25, M0: 0.0}  # the same: a soft arm is wanted at times, an undamped one never

Matrix = NDArray[np.float64]


def changed_gains(control: Control, gains: Matrix, request: ChangeGains) -> Matrix:
    """`gains` (3, n) with the rows that are asked for. Raises ConfigError for those far from the robot file's."""
    rows = ((KP, "kp", request.kp, control.kp), (KV, "kv", request.kv, control.kv))
    for row, name, wanted, usual in (*rows, (M0, "inertia", request.inertia, control.inertia)):
        if wanted is not None:
            least, most = (0.0, math.inf) if request.force else (LEAST_GAIN[row], MOST_GAIN)
            gains[row] = _checked(name, wanted, usual, least, most)
    return gains


def _checked(name: str, wanted: tuple[float, ...], usual: Any, least: float, most: float) -> Matrix:
    if len(wanted) != usual.size:
        raise ConfigError(f"{name}: {len(wanted)} numbers for {usual.size} joints")
    for j, (value, file) in enumerate(zip(wanted, usual.tolist(), strict=True)):
        if not least * file <= value <= most * file:
            beyond = f"more than {most:g}" if value > most * file else f"less than {least:g}"
            raise ConfigError(
                f"{name} of joint {j + 1}: {value:g} is {beyond} times the robot file's {file:g}; if meant, force it"
            )
    return np.array(wanted)
