"""How long a fit takes: 60,000 torques of a PUMA in motion, linear friction and Stribeck's."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from benchmarks.rows import Goal, Row, row
from benchmarks.timing import Effort, interleaved
from qrobot.config import load_robot
from qrobot.ident.base import base_of_robot
from qrobot.ident.fit import fit_linear
from qrobot.ident.friction import friction_columns
from qrobot.ident.regressor import inertial_regressor, known_parameters
from qrobot.ident.stribeck import FrictionSamples, fit_stribeck

SAMPLES: Final = 60_000
NOISE_NM: Final = 0.5
EXCESS: Final = 0.3  # of Coulomb friction, at rest
FADES: Final = 0.02  # of the greatest speed
FASTEST: Final = 2.0 * np.pi * 0.35  # rad/s of the quickest of the sines


def motion(samples: int, excess: float, seed: int = 3) -> FrictionSamples:
    """Torques of a PUMA whose joints swing by sines of their own, with noise and friction that is higher at rest."""
    robot, random = load_robot("puma560"), np.random.default_rng(seed)
    regressor = inertial_regressor(robot)
    base, n = base_of_robot(robot, regressor), robot.n
    t = np.linspace(0.0, 60.0, -(-samples // n))[:, None]
    rate, phase = FASTEST * random.uniform(0.5, 1.0, n), random.uniform(0.0, 6.0, n)
    swing = 0.3 * robot.limits.v_max / rate
    v, a = swing * rate * np.cos(rate * t + phase), -swing * rate**2 * np.sin(rate * t + phase)
    Y = base.columns(regressor(swing * np.sin(rate * t + phase), v, a))
    preset = robot.friction[robot.control.friction_preset]
    coulomb = np.where(v > 0.0, preset.coulomb_pos, preset.coulomb_neg)
    fading = 1.0 + excess / (1.0 + (v / (FADES * robot.limits.v_max)) ** 2)
    torque = Y @ base.K @ known_parameters(robot, regressor) + preset.viscous * v + np.sign(v) * coulomb * fading
    torque += NOISE_NM * random.normal(size=torque.shape)
    motor = np.tile(np.arange(n), len(t))
    return FrictionSamples(*(x[:samples] for x in (Y.reshape(-1, Y.shape[-1]), motor, v.ravel(), torque.ravel())))


def rows(effort: Effort) -> Iterator[Row]:
    """The rows."""
    robot = load_robot("puma560")
    many = max(effort.times(SAMPLES), 3000)
    plain, falling = motion(many, 0.0), motion(many, EXCESS)
    rate = np.where(plain.motor[:, None] == np.arange(robot.n), plain.rate[:, None], 0.0)
    A = np.column_stack([plain.linear, friction_columns(rate, np.full(robot.n, 1e-6)).reshape(many, -1)])
    names, believed = [f"value {i}" for i in range(A.shape[1])], 2.0 * FADES * robot.limits.v_max
    best = interleaved(
        {
            "linear": lambda: fit_linear(A, plain.torque, plain.motor, names),
            "Stribeck": lambda: fit_stribeck(falling, robot.n, believed),
        },
        effort.rounds,
    )
    yield row(f"linear fit of {A.shape[1]} values, {many} samples", best["linear"], "s", Goal(1.0))
    yield row(f"the same with Stribeck's friction, {many} samples", best["Stribeck"], "s", Goal(10.0))
