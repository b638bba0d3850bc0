"""Variable projection, and friction that falls with speed found by it."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.errors import IdentificationError
from qrobot.ident.stribeck import FrictionSamples, StribeckFit, fit_stribeck
from qrobot.ident.varpro import fit_separable

N = 3
LINEAR = np.array([-37.2, 8.4, 1.0])
VISCOUS = np.array([5.8, 9.5, 4.0])
COULOMB = np.array([[24.7, 27.2], [13.6, 7.7], [7.1, 5.6]])
EXCESS = 0.3 * COULOMB
SPEED = np.array([0.03, 0.02, 0.05])


class Decays:
    """Sums of two exponentials, the example of Golub and Pereyra: b = c1 exp(-x1 t) + c2 exp(-x2 t)."""

    t = np.linspace(0.0, 5.0, 200)

    def columns(self, x: np.ndarray) -> np.ndarray:
        return np.exp(-np.outer(self.t, x))

    def slope(self, x: np.ndarray, c: np.ndarray) -> np.ndarray:
        return -self.t[:, None] * self.columns(x) * c


def test_two_exponentials_are_taken_apart() -> None:
    model = Decays()
    b = model.columns(np.array([0.5, 2.0])) @ [3.0, -1.5]
    found = fit_separable(model, b, np.ones(b.size), np.array([0.2, 4.0]), 1e6)
    np.testing.assert_allclose([*found.x, *found.c], [0.5, 2.0, 3.0, -1.5], rtol=1e-5)


def test_the_covariance_is_that_of_all_values_together() -> None:
    model, truth = Decays(), np.array([3.0, -1.5, 0.5, 2.0])
    exact = model.columns(truth[2:]) @ truth[:2]
    random, hits = np.random.default_rng(0), []
    for _ in range(100):
        b = exact + 0.003 * random.normal(size=exact.size)
        found = fit_separable(model, b, np.full(b.size, 1.0 / 0.003), np.array([0.4, 2.2]), 100.0)
        hits.append(np.abs([*found.c, *found.x] - truth) < 1.96 * np.sqrt(np.diag(found.covariance)))
    assert 0.9 < np.mean(hits) < 0.99


def samples(noise: float, seed: int = 0, each: int = 400, slowest: float = 0.003) -> FrictionSamples:
    """Motors at speeds from crawling to fast, in both directions."""
    random = np.random.default_rng(seed)
    motor = np.repeat(np.arange(N), each)
    rate = np.exp(random.uniform(np.log(slowest), 0.0, motor.size)) * random.choice([-1.0, 1.0], motor.size)
    linear = random.normal(size=(motor.size, LINEAR.size))
    side = np.where(rate > 0.0, 0, 1)
    rubs = COULOMB[motor, side] + EXCESS[motor, side] / (1.0 + (rate / SPEED[motor]) ** 2)
    torque = linear @ LINEAR + VISCOUS[motor] * rate + np.sign(rate) * rubs
    return FrictionSamples(linear, motor, rate, torque + noise * random.normal(size=motor.size))


def fitted(given: FrictionSamples) -> StribeckFit:
    return fit_stribeck(given, N, np.full(N, 0.1))


def test_without_noise_everything_comes_back() -> None:
    found = fitted(samples(0.0))
    np.testing.assert_allclose(found.linear, LINEAR, rtol=1e-6)
    np.testing.assert_allclose(found.viscous, VISCOUS, rtol=1e-5)
    np.testing.assert_allclose(found.coulomb, COULOMB, rtol=1e-5)
    np.testing.assert_allclose(found.excess, EXCESS, rtol=1e-4)
    np.testing.assert_allclose(found.speed, SPEED, rtol=1e-4)


def test_a_motor_that_never_moved_is_refused() -> None:
    with pytest.raises(IdentificationError, match="more speeds"):
        fit_stribeck(samples(0.1), N + 1, np.full(N + 1, 0.1))


def test_with_noise_intervals_hold_the_truth() -> None:
    hits = []
    for seed in range(8):
        found = fitted(samples(0.3, seed))
        hits += list(np.abs(found.linear - LINEAR) < found.linear_half_width)
        hits += list((np.abs(found.coulomb - COULOMB) < found.coulomb_half_width).ravel())
        hits += list(np.abs(np.log(found.speed / SPEED)) < np.log(found.speed_factor))
    assert np.mean(hits) > 0.88
    np.testing.assert_allclose(found.scatter, 0.3, rtol=0.15)


def test_wild_samples_do_not_mislead() -> None:
    given = samples(0.1)
    given.torque[::20] += 30.0
    np.testing.assert_allclose(fitted(given).coulomb, COULOMB, rtol=0.05)


def test_the_speed_is_uncertain_where_nothing_is_slow() -> None:
    fast, slow = fitted(samples(0.3, slowest=0.1)), fitted(samples(0.3))
    assert (fast.speed_factor > 3.0).all()
    assert (slow.speed_factor < 1.3).all()
    assert (np.abs(np.log(fast.speed / 0.1)) < 1.5).all()  # it stays about where it was believed to be


def test_viscous_and_coulomb_friction_are_bent_without_the_term() -> None:
    """What the term is for: a straight fit of the same samples makes Coulomb friction too high."""
    given = samples(0.0, slowest=0.02)
    mine = (given.motor == 0) & (given.rate > 0.0)
    line = np.polyfit(given.rate[mine], given.torque[mine] - given.linear[mine] @ LINEAR, 1)
    assert line[1] > 1.03 * COULOMB[0, 0]
    assert fitted(given).coulomb[0, 0] == pytest.approx(COULOMB[0, 0], rel=1e-3)
