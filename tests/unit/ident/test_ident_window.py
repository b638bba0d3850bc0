"""Means over smooth windows: those of torque and of acceleration are of one kind."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.ident.window import subsample, window_weights

PERIOD_S = 0.001


def test_window_means_of_a_parabola_are_exact() -> None:
    weights, t = window_weights(61, PERIOD_S), PERIOD_S * (np.arange(61) - 30)
    means = [weight @ (0.7 - 3.0 * t + 5.0 * t**2) for weight in weights]
    np.testing.assert_allclose(means[1:], [-3.0, 10.0], rtol=1e-9)
    assert sum(weights.value) == pytest.approx(1.0)


def test_acceleration_is_the_mean_that_torque_is_whatever_the_motion() -> None:
    """A mass driven by u = m sin(w t): both means lose the same share of it, three per cent here."""
    weights, w = window_weights(201, PERIOD_S), 15.0
    t = PERIOD_S * (np.arange(201) - 100) + 0.05
    push, acceleration = weights.value @ np.sin(w * t), weights.curvature @ (-np.sin(w * t) / w**2)
    assert acceleration == pytest.approx(push, rel=1e-3)
    assert push < 0.9 * np.sin(w * 0.05)


def test_what_decays_at_the_ends_of_a_pass_is_taken_off_as_acceleration() -> None:
    """A mass that still settles to constant speed: its push is not mistaken for friction."""
    samples = 800
    weights, t = window_weights(samples, PERIOD_S), PERIOD_S * np.arange(samples)
    decay = np.exp(-t / 0.05)
    q, push = 0.5 * t + 0.05**2 * 0.1 * decay, 0.1 * decay
    assert abs(push.mean()) > 5e-3
    assert weights.curvature @ q == pytest.approx(weights.value @ push, abs=2e-5)


def test_looks_give_the_mean_that_all_samples_give() -> None:
    weights = window_weights(799, PERIOD_S)
    looks, value = subsample(weights, 40), np.cos(np.linspace(0.3, 1.5, 799))
    assert looks.share.sum() == pytest.approx(1.0)
    assert looks.share @ value[looks.at] == pytest.approx(weights.value @ value, abs=1e-5)
