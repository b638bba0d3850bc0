"""The QRobot paper's Table 2: a nonlinear law for two links with flexible joints, here in scalars.

The paper times 10^6 iterations of a controller of that kind, converters stubbed out: 17 s on a Pentium Pro at 200 MHz,
548 s on a TMS320C30. Its program is not printed; this one does all that such a law does: four encoders, a desired
trajectory A sin(w t) (1 - exp(-0.3 t^3)) with four analytic derivatives, backward differences with a low pass,
model-based second and third derivatives, feedback linearisation of fourth order (Spong 1987), Stribeck and Coulomb
friction compensation, adaptation of a payload, saturation. Only orders of magnitude compare with 1997.

    M(q) q'' + h(q, q') = K (theta - q)            J theta'' + friction + K (theta - q) = tau

The same functions run compiled and as plain Python; `c/twolink.c` is their twin, `twolink_numpy` the matrix form.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from qrobot.realtime.jit import kernel

DT: Final = 0.001
COUNTS: Final = 10_000.0  # encoder counts per rad
AMPLITUDE: Final = (0.8, 0.6)
OMEGA: Final = (1.0, 1.5)
A0, B0, C0 = 1.2, 0.35, 0.4  # inertia of the links, kg m2
G1, G12 = 12.0, 4.0  # gravity moments, N m
L1, L2, GRAVITY = 0.5, 0.4, 9.81
STIFFNESS, ROTOR = 400.0, 0.2
GAINS: Final = (160_000.0, 32_000.0, 2_400.0, 80.0)  # (s + 20)^4
COULOMB, STICTION, VISCOUS, STRIBECK = 0.6, 0.9, 0.3, 0.1
TAU_MAX, ADAPTATION, LAMBDA, SMOOTH = 60.0, 0.05, 5.0, 50.0
LOW_PASS: Final = 0.25
STATE_WORDS: Final = 9  # last readings (4), filtered velocities (4), payload

Quad = tuple[float, float, float, float]
Five = tuple[float, float, float, float, float]


@kernel
def trajectory(t: float, a: float, w: float) -> Five:
    """Position and four derivatives of a sin(w t) (1 - exp(-0.3 t^3))."""
    s, c, e = math.sin(w * t), math.cos(w * t), math.exp(-0.3 * t * t * t)
    p, p1, p2 = 0.9 * t * t, 1.8 * t, 1.8
    e0, e1, e2 = 1.0 - e, p * e, (p1 - p * p) * e
    e3 = (p2 - 3.0 * p * p1 + p * p * p) * e
    e4 = (-3.0 * p1 * p1 - 4.0 * p * p2 + 6.0 * p * p * p1 - p * p * p * p) * e
    s1, s2, s3, s4 = w * c, -w * w * s, -w * w * w * c, w * w * w * w * s
    return (
        a * s * e0,
        a * (s1 * e0 + s * e1),
        a * (s2 * e0 + 2.0 * s1 * e1 + s * e2),
        a * (s3 * e0 + 3.0 * s2 * e1 + 3.0 * s1 * e2 + s * e3),
        a * (s4 * e0 + 4.0 * s3 * e1 + 6.0 * s2 * e2 + 4.0 * s1 * e3 + s * e4),
    )


@kernel
def velocity(state: Any, k: int, reading: float) -> float:
    """Backward difference of reading k, low-passed."""
    state[4 + k] += LOW_PASS * ((reading - state[k]) / DT - state[4 + k])
    state[k] = reading
    return float(state[4 + k])


@kernel
def bias(q: Quad, b: float, g1: float, g12: float) -> tuple[float, float]:
    """h(q, q') of (q1, q2, q1', q2')."""
    q1, q2, v1, v2 = q
    s2 = math.sin(q2)
    gravity = g12 * math.cos(q1 + q2)
    return -b * s2 * (2.0 * v1 * v2 + v2 * v2) + g1 * math.cos(q1) + gravity, b * s2 * v1 * v1 + gravity


@kernel
def bias_rate(q: Quad, a: tuple[float, float], b: float, g1: float, g12: float) -> tuple[float, float]:
    """dh/dt with accelerations `a`."""
    q1, q2, v1, v2 = q
    s2, c2 = math.sin(q2), math.cos(q2)
    p, p1 = 2.0 * v1 * v2 + v2 * v2, 2.0 * (a[0] * v2 + v1 * a[1] + v2 * a[1])
    gravity = -g12 * math.sin(q1 + q2) * (v1 + v2)
    first = -b * (c2 * v2 * p + s2 * p1) - g1 * math.sin(q1) * v1 + gravity
    return first, b * (c2 * v2 * v1 * v1 + 2.0 * s2 * v1 * a[0]) + gravity


@kernel
def bias_curvature(
    q: Quad, a: tuple[float, float], j: tuple[float, float], b: float, g1: float, g12: float
) -> tuple[float, float]:
    """d2h/dt2 with accelerations `a` and jerks `j`."""
    q1, q2, v1, v2 = q
    s2, c2, w = math.sin(q2), math.cos(q2), v1 + v2
    p, p1 = 2.0 * v1 * v2 + v2 * v2, 2.0 * (a[0] * v2 + v1 * a[1] + v2 * a[1])
    p2 = 2.0 * (j[0] * v2 + 2.0 * a[0] * a[1] + v1 * j[1] + a[1] * a[1] + v2 * j[1])
    turn = c2 * a[1] - s2 * v2 * v2
    gravity = -g12 * (math.cos(q1 + q2) * w * w + math.sin(q1 + q2) * (a[0] + a[1]))
    first = -b * (turn * p + 2.0 * c2 * v2 * p1 + s2 * p2)
    first += gravity - g1 * (math.cos(q1) * v1 * v1 + math.sin(q1) * a[0])
    second = b * (turn * v1 * v1 + 4.0 * c2 * v2 * v1 * a[0] + 2.0 * s2 * (a[0] * a[0] + v1 * j[0])) + gravity
    return first, second


@kernel
def friction(v: float) -> float:
    """Coulomb friction with a Stribeck rise, and viscous friction."""
    rise = COULOMB + (STICTION - COULOMB) * math.exp(-(v / STRIBECK) * (v / STRIBECK))
    return rise * math.tanh(SMOOTH * v) + VISCOUS * v


@kernel
def iteration(state: Any, t: float) -> float:
    """One call of the controller: read, estimate, adapt, linearise, saturate. Returns the sum of both torques."""
    d1, d2 = trajectory(t, AMPLITUDE[0], OMEGA[0]), trajectory(t, AMPLITUDE[1], OMEGA[1])
    q1, q2 = math.floor(d1[0] * COUNTS) / COUNTS, math.floor(d2[0] * COUNTS) / COUNTS  # the encoders' stub
    th1, th2 = q1 + 0.01, q2 + 0.005
    v1, v2, w1, w2 = velocity(state, 0, q1), velocity(state, 1, q2), velocity(state, 2, th1), velocity(state, 3, th2)
    load = state[8]
    a, b, c = A0 + load * (L1 * L1 + L2 * L2), B0 + load * L1 * L2, C0 + load * L2 * L2
    g1, g12 = G1 + load * L1 * GRAVITY, G12 + load * L2 * GRAVITY
    q, c2, s2 = (q1, q2, v1, v2), math.cos(q2), math.sin(q2)
    m11, m12, m22 = a + 2.0 * b * c2, c + b * c2, c
    det = m11 * m22 - m12 * m12
    h1, h2 = bias(q, b, g1, g12)
    f1, f2 = STIFFNESS * (th1 - q1) - h1, STIFFNESS * (th2 - q2) - h2
    acc = ((m22 * f1 - m12 * f2) / det, (m11 * f2 - m12 * f1) / det)
    r11, r12 = -2.0 * b * s2 * v2, -b * s2 * v2
    k1, k2 = bias_rate(q, acc, b, g1, g12)
    f1 = STIFFNESS * (w1 - v1) - r11 * acc[0] - r12 * acc[1] - k1
    f2 = STIFFNESS * (w2 - v2) - r12 * acc[0] - k2
    jerk = ((m22 * f1 - m12 * f2) / det, (m11 * f2 - m12 * f1) / det)
    y1 = d1[4] + GAINS[3] * (d1[3] - jerk[0]) + GAINS[2] * (d1[2] - acc[0])
    y2 = d2[4] + GAINS[3] * (d2[3] - jerk[1]) + GAINS[2] * (d2[2] - acc[1])
    y1 += GAINS[1] * (d1[1] - v1) + GAINS[0] * (d1[0] - q1)
    y2 += GAINS[1] * (d2[1] - v2) + GAINS[0] * (d2[0] - q2)
    n1, n2 = bias_curvature(q, acc, jerk, b, g1, g12)
    u11 = -2.0 * b * (c2 * v2 * v2 + s2 * acc[1])
    x1 = m11 * y1 + m12 * y2 + 2.0 * (r11 * jerk[0] + r12 * jerk[1]) + u11 * acc[0] + 0.5 * u11 * acc[1] + n1
    x2 = m12 * y1 + m22 * y2 + 2.0 * r12 * jerk[0] + 0.5 * u11 * acc[0] + n2
    tau1 = ROTOR * (acc[0] + x1 / STIFFNESS) + STIFFNESS * (th1 - q1) + friction(w1)
    tau2 = ROTOR * (acc[1] + x2 / STIFFNESS) + STIFFNESS * (th2 - q2) + friction(w2)
    off1, off2 = v1 - d1[1] + LAMBDA * (q1 - d1[0]), v2 - d2[1] + LAMBDA * (q2 - d2[0])
    effect1 = (L1 * L1 + L2 * L2) * d1[2] + L1 * GRAVITY * math.cos(q1) + L2 * GRAVITY * math.cos(q1 + q2)
    effect2 = L2 * L2 * d2[2] + L2 * GRAVITY * math.cos(q1 + q2)
    state[8] = min(max(load - DT * ADAPTATION * (off1 * effect1 + off2 * effect2), 0.0), 5.0)
    return TAU_MAX * (math.tanh(tau1 / TAU_MAX) + math.tanh(tau2 / TAU_MAX))


@kernel
def iterations(state: Any, n: int) -> float:
    """The benchmark: n calls at successive times; the sum of all torques is the checksum."""
    total = 0.0
    for k in range(n):
        total += iteration(state, k * DT % 20.0)
    return total


def fresh() -> Any:
    """State before the first call."""
    return np.zeros(STATE_WORDS)
