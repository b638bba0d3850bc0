"""Velocity from positions: the estimators against their definitions, and sane on stalls, glitches and new boards."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.arrays import Floats
from qrobot.config.deployment import ServoChoice, Velocity
from qrobot.errors import ConfigError
from qrobot.modecodes import Mode
from qrobot.servo.kernels.velocity import (
    DEFAULT_ESTIMATOR,
    ESTIMATORS,
    REST,
    STALE,
    difference,
    find_estimator,
    observe,
    start_observer,
)
from tests.support.servo_bench import ServoBench, cruise, moving, play

DT = 1e-3
W = 2.0 * np.pi * 20.0
JUMP_COUNTS = 9000


class Observer:
    """One observer of one joint, fed sample by sample."""

    def __init__(self, q: float = 0.0, bandwidth: float = W) -> None:
        self.bandwidth = bandwidth
        self.x, self.v, self.d, self.q = np.zeros((4, 1))
        self.q[0] = q
        start_observer(self.q, self.x, self.v, self.d)

    def feed(self, q: float, push: float = 0.0, dt: float = DT) -> float:
        """The velocity after one more sample."""
        now = np.array([q])
        observe(now, self.q, np.array([push]), dt, self.bandwidth, self.x, self.v, self.d)
        self.q = now
        return float(self.v[0])


def fading_parabola(q: Floats, dt: float, bandwidth: float) -> float:
    """Oracle: slope now of the parabola through all samples, their squared misses weighted by exp(-w age)."""
    age = dt * np.arange(q.size)[::-1]
    return float(np.polyfit(-age, q, 2, w=np.exp(-0.5 * bandwidth * age))[1])


# ----------------------------------------------------------------------------------------------------------- kernels


def test_an_arm_that_has_come_to_rest_has_no_velocity_at_all_and_no_denormal_number_is_made_of_it() -> None:
    """1e-300 a second is no speed; numbers that small cost a hundred times the arithmetic."""
    q, v = np.zeros(1), np.array([1.0])
    observer = Observer()
    for k in range(50):
        observer.feed(1e-3 * k)
    seen = []
    for _ in range(4000):
        difference(q, q, DT, W, v)
        seen += [abs(v[0]), abs(observer.feed(1e-3 * 49)), abs(observer.d[0])]
    assert v[0] == observer.v[0] == observer.d[0] == 0.0
    assert all(value == 0.0 or value >= REST for value in seen)


@pytest.mark.parametrize("bandwidth", [60.0, W, 400.0])
def test_without_push_the_observer_is_the_fading_memory_fit_of_a_parabola(bandwidth: float) -> None:
    rng = np.random.default_rng(1)
    samples = np.cumsum(rng.normal(size=2000)) * 1e-3
    observer = Observer(samples[0], bandwidth)
    for q in samples[1:]:
        v = observer.feed(q)
    assert v == pytest.approx(fading_parabola(samples, DT, bandwidth), rel=1e-6)


def test_an_exact_model_leaves_no_error_whatever_the_acceleration() -> None:
    rng, observer = np.random.default_rng(2), Observer()
    q = v = 0.0
    for push in rng.normal(scale=50.0, size=500):
        q, v = q + v * DT + 0.5 * push * DT * DT, v + push * DT
        assert observer.feed(q, push) == pytest.approx(v, abs=1e-9)
    assert abs(observer.d[0]) < 1e-6


def test_what_the_model_does_not_know_is_found_as_unmodelled_acceleration() -> None:
    observer = Observer()
    for k in range(1, 1001):
        v = observer.feed(0.5 * 3.0 * (k * DT) ** 2, push=5.0)  # the torque promises 5, the arm does 3
    assert v == pytest.approx(3.0, abs=1e-3)
    assert observer.d[0] == pytest.approx(-2.0, abs=1e-2)


@given(st.lists(st.sampled_from([1, 1, 1, 2, 5, 7]), min_size=200, max_size=300), st.floats(-2.0, 2.0))
def test_constant_speed_is_known_exactly_however_irregular_the_samples(steps: list[int], speed: float) -> None:
    observer, t = Observer(), 0.0
    observer.v[0] = speed
    for step in steps:
        t += step * DT
        assert observer.feed(speed * t, dt=step * DT) == pytest.approx(speed, abs=1e-9)


def test_after_a_gap_longer_than_its_memory_the_observer_begins_anew() -> None:
    observer = Observer()
    observer.v[0], observer.d[0] = 2.0, 30.0
    gap = 1.01 * STALE / W
    assert observer.feed(0.1 * gap, dt=gap) == pytest.approx(0.1)
    assert (observer.x[0], observer.d[0]) == (pytest.approx(0.1 * gap), 0.0)


def test_the_difference_follows_a_step_of_speed_as_a_first_order_low_pass() -> None:
    v, bandwidth = np.zeros(1), 250.0
    for k in range(1, 21):
        difference(np.array([0.3 * k * DT]), np.array([0.3 * (k - 1) * DT]), DT, bandwidth, v)
        assert v[0] == pytest.approx(0.3 * (1.0 - np.exp(-bandwidth * k * DT)), rel=1e-9)


# --------------------------------------------------------------------------------------------------------- the choice


def test_an_unknown_estimator_is_refused_with_those_there_are() -> None:
    with pytest.raises(ConfigError, match="no velocity estimator 'kalman'; there are: difference, observer"):
        find_estimator("kalman")


def test_deployment_files_know_every_estimator_and_the_same_default() -> None:
    assert get_args(Velocity) == tuple(ESTIMATORS)
    assert ServoChoice().velocity == DEFAULT_ESTIMATOR


# ----------------------------------------------------------------------------------------------------- in the servo

both = pytest.mark.parametrize("velocity", ESTIMATORS)


def estimates(bench: ServoBench) -> Floats:
    return np.asarray(bench.rows()["v"])


@pytest.mark.sampled(2)
@both
@pytest.mark.parametrize("rate_hz", [1000.0, 4000.0])
def test_a_cruise_is_known_to_one_per_cent_and_rest_to_the_noise_of_a_count(velocity: str, rate_hz: float) -> None:
    bench = ServoBench(velocity=velocity, rate_hz=rate_hz)
    moving(bench, seconds=1.2)
    assert estimates(bench)[-100:, 0] == pytest.approx(0.5, rel=0.05)
    assert np.mean(estimates(bench)[-100:, 0]) == pytest.approx(0.5, rel=0.01)
    bench.mailbox.request_stop()
    bench.run(1.0)
    assert np.abs(estimates(bench)[-1]).max() < 1e-3


def ripple(velocity: str, rate_hz: float) -> float:
    bench = ServoBench(velocity=velocity, rate_hz=rate_hz)
    moving(bench, speed=0.137, seconds=1.2)
    return float(np.std(estimates(bench)[-round(0.2 * rate_hz) :, 0]))


@pytest.mark.parametrize(("rate_hz", "factor"), [(1000.0, 3.0), (4000.0, 8.0)])
def test_the_observer_is_far_quieter_and_the_more_so_the_faster_the_servo(rate_hz: float, factor: float) -> None:
    assert factor * ripple("observer", rate_hz) < ripple("difference", rate_hz)


@both
def test_a_stalled_servo_shows_no_false_speed(velocity: str) -> None:
    bench = ServoBench(velocity=velocity)
    moving(bench, seconds=1.0)
    for missed in (1, 3, 12):
        bench.skip(missed)
        bench.q = bench.q + np.eye(6)[0] * 0.5 * missed * 1e-3  # the arm went on
        bench.tick()
        assert estimates(bench)[-1, 0] == pytest.approx(0.5, rel=0.1)
        bench.run(0.2)


@both
def test_a_glitch_held_back_does_not_show_in_the_velocity(velocity: str) -> None:
    bench = ServoBench(velocity=velocity)
    moving(bench, seconds=1.0)
    before = len(bench.rows())
    bench.slip = {0: JUMP_COUNTS}
    bench.tick(2)
    bench.slip = {}
    bench.tick(50)
    assert bench.mode is Mode.TRACKING
    assert np.abs(estimates(bench)[before:, 0] - 0.5).max() < 0.03


@both
def test_a_board_that_comes_back_elsewhere_shows_no_speed(velocity: str) -> None:
    bench = ServoBench(velocity=velocity)
    bench.tick(5)
    bench.frozen = True
    bench.tick(30)
    bench.frozen = False
    bench.q = bench.q + 0.3
    bench.tick(20)
    assert not estimates(bench)[-20:].any()


def test_the_observer_knows_the_torque_it_gives_but_none_where_it_gives_none() -> None:
    bench = ServoBench(velocity="observer")
    bench.tick(10)
    bench.state.tau[:] = 40.0  # left over from an earlier life
    bench.tick(1)
    assert not estimates(bench).any()
    bench.hold()
    bench.follows = False
    play(bench, cruise(bench.q, np.eye(6)[0] * 0.2))
    bench.run(0.2)
    assert bench.mode is Mode.TRACKING
    assert estimates(bench)[-1, 0] > 0.002  # the encoder stands still, the torque grows
    assert bench.state.unmodelled[0] < -0.1
