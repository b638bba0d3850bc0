"""Positions in cycles without a new image: a servo carries them on for its law, which is no measurement.

Few such cycles in a row lie between two samples a moment apart, and are interpolated; many are left out, for no command
reached the motors meanwhile either.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Bools, Floats
from qrobot.servo.memory.telemetry import Rows, sampled

LONGEST_S: Final = 0.01  # between two samples: 5 rad/s2 are off a straight line by 0.06 mrad, less than a count [A]


def measured_positions(rows: Rows) -> Floats:
    """Positions of rows, interpolated where no image showed them, rad (m). Shape (r, n)."""
    seen = sampled(rows)
    if seen.all() or not seen.any():
        return np.asarray(rows["q"])
    q, at, between = rows["q"].copy(), np.flatnonzero(seen), np.flatnonzero(~seen)
    for joint in q.T:
        joint[between] = np.interp(between, at, joint[at])
    return np.asarray(q)


def between_cycles(q: Floats) -> Floats:
    """Positions at which torques act, each from its own cycle's position to the next one's. Shape (r - 1, n)."""
    return np.asarray(0.5 * (q[1:] + q[:-1]))


def long_dropout(rows: Rows, period_s: float) -> Bools:
    """True in rows without an image that lie between samples more than LONGEST_S apart. Shape (r,)."""
    seen = sampled(rows)
    at = np.concatenate([[-np.inf], np.flatnonzero(seen), [np.inf]])
    apart = np.diff(at)[np.cumsum(seen)]  # from the sample at or before each row to the next one
    return np.asarray(~seen & (apart * period_s > LONGEST_S))
