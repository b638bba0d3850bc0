"""How long a motion lasts whose transition time the program leaves open, beside the least time there could be.

With s from 0 to 1 on the straight way of all joints, of speed V and acceleration A of the joint that limits each, a
motion of cruising speed v whose transitions last k v / A takes 1 / v + k v / A, as long as 1 / v >= k v / A. So the
least is reached by v = min(V, sqrt(A / k)). A trapezoid of speed has k = 1, Paul's quartic k = 1.5.

A in an open transition is not what the joints could: it is that of 0.4 s to full speed, which an arm follows that
carries a load nobody told of (`test_motor_campaign`).
"""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from qrobot.motion import ForceLimits, MoveRequest, SpeedShare
from qrobot.motion.path.blend import PEAK, Blend
from tests.support.motion import run
from tests.support.puma import LIMITS, PARK, PERIOD_S, puma_generator

MOVES = 40
OPEN_ACCELERATION = np.minimum(PEAK[Blend.QUARTIC] * LIMITS.v_max / 0.4, LIMITS.a_planned)


def least_s(way: np.ndarray, k: float, a: np.ndarray) -> float:
    """Of a motion from rest to rest."""
    speed, acceleration = (LIMITS.v_max / np.abs(way)).min(), (a / np.abs(way)).min()
    v = min(speed, sqrt(acceleration / k))
    return 1.0 / v + k * v / acceleration


def ratios(size: float, period_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Time taken over the least of a quartic with an open transition's acceleration, and of a trapezoid at full."""
    rng, found = np.random.default_rng(13), []
    for _ in range(MOVES):
        start, end = rng.uniform(LIMITS.q_min, LIMITS.q_max, (2, LIMITS.n))
        way = size * (end - start)
        gen = puma_generator(start, period_s)
        gen.push(MoveRequest("there", start + way, SpeedShare(1.0)))
        taken_s = period_s * (sum(1 for _ in run(gen)) - 1)
        quartic = least_s(way, PEAK[Blend.QUARTIC], OPEN_ACCELERATION)
        found.append((taken_s / quartic, taken_s / least_s(way, 1.0, LIMITS.a_max)))
    own, any_ = np.array(found).T
    return own, any_


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("size", "trapezoid"), [(1.0, 1.16), (0.3, 1.45), (0.1, 1.95), (0.05, 2.10)])
@pytest.mark.parametrize("period_s", [0.007, PERIOD_S])
def test_a_motion_at_full_speed_lasts_little_longer_than_the_least_time(size, trapezoid, period_s) -> None:
    own, any_ = ratios(size, period_s)
    assert own.min() >= 0.99  # 0.2 s are 7 samples of 28 ms, a little less
    assert np.median(own) <= 1.06
    assert own.max() <= 1.16
    assert np.median(any_) <= trapezoid


def test_a_slow_motion_takes_a_seventh_of_its_way_to_gather_speed_and_at_most_the_papers_time() -> None:
    for length_s, ta_s in ((0.7, 0.1), (1.4, 0.2), (5.6, 0.2)):
        gen = puma_generator(period_s=0.001)
        way = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
        gen.push(MoveRequest("there", PARK + way, SpeedShare(0.05 / length_s / LIMITS.v_max[0])))
        assert 0.001 * (sum(1 for _ in run(gen)) - 1) == pytest.approx(length_s + 2 * ta_s, abs=0.003)


@pytest.mark.parametrize("size", [1.0, 0.3, 0.1, 0.03, 0.01])
def test_an_open_transition_is_no_harder_than_that_of_200_ms_to_full_speed(size) -> None:
    rng = np.random.default_rng(7)
    for _ in range(10):
        start, end = rng.uniform(LIMITS.q_min, LIMITS.q_max, (2, LIMITS.n))
        gen = puma_generator(start, 0.007)
        gen.push(MoveRequest("there", start + size * (end - start), SpeedShare(1.0)))
        path = np.array([start, *(output.q for output in run(gen))])
        acceleration = np.diff(path, 2, axis=0) / 0.007**2
        assert np.all(np.abs(acceleration) <= 1.05 * OPEN_ACCELERATION)  # 0.2 s are 29 samples


@pytest.mark.parametrize("limits", [None, ForceLimits(force=np.full(6, 60.0))])
def test_a_motion_to_where_the_arm_is_or_that_a_force_may_end_takes_the_papers_time(limits) -> None:
    way = 0.0005 if limits is None else 0.005
    gen = puma_generator()
    gen.push(MoveRequest("there", PARK + way, SpeedShare(1.0), limits=limits))
    assert sum(1 for _ in run(gen)) == 1 + 4 * 7


def test_a_time_that_is_given_is_kept_however_short_the_way() -> None:
    gen = puma_generator()
    gen.push(MoveRequest("there", PARK + 0.001, SpeedShare(1.0), 0.28))
    assert sum(1 for _ in run(gen)) == 1 + 4 * 10
