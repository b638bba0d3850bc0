"""The model of the original servo boards: slower than the servo, without a model of the arm, exact at rest."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.servo.laws.law import MEMORY_WORDS
from qrobot.servo.laws.shipped import find_law
from tests.unit.servo.test_law import call

ROBOT = load_robot("puma560")
LAW = find_law("unimation", ROBOT)
GAINS = np.array([[100.0, 200.0], [10.0, 20.0], [1.0, 1.0]])
STILL = np.zeros(2)


def test_between_two_cycles_of_the_boards_the_torque_stays() -> None:
    memory = np.zeros(MEMORY_WORDS)
    outputs = []
    for k in range(41):  # 4 kHz: the boards run every 3.696 cycles
        q_ref = np.full(2, 0.1 + 1e-3 * k)
        outputs.append(call(LAW, q_ref=q_ref, v_ref=np.ones(2), q=STILL, gains=GAINS, memory=memory, dt=0.00025)[0])
    runs = 1 + np.count_nonzero(np.diff(outputs))
    assert runs == 1 + int(41 * 0.00025 / 924e-6)
    assert outputs[0] == pytest.approx(100.0 * 0.1 + 10.0)


def test_while_moving_it_is_pd_without_a_model() -> None:
    tau = call(
        LAW, q_ref=STILL + 0.01, v_ref=STILL + 0.5, q=STILL, v=STILL + 0.4, gains=GAINS, gravity=STILL + 50.0,
        friction=STILL + 5.0,
    )  # fmt: skip
    np.testing.assert_allclose(tau, GAINS[0] * 0.01 + GAINS[1] * 0.1)


def test_at_rest_near_the_target_the_error_is_integrated_up_to_a_bound() -> None:
    memory = np.zeros(MEMORY_WORDS)
    first = call(LAW, q_ref=STILL + 0.01, q=STILL, gains=GAINS, memory=memory)
    for _ in range(1000):
        last = call(LAW, q_ref=STILL + 0.01, q=STILL, gains=GAINS, memory=memory)
    np.testing.assert_allclose(last, GAINS[0] * (0.01 + LAW.chosen["share"]))
    assert np.all(last > first)


def test_far_from_the_target_nothing_is_integrated() -> None:
    memory = np.zeros(MEMORY_WORDS)
    for _ in range(100):
        tau = call(LAW, q_ref=STILL + 0.05, q=STILL, gains=GAINS, memory=memory)
    np.testing.assert_allclose(tau, GAINS[0] * 0.05)


def test_it_fits_as_many_joints_as_a_servo_has() -> None:
    n = 8
    gains, q = np.ones((3, n)), np.zeros(n)
    memory = np.zeros(MEMORY_WORDS)
    for _ in range(3):
        assert np.isfinite(call(LAW, q_ref=q + 0.01, q=q, gains=gains, memory=memory)).all()
    assert 1 + 2 * n <= MEMORY_WORDS
