"""Recordings of a hand: smoothed within a tolerance, within the arm's limits, joined at rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.errors import ConfigError, MotionError
from qrobot.model.arm import Arm
from qrobot.motion import motion_limits
from qrobot.rccl.recordings import joined, smoothed, trimmed
from qrobot.rccl.setpoints import Setpoints

ROBOT = load_robot("puma560")
ARM, LIMITS, N = Arm(ROBOT), motion_limits(ROBOT), ROBOT.n
PERIOD_US = 28_000
START = np.array(ROBOT.poses["park"])


def by_hand(seed: int, seconds: float = 3.0, tremble: float = 2e-3, idle: int = 20) -> Setpoints:
    """An arm that is led and trembles at 4 to 9 Hz, at rest for `idle` samples before and after."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, seconds, round(seconds * 1e6 / PERIOD_US))
    s = t / seconds
    way = np.concatenate((rng.uniform(-0.4, 0.4, 3), rng.uniform(-0.8, 0.8, 3)))
    q = START + np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, way)
    for hertz in (4.0, 6.5, 9.0):
        q += np.outer(np.sin(np.pi * s) * np.sin(2 * np.pi * hertz * t), rng.uniform(-tremble, tremble, N))
    return Setpoints("puma560", PERIOD_US, np.concatenate((np.tile(q[0], (idle, 1)), q, np.tile(q[-1], (idle, 1)))))


def roughness(q: np.ndarray) -> float:
    return float(np.abs(np.diff(q, 3, axis=0)).max())


def test_an_arm_that_was_hardly_led_and_came_back_is_told_like_one_that_stood_still() -> None:
    q = np.tile(START, (3, 1))
    q[:, 0] += [0.0, 1.2e-3, 0.6e-3]
    with pytest.raises(MotionError, match="the arm stands still"):
        trimmed(Setpoints("puma560", PERIOD_US, q))


@pytest.mark.parametrize("tolerance", [1e-3, 5e-3, 20e-3])
def test_a_smoothed_recording_stays_within_its_tolerance_and_the_limits(tolerance: float) -> None:
    led = by_hand(1, seconds=6.0)
    found = smoothed(led, ROBOT, tolerance)
    found.check(LIMITS, "found")
    assert found.q[0] == pytest.approx(led.q[0], abs=1e-12)
    assert found.q[-1] == pytest.approx(led.q[-1], abs=1e-12)
    assert roughness(found.q) < roughness(led.q)
    count = len(led.q)
    instants = np.linspace(0.0, count - 1.0, 20 * count)
    dense = np.stack([np.interp(instants, np.arange(count), column) for column in led.q.T], axis=1)
    path = np.array([ARM.flange(q)[:3, 3] for q in dense])
    for q in found.q[::7]:
        assert np.linalg.norm(path - ARM.flange(q)[:3, 3], axis=1).min() <= tolerance + 1e-4


def test_more_tolerance_is_smoother() -> None:
    led = by_hand(2, seconds=6.0)
    rough = [roughness(smoothed(led, ROBOT, tolerance).q) for tolerance in (0.5e-3, 2e-3, 10e-3)]
    assert rough[0] > 1.5 * rough[1] > 2.0 * rough[2]


def test_what_was_led_too_fast_is_slowed_down() -> None:
    fast = by_hand(3, seconds=0.3, tremble=0.0)
    with pytest.raises(MotionError, match="too much of this arm"):
        fast.check(LIMITS, "fast")
    found = smoothed(fast, ROBOT, 2e-3)
    found.check(LIMITS, "found")
    assert len(found.q) > len(trimmed(fast).q)


def test_recordings_are_joined_at_rest_and_the_whole_can_be_played() -> None:
    first, second = smoothed(by_hand(4), ROBOT, 5e-3), smoothed(by_hand(5), ROBOT, 5e-3)
    whole = joined([first, second, second], ROBOT)
    whole.check(LIMITS, "whole")
    assert np.array_equal(whole.q[: len(first.q)], first.q)
    assert np.array_equal(whole.q[-len(second.q) :], second.q)
    between = whole.q[len(first.q) - 1 : len(whole.q) - 2 * len(second.q)]
    assert (np.abs(np.diff(between, axis=0)) <= 0.26 * LIMITS.v_max * 0.028).all()
    assert len(joined([first, first][:1], ROBOT).q) == len(first.q)


def test_what_cannot_be_smoothed_or_joined_is_refused() -> None:
    still = Setpoints("puma560", PERIOD_US, np.tile(START, (30, 1)))
    with pytest.raises(MotionError, match="stands still"):
        smoothed(still, ROBOT, 1e-3)
    for tolerance in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ConfigError, match="tolerance of"):
            smoothed(by_hand(6), ROBOT, tolerance)
    with pytest.raises(ConfigError, match="nothing to join"):
        joined([], ROBOT)
    with pytest.raises(ConfigError, match="one sample period"):
        joined([still, Setpoints("puma560", 14_000, still.q)], ROBOT)


def test_the_recording_of_another_robot_is_neither_smoothed_nor_joined() -> None:
    led = replace(by_hand(7), robot="stanford")
    with pytest.raises(ConfigError, match="made for stanford, this is puma560"):
        smoothed(led, ROBOT, 5e-3)
    with pytest.raises(ConfigError, match="made for stanford, this is puma560"):
        joined([led, led], ROBOT)
