"""Friction that no law knows: seen in residuals, named, and no reason for intervals that lie."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.ident.figures import structure_figure
from qrobot.ident.model import Identified, identify
from qrobot.ident.observe import HARMONICS, Observations
from qrobot.ident.terms import KINDS, FrictionTermKind
from tests.support.observations import drawn, generated, puma_base

PUMA = load_robot("puma560")
N, ELBOW = PUMA.n, 2
SPEEDS = np.outer([0.1, 0.2, 0.4, 0.7], PUMA.limits.v_max)
ARMS = 3
NOISE = 0.01


def varied(seed: int, kind: FrictionTermKind | None, share: float = 1.0) -> Observations:
    """Passes of an arm whose friction varies besides, by draws of its own on each motor."""
    beta, friction = drawn(seed)
    seen, random = generated(beta, friction, NOISE, seed, speeds=SPEEDS), np.random.default_rng(100 + seed)
    coulomb = np.where(seen.rate > 0.0, friction[seen.motor, 1], friction[seen.motor, 2])
    if kind == "position":
        wave, size = random.integers(0, 2 * HARMONICS, N), random.uniform(0.1, 0.3, N)
        extra = coulomb * size[seen.motor] * seen.harmonics[np.arange(len(seen)), wave[seen.motor]]
    elif kind == "speed":
        fades, size = random.uniform(0.1, 0.4, N) * PUMA.limits.v_max, random.uniform(0.15, 0.4, N)
        extra = coulomb * size[seen.motor] / (1.0 + (seen.rate / fades[seen.motor]) ** 2)
    else:
        extra = random.uniform(0.03, 0.1, N)[seen.motor] * np.abs(seen.gravity @ beta)
    return replace(seen, torque=seen.torque + (kind is not None) * share * np.sign(seen.rate) * extra)


@cache
def found(seed: int, kind: FrictionTermKind | None, sought: tuple[FrictionTermKind, ...] | None = None) -> Identified:
    regressor, base = puma_base()
    return identify(PUMA, base, regressor, varied(seed, kind), kinds=sought)


def inside(kind: FrictionTermKind | None, sought: tuple[FrictionTermKind, ...] | None) -> tuple[float, float]:
    """Share of true frictions inside their intervals, and their mean error as a share."""
    hits, errors = [], []
    for seed in range(ARMS):
        fitted, truth = found(seed, kind, sought), drawn(seed)[1]
        off = np.abs(fitted.friction - truth)
        hits.append(off < fitted.unknowns.parts(fitted.fit.half_width).friction)
        errors.append(off / truth)
    return float(np.mean(hits)), float(np.mean(errors))


@pytest.mark.parametrize("kind", KINDS)
def test_intervals_hold_nine_times_in_ten_and_friction_is_nearer_than_without_terms(kind: FrictionTermKind) -> None:
    (_, plain), (share, error) = inside(kind, ()), inside(kind, None)
    assert share >= 0.9
    assert error < 0.5 * plain


@pytest.mark.parametrize("kind", KINDS)
def test_what_varies_is_named_with_what_to_do(kind: FrictionTermKind) -> None:
    fitted = found(1, kind)
    assert {kinds for motor in fitted.varying.values() for kinds in motor} == {kind}
    assert len(fitted.varying) >= 2
    said = [warning for warning in fitted.warnings if f"friction varies with {kind}" in warning]
    assert len(said) == 1
    assert f"--friction {kind}" in said[0]


def test_friction_that_is_as_the_servo_has_it_is_not_named() -> None:
    for seed in range(ARMS):
        assert found(seed, None).varying == {}
        assert found(seed, None).warnings == ()
    share, error = inside(None, None)
    assert share >= 0.9
    assert error < 0.01


def test_terms_are_sought_where_they_are_asked_for_and_cost_little() -> None:
    asked = found(0, None, ("load",))
    assert asked.unknowns.terms is not None
    assert [term.kind for term in asked.unknowns.terms.sought] == ["load"] * N
    assert found(0, "position", ()).unknowns.terms is None
    names = [value.name for value in asked.values]
    assert "elbow.load_share" in names
    assert inside(None, ("load",))[0] >= 0.9


def test_the_share_of_the_load_comes_back() -> None:
    true = np.random.default_rng(101).uniform(0.03, 0.1, N)
    fitted = found(1, "load")
    values = {value.name: value for value in fitted.values}
    value = values["elbow.load_share"]
    assert value.value == pytest.approx(true[ELBOW], abs=1.5 * value.half_width + 0.003)


def test_the_figure_shows_what_is_left_and_what_was_fitted_of_it() -> None:
    panels = structure_figure(found(1, "position")).axes
    assert len(panels) == 3 * N
    fitted, left = (line.get_ydata() for line in panels[3 * ELBOW].lines[1:])
    assert np.std(np.subtract(left, fitted)) < 0.5 * np.std(left)
