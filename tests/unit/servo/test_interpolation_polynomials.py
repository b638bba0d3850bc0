"""The forms of interpolation: what their tables of numbers amount to."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from qrobot.config.deployment import Interpolation, ServoChoice
from qrobot.errors import ConfigError
from qrobot.servo.kernels.interpolation_polynomials import DEFAULT_FORM, FORMS, QUINTIC, Form, find_form


@pytest.mark.parametrize(
    ("name", "delay", "continuity", "degree", "through"),
    [("linear", 1, 0, 1, True), ("cubic", 2, 1, 2, True), ("quintic", 2, 2, 2, True), ("b-spline", 2, 2, 1, False)],
)
def test_each_form_has_its_delay_continuity_and_degree(
    name: str, delay: int, continuity: int, degree: int, through: bool
) -> None:
    form = FORMS[name]
    assert (form.delay_frames, form.continuity, form.degree) == (delay, continuity, degree)
    assert form.through_setpoints is through


def test_the_quintics_table_is_the_hermite_polynomial_with_central_differences() -> None:
    k0, k1, k2, k3 = np.random.default_rng(3).normal(size=4)
    ends = [k1, (k2 - k0) / 2, k2 - 2 * k1 + k0, k2, (k3 - k1) / 2, k3 - 2 * k2 + k1]
    powers = np.arange(6)
    rows = [np.eye(6)[0], np.eye(6)[1], 2 * np.eye(6)[2], np.ones(6), powers, powers * (powers - 1)]
    wanted = np.linalg.solve(np.array(rows, dtype=float), ends)
    steps = QUINTIC.table[:, :3] @ np.diff([k0, k1, k2, k3])
    steps[0] += k0
    np.testing.assert_allclose(steps, wanted, atol=1e-12)


def test_a_form_whose_frames_do_not_meet_in_velocity_is_found_out() -> None:
    kinked = Form("kinked", ((1.0, 0.0, 0.0), (0.5, 0.6, 0.0), (-0.5, 0.4, 0.0)), "")
    assert kinked.continuity == 0


def test_an_unknown_form_is_refused_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match="no interpolation 'spline'; there are: linear, cubic, quintic, b-spline"):
        find_form("spline")


def test_deployment_files_know_every_form_and_the_same_default() -> None:
    assert get_args(Interpolation) == tuple(FORMS)
    assert ServoChoice().interpolation == DEFAULT_FORM
