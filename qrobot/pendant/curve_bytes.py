"""Curves of joints as pages get them, and every cycle of a window as CSV."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Floats
from qrobot.log.windows import Curves
from qrobot.modecodes import mode_name
from qrobot.printable import csv_line

CSV_NAMES: Final = ("q_ref", "q", "v", "tau")  # of every joint


def curve_bytes(curves: Curves) -> bytes:
    """Instants as 64-bit floats; then smallest, largest and first values as 32-bit floats, instant by instant."""
    values = np.concatenate([curves.low, curves.high, curves.first]).astype("<f4")
    return curves.t_s.astype("<f8").tobytes() + values.tobytes()


def cycles_csv(joints: Sequence[str], t_s: Floats, values: Floats, modes: NDArray[Any], faults: NDArray[Any]) -> bytes:
    """Every number of m cycles: `values` has shape (m, 4n), in the order of CSV_NAMES, the others (m,). SI units."""
    lines = [csv_line(["t_s", *(f"{name}_{joint}" for name in CSV_NAMES for joint in joints), "mode", "fault"])]
    for instant, row, mode, fault in zip(t_s.tolist(), values.tolist(), modes.tolist(), faults.tolist(), strict=True):
        lines.append(",".join([repr(instant), *map(repr, row), mode_name(mode), str(fault)]))
    return ("\n".join(lines) + "\n").encode()
