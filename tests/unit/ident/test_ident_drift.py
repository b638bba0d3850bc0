"""Friction that changes while an arm warms up: found beside everything else, and named."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.ident.change import load_change
from qrobot.ident.model import Identified, identify
from qrobot.ident.report import report_page
from qrobot.ident.result import model_of
from qrobot.servo.memory.telemetry import TelemetryLayout
from tests.support.observations import drawn, generated, puma_base

PUMA = load_robot("puma560")
N, SHOULDER, ELBOW = PUMA.n, 1, 2
SPEEDS = np.outer([0.1, 0.2, 0.4, 0.7], PUMA.limits.v_max)
WARMING = np.array([0.0, -0.1, -0.12, 0.0, 0.0, 0.06])


@cache
def found(warms: bool = True, seed: int = 0) -> Identified:
    regressor, base = puma_base()
    drift = WARMING if warms else 0.0
    return identify(PUMA, base, regressor, generated(*drawn(seed), 0.01, seed, speeds=SPEEDS, drift=drift))


def test_the_change_of_each_motor_is_found() -> None:
    parts, half_width = (found().unknowns.parts(each) for each in (found().fit.values, found().fit.half_width))
    np.testing.assert_allclose(parts.drift, WARMING, atol=0.02)
    assert (np.abs(parts.drift - WARMING) < 1.6 * half_width.drift).all()


def test_friction_is_that_of_the_middle_of_the_recording() -> None:
    np.testing.assert_allclose(found().friction[:3], drawn(0)[1][:3], rtol=0.01)


def test_it_is_named_with_what_to_do_and_steady_friction_is_not() -> None:
    assert "friction of elbow fell by 12 % during the recording: let the arm warm up" in "".join(found().warnings)
    assert set(found().drifting) == {"shoulder", "elbow", "flange"}
    assert found().drifting["flange"] == pytest.approx(0.06, abs=0.02)
    assert found(warms=False).drifting == {}
    assert found(warms=False).warnings == ()


def test_a_recording_with_a_load_goes_on_with_an_arm_as_warm_as_the_one_before_left_it() -> None:
    whole = generated(
        *drawn(1, load_kg=0.0), 0.0, 1, poses=40, load_kg=np.where(np.arange(40) < 28, 0.0, 2.0), drift=WARMING
    )
    later = whole.time_s >= 0.7 * whole.time_s.max()
    second = whole.only(later)
    loaded = replace(second, time_s=second.time_s - second.time_s.min(), loaded=np.full(len(second), True))
    regressor, base = puma_base()
    fitted = identify(PUMA, base, regressor, whole.only(~later).followed_by(loaded))
    np.testing.assert_allclose(fitted.unknowns.parts(fitted.fit.values).drift, WARMING, atol=0.01)


def test_the_report_has_it_too() -> None:
    page = report_page(found(), model_of(found(), TelemetryLayout(N).empty(1), "2026-11-21"), None, [])
    assert "friction of shoulder fell by 10 % during the recording" in page


def test_it_is_not_taken_for_a_load_that_was_dropped() -> None:
    assert load_change(found()) is None


def test_the_derivative_by_every_value_is_that_of_the_prediction() -> None:
    fitted, step = found(), 1e-6
    unknowns, values, seen = fitted.unknowns, fitted.fit.values, fitted.observations
    slopes = unknowns.jacobian(values, seen)
    for i in np.random.default_rng(1).choice(values.size, 20, replace=False):
        ahead, behind = values.copy(), values.copy()
        ahead[i], behind[i] = values[i] + step, values[i] - step
        measured = (unknowns.predict(ahead, seen) - unknowns.predict(behind, seen)) / (2.0 * step)
        np.testing.assert_allclose(slopes[:, i], measured, atol=1e-6)
