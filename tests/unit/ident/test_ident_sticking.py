"""Drives that stick: what is left of it at speed neither bends the rest nor makes intervals too narrow."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.ident.friction import REMAINDER_SPEED, remainder_columns
from qrobot.ident.model import Identified, identify
from tests.support.observations import drawn, generated, puma_base

PUMA = load_robot("puma560")
N = PUMA.n
SPEEDS = np.outer([0.1, 0.2, 0.4, 0.7], PUMA.limits.v_max)
STICTION = 1.3


@cache
def found(seed: int, stiction: float = STICTION, noise: float = 0.02, fades_at: float = 0.02) -> Identified:
    regressor, base = puma_base()
    observations = generated(*drawn(seed), noise, seed, speeds=SPEEDS, stiction=stiction, fades_at=fades_at)
    return identify(PUMA, base, regressor, observations)


def test_the_remainder_falls_nearly_with_the_square_of_speed() -> None:
    at, fast = (remainder_columns(share * PUMA.limits.v_max[None], PUMA.limits.v_max) for share in (0.1, -0.2))
    np.testing.assert_allclose(at[0], np.tile([1.0, 0.0], (N, 1)))
    np.testing.assert_allclose(fast[0], np.tile([0.0, -0.25], (N, 1)), rtol=0.05)
    assert np.isfinite(remainder_columns(np.zeros((1, N)), PUMA.limits.v_max)).all()


def test_coulomb_and_viscous_friction_are_those_of_the_drive_and_not_bent() -> None:
    np.testing.assert_allclose(found(0, noise=1e-6).friction, drawn(0)[1], rtol=1e-4)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(("fades_at", "least"), [(0.01, 0.85), (0.02, 0.9), (0.03, 0.8)])
def test_intervals_of_friction_hold_the_truth_though_drives_stick(fades_at: float, least: float) -> None:
    hits = []
    for seed in range(3):
        fitted = found(seed, fades_at=fades_at)
        friction = slice(fitted.unknowns.n_weights, fitted.unknowns.n_weights + 3 * N)
        off = fitted.fit.values[friction] - drawn(seed)[1].ravel()
        hits.append(np.abs(off) < fitted.fit.half_width[friction])
    assert np.mean(hits) > least


def test_remainders_are_those_of_the_drives() -> None:
    coulomb = drawn(0)[1][:, 1:]
    fitted = found(0, noise=1e-6)
    shown = fitted.unknowns.parts(fitted.fit.values).remainder / coulomb
    np.testing.assert_allclose(shown, (STICTION - 1.0) / (1.0 + (REMAINDER_SPEED / 0.02) ** 2), rtol=0.02)


def test_motors_that_stick_are_named_and_others_are_not() -> None:
    assert {"waist", "shoulder", "elbow"} <= set(found(0).sticking)
    assert "waist" in found(0).warnings[0]
    assert "--slow" in found(0).warnings[0]
    assert found(0, stiction=1.0).sticking == ()
    assert found(0, stiction=1.0).warnings == ()
