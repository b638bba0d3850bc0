"""The momentum observer finds the torque nobody commanded, and nothing else."""

from __future__ import annotations

import math

import pytest

from qrobot.servo.checks.momentum_observer import observe_push

INERTIA, PACE = 2.0, 200.0


def observed(seconds: float, dt: float, drive: float, outside: float) -> float:
    """Push found after so long, from rest, on a joint moved by `drive` and by a torque `outside` that is not told."""
    v = expected = push = 0.0
    for _ in range(round(seconds / dt)):
        v += dt * (drive + outside) / INERTIA
        expected, push = observe_push(INERTIA * v, drive, dt, PACE, expected, push)
    return push


@pytest.mark.parametrize("dt", [1e-3, 0.25e-3])
@pytest.mark.parametrize("drive", [0.0, 30.0, -7.0])
def test_a_joint_that_does_what_its_torque_makes_it_do_is_not_pushed(dt: float, drive: float) -> None:
    assert observed(0.5, dt, drive, 0.0) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("dt", [1e-3, 0.25e-3])
@pytest.mark.parametrize("outside", [12.0, -3.0])
def test_a_push_is_found_whatever_the_motor_does(dt: float, outside: float) -> None:
    assert observed(0.1, dt, 30.0, outside) == pytest.approx(outside, rel=1e-6)
    assert observed(0.1, dt, -30.0, outside) == pytest.approx(outside, rel=1e-6)


def test_it_follows_as_a_low_pass_of_its_pace() -> None:
    dt = 1e-6
    assert observed(1.0 / PACE, dt, 0.0, 10.0) == pytest.approx(10.0 * (1.0 - math.exp(-1.0)), rel=1e-3)
