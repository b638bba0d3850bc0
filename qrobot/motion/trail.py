"""The newest few samples of something, and the velocity and acceleration they tell."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from qrobot.motion.limits import Floats

DEPTH: Final = 3  # samples of a parabola

Samples = Sequence[tuple[int, Floats]]


class Trail:
    """The newest joint setpoints, oldest first, with the samples they belong to."""

    def __init__(self, tick: int, q: Floats) -> None:
        self._points: deque[tuple[int, Floats]] = deque([(tick, np.array(q))], maxlen=DEPTH)

    def append(self, tick: int, q: Floats) -> None:
        """The setpoint of sample `tick`."""
        self._points.append((tick, np.array(q)))

    def copy(self) -> Trail:
        """Another with the same setpoints."""
        twin = Trail(*self._points[0])
        twin._points.extend(list(self._points)[1:])
        return twin

    @property
    def newest(self) -> Floats:
        """The newest setpoint. Shape (n,)."""
        return self._points[-1][1]

    def with_now(self, tick: int, q: Floats) -> list[tuple[int, Floats]]:
        """The samples, as if `q` were that of `tick` already."""
        earlier = [point for point in self._points if point[0] < tick]
        return [*earlier, (tick, q)][-DEPTH:]

    def state(self, period_s: float) -> Floats:
        """Position, velocity and acceleration at the newest sample. Shape (3, n)."""
        return motion_of(list(self._points), period_s)


def true_joints(q: Floats, standing: Floats | None) -> Floats:
    """`q` (n,), but `standing` (n,) where that is a number."""
    return q if standing is None else np.where(np.isnan(standing), q, standing)


def motion_of(points: Samples, period_s: float) -> Floats:
    """Value, first and second derivative at the newest of one to three samples, of the parabola through them.

    Shape (3, m), per second. With two samples the second derivative is 0, with one both are: what was asked for only
    once is taken to stand still.
    """
    tick, value = points[-1]
    state = np.zeros((3, value.size))
    state[0] = value
    if len(points) == 1:
        return state
    near_s = (tick - points[-2][0]) * period_s
    slope = (value - points[-2][1]) / near_s
    if len(points) == 2:
        state[1] = slope
        return state
    far_s = (points[-2][0] - points[-3][0]) * period_s
    bend = 2.0 * (slope - (points[-2][1] - points[-3][1]) / far_s) / (near_s + far_s)
    state[1], state[2] = slope + 0.5 * near_s * bend, bend
    return state
