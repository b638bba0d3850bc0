"""Arguments of calls: numbers, functions, names of directions and periods, each refused with the name of its call."""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.errors import MotionError
from qrobot.model.transform import so3_exp, transform
from qrobot.motion import ForceLimits
from qrobot.rci.arguments import numbers
from qrobot.rci.link import sample_period_us as period_us
from qrobot.units import M_PER_MM, RAD_PER_DEG, S_PER_MS

DIRECTIONS: Final = ("dx", "dy", "dz", "rx", "ry", "rz")
FORCES: Final = ("fx", "fy", "fz", "mx", "my", "mz")


def milliseconds(ta: float, ts: float) -> tuple[float, float]:
    """Times of a motion in seconds. Raises MotionError: the segment takes no time, or the transition less than none."""
    ta, ts = numbers("setime", ta, ts)
    if ta < 0.0 or ts <= 0.0:
        raise MotionError(f"setime({ta:g}, {ts:g}): the transition may take 0 ms, the motion more than that")
    return ta * S_PER_MS, ts * S_PER_MS


def sample_period_us(call: str, ms: float) -> int:
    """A sample period, microseconds. Raises MotionError when the bridge has no such period."""
    (period_ms,) = numbers(call, ms)
    return period_us(call, period_ms)


def require_function(call: str, given: object) -> None:
    """Raises MotionError when an argument that has to be called later on cannot be called."""
    if not callable(given):
        raise MotionError(f"{call}: a function is needed, not {given!r}")


def named_values(call: str, spec: str, values: tuple[float, ...], allowed: tuple[str, ...]) -> dict[int, float]:
    """Values by the place of their names in `allowed`.

    Raises:
        MotionError: an unknown name, one twice, none, or not one finite value for each.
    """
    names = spec.split() if isinstance(spec, str) else []
    if not names or len(names) != len(values) or not set(names) <= set(allowed) or len(set(names)) != len(names):
        raise MotionError(
            f"{call}({spec!r}, ...): name directions out of {' '.join(allowed)!r}, each once, one value each"
        )
    return {allowed.index(name): value for name, value in zip(names, numbers(call, *values), strict=True)}


def force_limits(spec: str, values: tuple[float, ...]) -> ForceLimits:
    """The limits of `limit`: N, N m, mm and degrees.

    Raises:
        MotionError: an unknown direction, not one value for each, or one that is not positive.
    """
    bounds = np.full(len(FORCES + DIRECTIONS), np.inf)
    for place, value in named_values("limit", spec, values, FORCES + DIRECTIONS).items():
        bounds[place] = value
    force, shift, turn = bounds[:6], bounds[6:9] * M_PER_MM, bounds[9:] * RAD_PER_DEG
    return ForceLimits(force, np.concatenate((shift, turn)))


def small_move(spec: str, values: tuple[float, ...]) -> Floats:
    """The transform of `distance`: named directions of the controlled frame, mm and degrees. Shape (4, 4).

    Raises:
        MotionError: an unknown direction, or not one value for each.
    """
    parts = np.zeros(6)
    for direction, value in named_values("distance", spec, values, DIRECTIONS).items():
        parts[direction] = value
    return transform(so3_exp(parts[3:] * RAD_PER_DEG), parts[:3] * M_PER_MM)
