"""The servo's law for six joints in one piece: PD, friction at the reference velocity, gravity of joints 2 and 3, clip.

Friction is either the smooth tanh of textbooks or the clipped line that the servo uses; `c/sixlaw.c` is the twin.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from qrobot.realtime.jit import kernel

N: Final = 6
KP, KV, COULOMB, VISCOUS, LIMIT = range(5)  # rows of the parameters, shape (5, 6)
G2, G23C, G23S = 37.2, 8.4, 1.02  # N m, gravity moments of the PUMA's upper arm and forearm (Armstrong et al. 1986)
SMOOTH: Final = 50.0
MOTION: Final = 1e-4  # rad by which the arm moves between calls


@kernel
def smooth_friction(v: float, coulomb: float) -> float:
    """Coulomb friction rounded off by a tanh."""
    return coulomb * math.tanh(SMOOTH * v)


@kernel
def clipped_friction(v: float, coulomb: float) -> float:
    """Coulomb friction rounded off by a straight line."""
    return coulomb * min(max(SMOOTH * v, -1.0), 1.0)


@kernel
def law_calls(p: Any, q: Any, v: Any, tau: Any, smooth: bool, n: int) -> float:
    """`n` calls with the arm moving on in between; the sum of all torques is the checksum."""
    total = 0.0
    for k in range(n):
        q[k % N] += MOTION
        forearm = G23C * math.cos(q[1] + q[2]) + G23S * math.sin(q[1] + q[2])
        for j in range(N):
            v_ref = v[j] + 0.01
            friction = smooth_friction(v_ref, p[COULOMB, j]) if smooth else clipped_friction(v_ref, p[COULOMB, j])
            gravity = (G2 * math.cos(q[1]) + forearm) if j == 1 else forearm if j == 2 else 0.0
            torque = p[KP, j] * 0.001 + p[KV, j] * 0.01 + p[VISCOUS, j] * v_ref + friction + gravity - 0.1 * q[j]
            tau[j] = min(max(torque, -p[LIMIT, j]), p[LIMIT, j])
            total += tau[j]
    return total


def arguments() -> tuple[Any, Any, Any, Any]:
    """Fresh parameters, positions, velocities and torques."""
    p = np.array([[2000.0] * N, [90.0] * N, [8.4, 12.7, 5.6, 1.3, 1.0, 1.2], [5.0] * N, [50.0] * N])
    return p, np.linspace(-0.5, 0.5, N), np.linspace(-0.02, 0.02, N), np.zeros(N)
