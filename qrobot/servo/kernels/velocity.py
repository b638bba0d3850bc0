"""Velocity from encoder positions: two estimators.

The difference is the paper's: backward difference and first-order low pass (QRobot paper, section 6). The observer lets
a model of each joint run beside the arm, pushed by the torque that was really given, and corrects it by what the
encoder shows. Its three gains put all poles at exp(-w dt): the critically damped g-h-k filter, which is at the same
time the fading-memory fit of a parabola (Brookner, "Tracking and Kalman Filtering Made Easy", 1998, section 1.4):

    predict   v += (push + d) dt        x += v dt + (push + d) dt^2 / 2
    correct   x += (1 - z^3) r          v += 3/2 (1 - z)^2 (1 + z) r / dt        d += (1 - z)^3 r / dt^2

with r = q - x, z = exp(-w dt) and d the acceleration that the torque does not explain: coupling, load, wrong friction.
The time between samples is the true one, so both estimators live with stalls and skipped cycles.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, Final

from qrobot.errors import ConfigError
from qrobot.realtime.jit import lean_kernel


class Estimator(IntEnum):
    """Estimators of velocity."""

    DIFFERENCE = 0
    OBSERVER = 1


ESTIMATORS: Final = {kind.name.lower(): kind for kind in Estimator}
DEFAULT_ESTIMATOR: Final = Estimator.DIFFERENCE.name.lower()
REST: Final = 1e-12  # SI units: less is rest, for what decays for ever ends in denormal numbers [A]
STALE: Final = 1.0  # memories 1/w old: after a longer gap the observer begins anew instead of believing its prediction


def find_estimator(name: str) -> Estimator:
    """The estimator called `name`. Raises ConfigError naming those there are."""
    try:
        return ESTIMATORS[name]
    except KeyError:
        raise ConfigError(f"no velocity estimator {name!r}; there are: {', '.join(ESTIMATORS)}") from None


@lean_kernel
def at_rest(decaying: float) -> float:
    """Return the value, or zero when it is below `REST`: denormal numbers are slow to compute with and hard to read."""
    return 0.0 if abs(decaying) < REST else decaying


@lean_kernel
def difference(q: Any, q_before: Any, dt: float, bandwidth: float, v: Any) -> None:
    """Backward difference through a first-order low pass of `bandwidth` rad/s, into `v`. Shapes (n,).

    `dt`, in seconds, lies between the positions `q_before` and `q`.
    """
    share = 1.0 - math.exp(-bandwidth * dt)
    for j in range(q.size):
        v[j] = at_rest(v[j] + share * ((q[j] - q_before[j]) / dt - v[j]))


@lean_kernel
def start_observer(q: Any, x: Any, v: Any, d: Any) -> None:
    """Begin at rest at position `q`, with no disturbance. Shapes (n,)."""
    for j in range(q.size):
        x[j], v[j], d[j] = q[j], 0.0, 0.0


@lean_kernel
def observe(q: Any, q_before: Any, push: Any, dt: float, bandwidth: float, x: Any, v: Any, d: Any) -> None:
    """One step of the observer. Shapes (n,).

    Args:
        q, q_before: measured positions now and `dt` seconds ago, rad or m.
        push: acceleration of the torque given in between, by the model, rad/s^2 or m/s^2.
        bandwidth: w, rad/s.
        x, v, d: position, velocity and unmodelled acceleration, carried on to now.
    """
    if bandwidth * dt > STALE:
        for j in range(q.size):
            x[j], v[j], d[j] = q[j], (q[j] - q_before[j]) / dt, 0.0
        return
    z = math.exp(-bandwidth * dt)
    to_x, to_v, to_d = 1.0 - z * z * z, 1.5 * (1.0 - z) * (1.0 - z) * (1.0 + z) / dt, ((1.0 - z) / dt) ** 2 * (1.0 - z)
    for j in range(q.size):
        a = push[j] + d[j]
        residual = q[j] - (x[j] + dt * (v[j] + 0.5 * dt * a))
        x[j] = q[j] - (1.0 - to_x) * residual
        v[j] = at_rest(v[j] + dt * a + to_v * residual)
        d[j] = at_rest(d[j] + to_d * residual)
