"""The fit: exact without noise, honest with it, and not misled by outliers or missing motion."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import IdentificationError
from qrobot.ident.fit import Fit, fit_linear
from qrobot.ident.friction import friction_columns
from qrobot.ident.model import identify
from qrobot.ident.observe import Observer, steady_passes
from qrobot.modecodes import Mode
from qrobot.model.dynamics import FrictionParams, friction_torque
from qrobot.servo.memory.telemetry import TelemetryLayout
from tests.support.observations import drawn, generated, puma_base

PUMA = load_robot("puma560")
N = PUMA.n
PERIOD_S = 0.001
LINE = ("offset", "slope")


def noisy_line(seed: int, rows: int = 200) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """1 + 2 x in two classes, one ten times as rough as the other."""
    random = np.random.default_rng(seed)
    x, row_class = random.uniform(-1.0, 1.0, rows), np.arange(rows) % 2
    return (
        np.column_stack([np.ones(rows), x]),
        1.0 + 2.0 * x + random.normal(0.0, [0.1, 1.0], (rows // 2, 2)).ravel(),
        row_class,
    )


def line_fit(seed: int) -> Fit:
    return fit_linear(*noisy_line(seed), LINE)


def test_intervals_hold_the_truth_19_times_in_20() -> None:
    hits = [np.abs(fit.values - [1.0, 2.0]) < fit.half_width for fit in map(line_fit, range(200))]
    assert 0.91 < np.mean(hits) < 0.99


def test_the_rougher_class_is_found_and_counts_less() -> None:
    fits = [line_fit(seed) for seed in range(20)]
    np.testing.assert_allclose(np.mean([fit.scatter for fit in fits], axis=0), [0.1, 1.0], rtol=0.1)
    assert max(fit.half_width.max() for fit in fits) < 2.2 * 1.96 * 0.1 / np.sqrt(100 / 3)


def test_one_row_in_twenty_may_be_wild() -> None:
    A, b, row_class = noisy_line(3)
    wild = np.arange(0, b.size, 20)
    b[wild] += 50.0
    fit = fit_linear(A, b, row_class, LINE)
    np.testing.assert_allclose(fit.values, [1.0, 2.0], atol=0.1)
    assert set(wild) <= set(fit.outliers)
    assert fit.outliers.size < 1.5 * wild.size


def test_rows_in_doubt_count_less_and_the_intervals_know_it() -> None:
    random, hits = np.random.default_rng(4), []
    x = random.uniform(-1.0, 1.0, 100)
    A, doubt = np.column_stack([np.ones(100), x]), np.where(np.arange(100) % 2, 0.0, 2.0)
    for _ in range(100):
        b = 1.0 + 2.0 * x + random.normal(0.0, np.hypot(0.1, doubt))
        fit = fit_linear(A, b, np.zeros(100, np.int64), LINE, doubt)
        hits.append(np.abs(fit.values - [1.0, 2.0]) < fit.half_width)
        assert fit.scatter[0] == pytest.approx(0.1, rel=0.5)
    assert 0.88 < np.mean(hits) < 0.99


@pytest.mark.parametrize(
    ("A", "complaint"),
    [
        (np.ones((1, 2)), "1 observations for 2 parameters"),
        (np.ones((9, 2)), "cannot tell offset, slope apart"),
        (np.outer(np.arange(9.0), [1.0, 0.0]), "nothing recorded moves slope"),
    ],
)
def test_what_is_not_determined_is_named(A: np.ndarray, complaint: str) -> None:
    with pytest.raises(IdentificationError, match=complaint):
        fit_linear(A, np.ones(len(A)), np.zeros(len(A), np.int64), LINE)


def test_the_columns_of_friction_are_the_servos_friction() -> None:
    random = np.random.default_rng(1)
    viscous, positive, negative, transition = random.uniform(0.1, 2.0, (4, N))
    rates = np.concatenate([random.normal(size=(20, N)), np.zeros((1, N))])
    columns, tau = friction_columns(rates, transition), np.zeros(N)
    for rate, row in zip(rates, columns, strict=True):
        friction_torque(rate, FrictionParams(viscous, positive, negative, transition), tau)
        np.testing.assert_allclose((row * np.column_stack([viscous, positive, negative])).sum(axis=1), tau, atol=1e-14)


def test_without_noise_everything_comes_back() -> None:
    regressor, base = puma_base()
    beta, friction = drawn(0)
    found = identify(PUMA, base, regressor, generated(beta, friction, 0.0, 0))
    np.testing.assert_allclose(found.beta, beta, atol=1e-9)
    np.testing.assert_allclose(found.friction, friction, atol=1e-9)
    assert found.held_back_rms.max() < 1e-9 < found.before_rms.min()


def test_intervals_of_an_arm_hold_the_truth_9_times_in_10() -> None:
    regressor, base = puma_base()
    hits = []
    for seed in range(6):
        beta, friction = drawn(seed)
        found = identify(PUMA, base, regressor, generated(beta, friction, 0.05, seed))
        truth = [*beta, *friction.ravel(), *np.ones(N - 1), *np.zeros(3 * N)]
        hits += [abs(value.value - true) < value.half_width for value, true in zip(found.values, truth, strict=True)]
    assert np.mean(hits) > 0.9


def test_values_have_names_units_and_what_the_file_says() -> None:
    regressor, base = puma_base()
    values = {v.name: v for v in identify(PUMA, base, regressor, generated(*drawn(1), 0.05, 1)).values}
    assert values["hx2"].unit == "kg m"
    assert values["hx2"].meaning.startswith("hx2 + 0.4318 m3")
    assert (values["elbow.viscous"].unit, values["elbow.viscous"].before) == ("N m/(rad/s)", 3.980)
    assert values["hx2"].before == pytest.approx(37.235 / 9.81, rel=1e-3)


def test_one_direction_only_is_not_enough() -> None:
    regressor, base = puma_base()
    observations = generated(*drawn(1), 0.05, 1)
    with pytest.raises(IdentificationError, match=r"waist\.coulomb_neg"):
        identify(PUMA, base, regressor, observations.only(observations.rate > 0.0))


def test_a_log_without_steady_motion_is_refused() -> None:
    regressor, base = puma_base()
    nothing = Observer(PUMA, regressor, base).observe(tracked(50), PERIOD_S)
    with pytest.raises(IdentificationError, match="nothing recorded moves steadily"):
        identify(PUMA, base, regressor, nothing)


def tracked(count: int) -> np.ndarray:
    """Rows of an arm at park, the shoulder turning at a tenth of a radian per second."""
    rows = TelemetryLayout(N).empty(count)
    rows["tick"], rows["mode"], rows["dac"] = np.arange(count), Mode.TRACKING, 2048
    rows["q"] = PUMA.poses["park"]
    rows["v_ref"][:, 1] = 0.1
    rows["q"][:, 1] += 0.1 * PERIOD_S * np.arange(count)
    return rows


def lengths(rows: np.ndarray) -> list[int]:
    return [p.stop - p.start for p in steady_passes(rows, PERIOD_S)]


def test_a_pass_is_what_neither_accelerates_nor_stands_less_its_beginning() -> None:
    rows = tracked(2000)
    rows["a_ref"][800:1000, 4] = 1.0
    rows["v_ref"][1500:] = 0.0
    assert lengths(rows) == [600, 300]


@pytest.mark.parametrize("field", ["dac", "flags", "tick", "mode"])
def test_a_saturated_torque_a_missed_frame_and_lost_rows_end_a_pass(field: str) -> None:
    rows = tracked(2000)
    bad = {"dac": 4095, "flags": 1 << 16, "tick": 5000, "mode": Mode.HOLDING}
    rows[field][1000] = bad[field]
    assert all(p.stop <= 1000 or p.start > 1000 for p in steady_passes(rows, PERIOD_S))
    assert len(lengths(rows)) == 2


def test_what_a_hand_leads_is_no_pass_at_the_wall_before_the_end_of_the_range_either() -> None:
    rows = tracked(2000)
    rows["q_ref"] = rows["q"]
    rows["v"][:, 1], rows["v_ref"][:, 1] = 0.1, 0.09
    assert lengths(rows) == []
    rows["q_ref"][:, 1] = rows["q"][-1, 1]
    assert lengths(rows) == []


def test_an_observation_is_the_mean_torque_of_a_motor_that_turns() -> None:
    regressor, base = puma_base()
    rows = tracked(1000)
    rows["dac"][:, 1] = 2048 + 100 + np.resize([-1, 1], 1000)
    observed = Observer(PUMA, regressor, base).observe(rows, PERIOD_S)
    assert (observed.motor.tolist(), observed.rate.tolist()) == ([1], [pytest.approx(0.1)])
    assert observed.torque[0] == pytest.approx(100 / PUMA.transmission.dac_per_Nm[1], abs=1e-3)
    middle = rows["q"][200:].mean(axis=0)
    np.testing.assert_allclose(observed.gravity[0], base.columns(regressor(middle[None]))[0, 1], rtol=1e-3)


def test_the_speed_of_an_observation_is_the_measured_one() -> None:
    """An arm whose friction is not known lags behind its setpoints by what changes along the way."""
    regressor, base = puma_base()
    rows = tracked(1000)
    rows["q"][:, 1] += 0.01 * PERIOD_S * np.arange(1000)
    observed = Observer(PUMA, regressor, base).observe(rows, PERIOD_S)
    assert observed.rate[0] == pytest.approx(0.11)
