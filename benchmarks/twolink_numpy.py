"""The law of `twolink` as one would write it with NumPy: vectors of two, matrices two by two."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchmarks import twolink as scalar

_A, _W = np.array(scalar.AMPLITUDE), np.array(scalar.OMEGA)
_K = np.array(scalar.GAINS)


def trajectory(t: float) -> Any:
    """Desired positions and four derivatives. Shape (5, 2)."""
    s, c, e = np.sin(_W * t), np.cos(_W * t), math.exp(-0.3 * t**3)
    p, p1, p2 = 0.9 * t * t, 1.8 * t, 1.8
    envelope = [1.0 - e, p * e, (p1 - p * p) * e, (p2 - 3.0 * p * p1 + p**3) * e]
    envelope.append((-3.0 * p1 * p1 - 4.0 * p * p2 + 6.0 * p * p * p1 - p**4) * e)
    wave = [s, _W * c, -(_W**2) * s, -(_W**3) * c, _W**4 * s]
    return np.array([_A * sum(math.comb(k, i) * wave[k - i] * envelope[i] for i in range(k + 1)) for k in range(5)])


class Controller:
    """State of the law."""

    def __init__(self) -> None:
        self.reading, self.rate, self.load = np.zeros(4), np.zeros(4), 0.0

    def iteration(self, t: float) -> float:
        """One call, as `twolink.iteration`."""
        d = trajectory(t)
        q = np.floor(d[0] * scalar.COUNTS) / scalar.COUNTS
        theta = q + np.array([0.01, 0.005])
        v, w = self._velocities(np.concatenate([q, theta]))
        b = scalar.B0 + self.load * scalar.L1 * scalar.L2
        M, dM, h = self._model(q, v, b)
        acc = np.linalg.solve(M, scalar.STIFFNESS * (theta - q) - h)
        jerk = np.linalg.solve(M, scalar.STIFFNESS * (w - v) - dM @ acc - self._bias_rate(q, v, acc, b))
        y = d[4] + _K[::-1] @ (d[3::-1] - np.array([jerk, acc, v, q]))
        s2, c2 = np.sin(q[1]), np.cos(q[1])
        ddM = -b * (c2 * v[1] ** 2 + s2 * acc[1]) * np.array([[2.0, 1.0], [1.0, 0.0]])
        x = M @ y + 2.0 * dM @ jerk + ddM @ acc + self._bias_curvature(q, v, acc, jerk, b)
        tau = scalar.ROTOR * (acc + x / scalar.STIFFNESS) + scalar.STIFFNESS * (theta - q) + friction(w)
        self._adapt(q, v, d)
        return float(np.sum(scalar.TAU_MAX * np.tanh(tau / scalar.TAU_MAX)))

    def _velocities(self, reading: Any) -> tuple[Any, Any]:
        self.rate += scalar.LOW_PASS * ((reading - self.reading) / scalar.DT - self.rate)
        self.reading = reading
        return self.rate[:2].copy(), self.rate[2:].copy()

    def _gravity(self) -> tuple[float, float]:
        arm, tip = self.load * scalar.L1 * scalar.GRAVITY, self.load * scalar.L2 * scalar.GRAVITY
        return scalar.G1 + arm, scalar.G12 + tip

    def _model(self, q: Any, v: Any, b: float) -> tuple[Any, Any, Any]:
        a = scalar.A0 + self.load * (scalar.L1**2 + scalar.L2**2)
        c = scalar.C0 + self.load * scalar.L2**2
        g1, g12 = self._gravity()
        s2, c2 = np.sin(q[1]), np.cos(q[1])
        M = np.array([[a + 2.0 * b * c2, c + b * c2], [c + b * c2, c]])
        dM = -b * s2 * v[1] * np.array([[2.0, 1.0], [1.0, 0.0]])
        h = b * s2 * np.array([-(2.0 * v[0] * v[1] + v[1] ** 2), v[0] ** 2])
        return M, dM, h + g12 * np.cos(q[0] + q[1]) + np.array([g1 * np.cos(q[0]), 0.0])

    def _bias_rate(self, q: Any, v: Any, a: Any, b: float) -> Any:
        g1, g12 = self._gravity()
        s2, c2 = np.sin(q[1]), np.cos(q[1])
        p, p1 = 2.0 * v[0] * v[1] + v[1] ** 2, 2.0 * (a[0] * v[1] + v[0] * a[1] + v[1] * a[1])
        coriolis = b * np.array([-(c2 * v[1] * p + s2 * p1), c2 * v[1] * v[0] ** 2 + 2.0 * s2 * v[0] * a[0]])
        gravity = np.array([g1 * np.sin(q[0]) * v[0], 0.0]) + g12 * np.sin(q[0] + q[1]) * np.sum(v)
        return coriolis - gravity

    def _bias_curvature(self, q: Any, v: Any, a: Any, j: Any, b: float) -> Any:
        g1, g12 = self._gravity()
        s2, c2, w = np.sin(q[1]), np.cos(q[1]), np.sum(v)
        p, p1 = 2.0 * v[0] * v[1] + v[1] ** 2, 2.0 * (a[0] * v[1] + v[0] * a[1] + v[1] * a[1])
        p2 = 2.0 * (j[0] * v[1] + 2.0 * a[0] * a[1] + v[0] * j[1] + a[1] ** 2 + v[1] * j[1])
        turn = c2 * a[1] - s2 * v[1] ** 2
        first = -(turn * p + 2.0 * c2 * v[1] * p1 + s2 * p2)
        second = turn * v[0] ** 2 + 4.0 * c2 * v[1] * v[0] * a[0] + 2.0 * s2 * (a[0] ** 2 + v[0] * j[0])
        shoulder = g1 * (np.cos(q[0]) * v[0] ** 2 + np.sin(q[0]) * a[0])
        both = g12 * (np.cos(q[0] + q[1]) * w * w + np.sin(q[0] + q[1]) * np.sum(a))
        return b * np.array([first, second]) - both - np.array([shoulder, 0.0])

    def _adapt(self, q: Any, v: Any, d: Any) -> None:
        off = v - d[1] + scalar.LAMBDA * (q - d[0])
        inertia = np.array([scalar.L1**2 + scalar.L2**2, scalar.L2**2]) * d[2]
        tip = scalar.L2 * scalar.GRAVITY * np.cos(q[0] + q[1])
        effect = inertia + tip + np.array([scalar.L1 * scalar.GRAVITY * np.cos(q[0]), 0.0])
        self.load = float(np.clip(self.load - scalar.DT * scalar.ADAPTATION * (off @ effect), 0.0, 5.0))


def friction(v: Any) -> Any:
    """As `twolink.friction`, for both joints. Shape (2,)."""
    rise = scalar.COULOMB + (scalar.STICTION - scalar.COULOMB) * np.exp(-((v / scalar.STRIBECK) ** 2))
    return rise * np.tanh(scalar.SMOOTH * v) + scalar.VISCOUS * v


def iterations(n: int) -> float:
    """As `twolink.iterations` from a fresh state."""
    controller = Controller()
    return sum(controller.iteration(k * scalar.DT % 20.0) for k in range(n))
