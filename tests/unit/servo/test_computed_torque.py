"""Computed torque is inverse dynamics, and makes the arm a row of independent oscillators."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.model.dynamics import dynamics_params, dynamics_work, inverse_dynamics
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.laws.law import KP, KV, M0, Law
from qrobot.servo.laws.shipped import find_law
from tests.support.thorough import examples
from tests.unit.servo.test_law import call

ROBOT = load_robot("puma560")
LAW = find_law("computed-torque", ROBOT)
GAINS = np.array([ROBOT.control.kp, ROBOT.control.kv, ROBOT.control.inertia])
angles = st.lists(st.floats(-3, 3), min_size=6, max_size=6).map(np.array)


def dynamics(q, v, a) -> np.ndarray:
    tau = np.zeros(6)
    inverse_dynamics(q, v, a, dynamics_params(ROBOT), dynamics_work(6), tau)
    return tau


@settings(max_examples=examples(50))
@given(angles, angles, angles, angles)
def test_without_an_error_it_is_inverse_dynamics_and_friction(q, v, a, friction) -> None:
    tau = call(LAW, q_ref=q, q=q, v_ref=v, v=v, a_ref=a, friction=friction, gains=GAINS)
    np.testing.assert_allclose(tau, dynamics(q, v, a) + friction, rtol=1e-9, atol=1e-9)


@settings(max_examples=examples(50))
@given(angles, angles, angles, angles)
def test_an_error_asks_for_the_acceleration_of_a_decoupled_oscillator(q, v, error, rate) -> None:
    error, rate = 1e-3 * error, 1e-2 * rate
    tau = call(LAW, q_ref=q + error, q=q, v_ref=v + rate, v=v, gains=GAINS)
    wanted = (GAINS[KP] * error + GAINS[KV] * rate) / GAINS[M0]
    np.testing.assert_allclose(tau, dynamics(q, v, wanted), rtol=1e-6, atol=1e-6)


def test_gravity_is_carried_whatever_the_servo_offers() -> None:
    q = np.array(ROBOT.poses["end"])
    tau = call(LAW, q_ref=q, q=q, gravity=np.zeros(6), gains=GAINS)
    np.testing.assert_allclose(tau, dynamics(q, np.zeros(6), np.zeros(6)), atol=1e-9)


def test_another_robot_has_a_law_of_its_own() -> None:
    stanford = load_robot("stanford")
    law = find_law("computed-torque", stanford)
    q = np.array(next(iter(stanford.poses.values())))
    gains = np.array([stanford.control.kp, stanford.control.kv, stanford.control.inertia])
    tau, work = np.zeros(stanford.n), dynamics_work(stanford.n)
    inverse_dynamics(q, np.zeros(stanford.n), np.zeros(stanford.n), dynamics_params(stanford), work, tau)
    np.testing.assert_allclose(call(law, q_ref=q, q=q, gains=gains), tau, atol=1e-9)


def test_another_process_finds_its_machine_code() -> None:
    assert LAW.address
    body: Any = lean_kernel(LAW.body.py_func)  # type: ignore[attr-defined]
    assert Law(body).address
    assert sum(body.stats.cache_hits.values()) == 1
