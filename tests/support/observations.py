"""Observations of PUMAs nobody has been told of, made by the equations themselves."""

from __future__ import annotations

from functools import cache

import numpy as np

from qrobot.config import load_robot
from qrobot.ident.base import BaseParameters, base_of_robot
from qrobot.ident.friction import friction_columns
from qrobot.ident.observe import SUBSAMPLES, Observations, harmonics
from qrobot.ident.regressor import OF_GRAVITY, Regressor, gravity_regressor, known_parameters
from qrobot.sim_board.drive import STRIBECK_FRACTION

PUMA = load_robot("puma560")
N = PUMA.n
TWO_SPEEDS = np.outer([0.2, 0.6], np.ones(N))  # rad/s
LOAD = np.array([1.0, 0.01, -0.02, 0.06])  # mass and first moment of a load of 1 kg


@cache
def puma_base() -> tuple[Regressor, BaseParameters]:
    regressor = gravity_regressor(PUMA)
    return regressor, base_of_robot(PUMA, regressor)


def drawn(seed: int, load_kg: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """Base parameters and friction of an arm 30 % off the file, with something in its hand."""
    random, (regressor, base) = np.random.default_rng(seed), puma_base()
    theta = known_parameters(PUMA, regressor) * random.uniform(0.7, 1.3, len(regressor.names))
    theta[-OF_GRAVITY:] += load_kg * LOAD
    preset = PUMA.friction["corke"]
    friction = np.column_stack([preset.viscous, preset.coulomb_pos, preset.coulomb_neg])
    return base.K @ theta, friction * random.uniform(0.7, 1.3, friction.shape)


def generated(
    beta: np.ndarray,
    friction: np.ndarray,
    noise: float,
    seed: int,
    poses: int = 30,
    scale: np.ndarray | None = None,
    load_kg: np.ndarray | float = 0.0,
    speeds: np.ndarray = TWO_SPEEDS,
    stiction: float = 1.0,
    fades_at: float = STRIBECK_FRACTION,
    drift: np.ndarray | float = 0.0,
    within: float = 1.0,
) -> Observations:
    """Passes through random poses, up and down at some speeds, of an arm without a coupled wrist's effect on rates.

    `scale` (n,) is what its motors are commanded for a torque of 1, `load_kg` of which `LOAD` tells is carried besides,
    through all of them or pose by pose (poses,). `speeds` of the motors have shape (k, n). Friction at rest is
    `stiction` times Coulomb friction and half as much more at a share `fades_at` of greatest speed. All of it
    rises by a share `drift` (n,) from the first pass to the last. Poses lie in a share `within` of the range, in its
    middle.
    """
    random, (regressor, base) = np.random.default_rng(seed), puma_base()
    middle, half = PUMA.limits.q_min + PUMA.limits.q_max, PUMA.limits.q_max - PUMA.limits.q_min
    places = 0.5 * (middle + within * random.uniform(-half, half, (poses, N)))
    q = np.repeat(places, 2 * len(speeds), axis=0)
    rate = np.tile(np.stack([speeds, -speeds], axis=1).reshape(-1, N), (poses, 1))
    to_motor = np.linalg.inv(PUMA.transmission.coupling.T)
    gravity = to_motor @ base.columns(regressor(q))
    load = to_motor @ regressor(q)[..., -OF_GRAVITY:]
    carried = np.repeat(load_kg * np.ones(poses), 2 * len(speeds))[:, None] * (load @ LOAD)
    weight = (np.ones(N) if scale is None else scale) * (gravity @ beta + carried)
    rubs = (friction_columns(rate, PUMA.control.friction_velocity) * friction).sum(axis=-1)
    excess = (stiction - 1.0) / (1.0 + (rate / (fades_at * PUMA.limits.v_max)) ** 2)
    rubs += excess * np.where(rate > 0.0, friction[:, 1], -friction[:, 2])
    rubs *= 1.0 + drift * (np.arange(len(q)) / (len(q) - 1) - 0.5)[:, None]
    m = rate.size
    return Observations(
        motor=np.tile(np.arange(N), len(q)),
        passed=np.repeat(np.arange(len(q)), N),
        time_s=np.repeat(2.0 * np.arange(len(q)), N),
        q=np.repeat(q, N, axis=0),
        gravity=gravity.reshape(m, len(beta)),
        gravity_parts=np.repeat(gravity.reshape(m, 1, len(beta)) / SUBSAMPLES, SUBSAMPLES, axis=1),
        load=load.reshape(m, OF_GRAVITY),
        loaded=np.full(m, bool(np.all(load_kg)) and not np.ndim(load_kg)),
        rate=rate.ravel(),
        harmonics=harmonics(PUMA, q).reshape(m, -1),
        torque=(weight + rubs + noise * random.normal(size=rate.shape)).ravel(),
        doubt=np.full(m, 1e-3),
        inertia=np.zeros((m, 0)),
    )
