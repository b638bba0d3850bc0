"""How long a motion lasts whose transition time the program leaves open, beside the least time there could be.

With s from 0 to 1 on the straight way of all joints, of speed V and acceleration A of the joint that limits each, a
motion of cruising speed v whose transitions last k v / A takes 1 / v + k v / A, as long as 1 / v >= k v / A. So the
least is reached by v = min(V, sqrt(A / k)). A trapezoid of speed has k = 1, Paul's quartic k = 1.5.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
import pytest

from qrobot.motion import MoveRequest, SpeedShare
from qrobot.motion.blend import PEAK, Blend
from tests.support.motion import run
from tests.support.puma import LIMITS, PARK, PERIOD_S, puma_generator

MOVES = 40


def least_s(way: np.ndarray, k: float, a: np.ndarray) -> float:
    """Of a motion from rest to rest."""
    speed, acceleration = (LIMITS.v_max / np.abs(way)).min(), (a / np.abs(way)).min()
    v = min(speed, sqrt(acceleration / k))
    return 1.0 / v + k * v / acceleration


def ratios(size: float, period_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Time taken over the least with the planned acceleration and a quartic, and over that of a trapezoid at full."""
    rng, found = np.random.default_rng(13), []
    for _ in range(MOVES):
        start, end = rng.uniform(LIMITS.q_min, LIMITS.q_max, (2, LIMITS.n))
        way = size * (end - start)
        gen = puma_generator(start, period_s)
        gen.push(MoveRequest("there", start + way, SpeedShare(1.0)))
        taken_s = period_s * (sum(1 for _ in run(gen)) - 1)
        quartic = least_s(way, PEAK[Blend.QUARTIC], LIMITS.a_planned)
        found.append((taken_s / quartic, taken_s / least_s(way, 1.0, LIMITS.a_max)))
    own, any_ = np.array(found).T
    return own, any_


@pytest.mark.parametrize(
    ("size", "middle", "trapezoid"), [(1.0, 1.10, 1.16), (0.3, 1.10, 1.20), (0.1, 1.10, 1.35), (0.05, 1.12, 1.45)]
)
@pytest.mark.parametrize("period_s", [0.007, PERIOD_S])
def test_a_motion_at_full_speed_lasts_little_longer_than_the_least_time(size, middle, trapezoid, period_s) -> None:
    own, any_ = ratios(size, period_s)
    assert own.min() >= 1.0 - 1e-9
    assert np.median(own) <= middle
    assert own.max() <= 1.5
    assert np.median(any_) <= trapezoid


def test_a_slow_motion_takes_a_seventh_of_its_way_to_gather_speed_and_at_most_the_papers_time() -> None:
    for length_s, ta_s in ((0.7, 0.1), (1.4, 0.2), (5.6, 0.2)):
        gen = puma_generator(period_s=0.001)
        way = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
        gen.push(MoveRequest("there", PARK + way, SpeedShare(0.05 / length_s / LIMITS.v_max[0])))
        assert 0.001 * (sum(1 for _ in run(gen)) - 1) == pytest.approx(length_s + 2 * ta_s, abs=0.003)


def test_a_time_that_is_given_is_kept_however_short_the_way() -> None:
    gen = puma_generator()
    gen.push(MoveRequest("there", PARK + 0.001, SpeedShare(1.0), 0.28))
    assert sum(1 for _ in run(gen)) == 1 + 4 * 10
