"""Friction that no law knows: seen in residuals, named, and no reason for intervals that lie."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from qrobot.config import Robot, load_robot
from qrobot.config.identified import with_model
from qrobot.ident.figures import residual, structure_figure
from qrobot.ident.friction import FRICTION_NAMES
from qrobot.ident.model import Identified, identify, rms_by_motor
from qrobot.ident.observe import HARMONICS, Observations
from qrobot.ident.regressor import known_parameters
from qrobot.ident.result import model_of
from qrobot.ident.terms import KINDS, FrictionTermKind
from qrobot.servo.memory.telemetry import TelemetryLayout
from tests.support.observations import drawn, generated, puma_base

PUMA = load_robot("puma560")
N, SHOULDER, ELBOW = PUMA.n, 1, 2
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


@pytest.mark.thorough
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


def missed(robot: Robot, seen: Observations) -> np.ndarray:
    """Rms error with which a servo of this robot predicts the torque of passes, by motor: from links and friction."""
    regressor, base = puma_base()
    preset = robot.friction[robot.control.friction_preset]
    friction = np.column_stack([preset.viscous, preset.coulomb_pos, preset.coulomb_neg])
    commanded = robot.transmission.dac_per_Nm / PUMA.transmission.dac_per_Nm
    direction = np.where(seen.rate > 0.0, friction[seen.motor, 1], -friction[seen.motor, 2])
    weight = commanded[seen.motor] * (seen.gravity @ base.K @ known_parameters(robot, regressor))
    rubs = commanded[seen.motor] * (friction[seen.motor, 0] * seen.rate + direction)
    return rms_by_motor(seen.torque - weight - rubs, seen.motor, N)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", KINDS)
def test_what_is_judged_is_the_model_that_the_servo_loads(kind: FrictionTermKind) -> None:
    fitted = found(0, kind)
    robot = with_model(PUMA, model_of(fitted, TelemetryLayout(N).empty(1), "2026-11-27"))
    servos = missed(robot, fitted.observations)
    np.testing.assert_allclose(fitted.held_back_rms, servos, rtol=0.2)
    assert residual(fitted).std() < 0.1 * servos.max()  # the fit, which has what no servo has, tells nothing of it


@pytest.mark.parametrize("kind", ["speed", "load"])
def test_the_servo_gets_the_friction_that_stands_for_what_it_has_not(kind: FrictionTermKind) -> None:
    fitted = found(0, kind)
    model = model_of(fitted, TelemetryLayout(N).empty(1), "2026-11-27")
    bare = dict(zip(FRICTION_NAMES, fitted.friction.T, strict=True))  # viscous and Coulomb's beside the terms
    without = model.model_copy(update={"friction": model.friction.model_copy(update=bare)})
    servos, bares = (missed(with_model(PUMA, each), fitted.observations) for each in (model, without))
    assert (servos < 1.01 * bares).all()
    assert servos[SHOULDER] < 0.5 * bares[SHOULDER]
    assert min(model.friction.viscous) >= 0.0


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


@pytest.mark.thorough
def test_the_figure_shows_what_is_left_and_what_was_fitted_of_it() -> None:
    panels = structure_figure(found(1, "position")).axes
    assert len(panels) == 3 * N
    fitted, left = (line.get_ydata() for line in panels[3 * ELBOW].lines[1:])
    assert np.std(np.subtract(left, fitted)) < 0.5 * np.std(left)
