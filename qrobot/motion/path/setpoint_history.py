"""The newest few samples of something, and the velocity and acceleration they tell."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.realtime.jit import lean_kernel

DEPTH: Final = 3  # samples of a parabola

History = Sequence[tuple[float, Floats]]  # by number of the sample, or by path time


class SetpointHistory:
    """The newest joint setpoints, oldest first, with the samples they belong to."""

    def __init__(self, tick: int, q: Floats) -> None:
        self._points: deque[tuple[int, Floats]] = deque([(tick, np.array(q))], maxlen=DEPTH)

    def append(self, tick: int, q: Floats) -> None:
        """The setpoint of sample `tick`."""
        self._points.append((tick, np.array(q)))

    def copy(self) -> SetpointHistory:
        """Another with the same setpoints."""
        twin = SetpointHistory(*self._points[0])
        twin._points.extend(list(self._points)[1:])
        return twin

    @property
    def newest(self) -> Floats:
        """The newest setpoint. Shape (n,)."""
        return self._points[-1][1]

    @property
    def points(self) -> History:
        """All of them."""
        return list(self._points)

    def with_now(self, tick: int, q: Floats) -> list[tuple[float, Floats]]:
        """The samples, as if `q` were that of `tick` already."""
        earlier: list[tuple[float, Floats]] = [point for point in self._points if point[0] < tick]
        return [*earlier, (tick, q)][-DEPTH:]

    def state(self, period_s: float) -> Floats:
        """Position, velocity and acceleration at the newest sample. Shape (3, n)."""
        return motion_of(self.points, period_s)


def true_joints(q: Floats, standing: Floats | None) -> Floats:
    """`q` (n,), but `standing` (n,) where that is a number."""
    return q if standing is None else np.where(np.isnan(standing), q, standing)


def motion_of(points: History, period_s: float) -> Floats:
    """Value, first and second derivative at the newest of one to three samples, of the parabola through them.

    Shape (3, m), per second. With two samples the second derivative is 0, with one both are: what was asked for only
    once is taken to stand still.
    """
    rows, near_s, far_s = rows_of(points, period_s)
    state = np.empty_like(rows)
    motion_at_end(rows, near_s, far_s, state)
    return state


def rows_of(points: History, period_s: float) -> tuple[Floats, float, float]:
    """One to three samples for kernels: newest first, shape (3, m), and the times between them.

    What there is not repeats the oldest, after no time.
    """
    (tick, now), (middle, before), (last, earlier) = points[-1], points[-min(2, len(points))], points[-len(points)]
    return np.array((now, before, earlier)), (tick - middle) * period_s, (middle - last) * period_s


Spacing = tuple[float, float, float, float]  # near_s, and the inverse of near_s, of far_s and of both; 0 for no time


@lean_kernel
def spacing(near_s: float, far_s: float) -> Spacing:
    """The times between three samples for `parabola`, which so divides by none of them."""
    per_near = 1.0 / near_s if near_s > 0.0 else 0.0
    if far_s > 0.0:
        return near_s, per_near, 1.0 / far_s, 1.0 / (near_s + far_s)
    return near_s, per_near, 0.0, 0.0


@lean_kernel
def parabola(now: float, before: float, earlier: float, between: Spacing) -> tuple[float, float]:
    """First and second derivative at the end of three samples; 0 where there is no time between them."""
    near_s, per_near, per_far, per_both = between
    slope = (now - before) * per_near
    bend = 2.0 * (slope - (before - earlier) * per_far) * per_both
    return slope + 0.5 * near_s * bend, bend


@lean_kernel
def motion_at_end(rows: Floats, near_s: float, far_s: float, state: Floats) -> None:
    """Fill `state` (3, m: value and its derivatives at the newest sample) from what `rows_of` gives."""
    between = spacing(near_s, far_s)
    for j in range(rows.shape[1]):
        state[0, j] = rows[0, j]
        state[1, j], state[2, j] = parabola(rows[0, j], rows[1, j], rows[2, j], between)
