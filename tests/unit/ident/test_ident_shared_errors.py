"""Errors of inertia are the same in all passes: they are sought, and do not lead gravity astray."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from qrobot.config import load_robot
from qrobot.ident.model import HELD_BACK, Identified, identify
from qrobot.ident.observe import Observations
from qrobot.ident.swings import swings_of
from tests.support.observations import drawn, generated, puma_base

PUMA = load_robot("puma560")


def identified(observations: Observations) -> Identified:
    regressor, base = puma_base()
    return identify(PUMA, base, regressor, observations, known_torque=True)


def off(found: Identified, beta: np.ndarray) -> np.ndarray:
    """Errors of gravity's parameters in half widths of their intervals."""
    return np.abs(found.beta - beta) / found.fit.half_width[: len(beta)]


def test_gravity_holds_where_inertia_is_wrong_in_all_passes_and_its_likely_errors_are_told() -> None:
    beta, friction = drawn(0)
    right = generated(beta, friction, 1e-3, seed=0)
    columns = 0.1 * right.gravity[:, ::-1] * (right.rate**2)[:, None]  # turns with the arm, and grows with speed
    errors = np.random.default_rng(1).normal(size=columns.shape[1])
    wrong = replace(right, torque=right.torque + columns @ errors)
    blind, told = identified(wrong), identified(replace(wrong, inertia=columns))
    assert off(identified(right), beta).max() < 2.0
    assert off(told, beta).max() < 2.0
    assert np.abs(blind.beta - beta).max() > 10.0 * np.abs(told.beta - beta).max()


def test_errors_of_inertia_are_not_told_by_the_passes_that_are_predicted() -> None:
    right, error = generated(*drawn(0), 1e-3, seed=0), 0.05  # N m, which only passes held back feel
    held = swings_of(PUMA, right) % HELD_BACK == HELD_BACK - 1
    wrong = replace(right, torque=right.torque + error * held, inertia=error * held[:, None])
    np.testing.assert_allclose(identified(wrong).held_back_rms, error, rtol=0.05)
