"""Torque scales of the motors: which can be told, against what, and that they do no harm where they cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import IdentificationError
from qrobot.ident.fit import KNOWN, fit_linear
from qrobot.ident.model import Identified, identify
from tests.support.observations import LOAD, drawn, generated, puma_base

PUMA = load_robot("puma560")
N, SHOULDER = PUMA.n, 1
SCALE = np.array([1.2, 0.85, 1.25, 0.8, 1.15, 0.9])
LOAD_KG = 2.0


def identified(seed: int, noise: float = 0.0, known_torque: bool = False) -> tuple[Identified, np.ndarray, np.ndarray]:
    """A PUMA whose motors give too much or too little, and its true base parameters and friction."""
    beta, friction = drawn(seed)
    observations = generated(beta, friction, noise, seed, scale=SCALE)
    regressor, base = puma_base()
    return identify(PUMA, base, regressor, observations, known_torque), beta, friction


def test_ratios_to_the_motor_that_bears_most_are_found_and_the_waist_keeps_its_scale() -> None:
    found, beta, friction = identified(0)
    np.testing.assert_allclose(found.scale[1:], (SCALE / SCALE[SHOULDER])[1:], rtol=1e-3)
    assert found.scale[0] == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(found.beta, beta * SCALE[SHOULDER], atol=1e-3)
    np.testing.assert_allclose(found.friction, friction, atol=1e-4)


def test_what_is_commanded_is_predicted_where_equal_scales_contradict_each_other() -> None:
    assert identified(1, 0.05)[0].held_back_rms.max() < 0.1
    assert identified(1, 0.05, known_torque=True)[0].held_back_rms.max() > 1.0


def test_gravity_is_the_torque_to_command() -> None:
    found, beta, _ = identified(2)
    regressor, base = puma_base()
    q = np.random.default_rng(3).uniform(PUMA.limits.q_min, PUMA.limits.q_max, (50, N))
    to_motor = np.linalg.inv(PUMA.transmission.coupling.T)
    commanded = (to_motor @ base.columns(regressor(q)) @ beta) * SCALE @ PUMA.transmission.coupling
    np.testing.assert_allclose(found.gravity(q), commanded, atol=1e-3)


def test_intervals_of_scales_hold_the_truth_and_say_what_is_not_told() -> None:
    hits, true = [], np.delete(SCALE / SCALE[SHOULDER], SHOULDER)
    for seed in range(6):
        scales = [v for v in identified(seed, 0.05)[0].values if v.name.endswith("torque_scale")]
        hits += [abs(v.value - t) < v.half_width for v, t in zip(scales, true, strict=True)]
        waist, elbow = scales[0], scales[1]
        assert waist.half_width == pytest.approx(1.96 * 0.3, rel=1e-3)
        assert elbow.half_width < 0.02
    assert np.mean(hits) > 0.9


def loaded_and_bare(noise: float, load_kg: float | None) -> tuple[Identified, np.ndarray]:
    beta, friction = drawn(4, load_kg=0.0)
    bare = generated(beta, friction, noise, 4, scale=SCALE)
    loaded = generated(beta, friction, noise, 5, poses=12, scale=SCALE, load_kg=LOAD_KG)
    regressor, base = puma_base()
    return identify(PUMA, base, regressor, bare.followed_by(loaded), load_kg=load_kg), beta


def test_a_load_is_found_in_passes_that_carried_it_in_the_unit_of_the_shoulder() -> None:
    found, _ = loaded_and_bare(0.0, None)
    load = [v.value for v in found.values if v.name.startswith("load.")]
    np.testing.assert_allclose(load, LOAD_KG * LOAD * SCALE[SHOULDER], atol=1e-3)


def test_a_weighed_load_tells_true_torque() -> None:
    found, beta = loaded_and_bare(0.02, LOAD_KG)
    np.testing.assert_allclose(found.scale[1:], SCALE[1:], rtol=0.02)
    np.testing.assert_allclose(found.beta[:3], beta[:3], rtol=0.02, atol=0.05)
    mass = next(v for v in found.values if v.name == "load.m")
    assert mass.value == pytest.approx(LOAD_KG, rel=0.01)


def test_a_motor_that_feels_next_to_no_weight_keeps_its_scale() -> None:
    """Errors of the model would be taken for a scale: of a flange for a quarter, which made its torque fourfold."""
    beta, friction = drawn(4, load_kg=0.0)
    scale = np.append(SCALE[:-1], 0.0)  # what is commanded of the flange has nothing to do with weight
    bare = generated(beta, friction, 1e-3, 4, scale=scale)
    loaded = generated(beta, friction, 1e-3, 5, poses=12, scale=scale, load_kg=LOAD_KG)
    observations, (regressor, base) = bare.followed_by(loaded), puma_base()
    felt = np.where(observations.motor == N - 1, 0.005, 1.0)
    observations = replace(
        observations,
        gravity=observations.gravity * felt[:, None],
        gravity_parts=observations.gravity_parts * felt[:, None, None],
        load=observations.load * felt[:, None],
    )
    found = identify(PUMA, base, regressor, observations, load_kg=LOAD_KG)
    assert found.scale[-1] == 1.0
    np.testing.assert_allclose(found.scale[1:-1], SCALE[1:-1], rtol=2e-3)
    told = {value.name: value for value in found.values}
    assert told["flange.torque_scale"].half_width == pytest.approx(1.96 * 0.3, rel=1e-3)
    assert told["load.hz"].value == pytest.approx(LOAD_KG * LOAD[3], rel=0.02)
    np.testing.assert_allclose(found.friction, friction, atol=2e-3)


def test_a_weighed_load_that_nothing_carried_is_refused() -> None:
    regressor, base = puma_base()
    with pytest.raises(IdentificationError, match="no pass that carried it"):
        identify(PUMA, base, regressor, generated(*drawn(4), 0.05, 4), load_kg=1.0)


def test_what_is_known_beforehand_counts_by_its_doubt_and_has_no_scatter() -> None:
    A, b = np.array([[1.0], [1.0], [1.0], [1.0]]), np.array([2.0, 2.1, 1.9, 5.0])
    row_class = np.array([0, 0, 0, KNOWN])
    fits = [fit_linear(A, b, row_class, ["x"], np.array([0.0, 0.0, 0.0, doubt])) for doubt in (10.0, 1e-3)]
    loose, tight = (fit.values[0] for fit in fits)
    assert loose == pytest.approx(2.0, abs=0.1)
    assert tight == pytest.approx(5.0, abs=0.1)
    assert fits[0].scatter.shape == (1,)
