"""Torques with gravity, inertia and friction taken out (B-06)."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.model.dynamics import dynamics_params, dynamics_work, inverse_dynamics
from qrobot.model.stiction_compensation import PUSH_SHARE, REST_SHARE
from qrobot.motion.force.external_torque import MOVING_SHARE, ArmSample, DriveFriction, ExternalTorque
from tests.support.puma import PARK, PERIOD_S, ROBOT

N = ROBOT.n
STILL = np.zeros(N)
PUSH = np.array([5.0, -12.0, 3.0, 0.4, -0.2, 0.1])
SPEED = np.array([0.1, -0.2, 0.15, 0.3, -0.1, 0.2])


def carried(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    tau = np.empty(N)
    inverse_dynamics(q, v, STILL, dynamics_params(ROBOT), dynamics_work(N), tau)
    return tau


def test_at_rest_what_gravity_does_not_explain_is_exerted() -> None:
    estimate = ExternalTorque(ROBOT, PERIOD_S)
    assert estimate.estimate() is None
    estimate.observe(ArmSample(PARK, STILL, carried(PARK, STILL) + PUSH, PARK), 1)
    found = estimate.estimate()
    assert found is not None
    assert found.torque == pytest.approx(PUSH)


def test_in_motion_friction_and_rigid_body_torques_are_taken_out() -> None:
    estimate, friction = ExternalTorque(ROBOT, PERIOD_S), DriveFriction(ROBOT)
    for tick in range(1, 7):
        q = PARK + SPEED * tick * PERIOD_S
        tau = carried(q, SPEED) + friction.torque(SPEED) + PUSH
        estimate.observe(ArmSample(q, SPEED, tau, q), tick)
    found = estimate.estimate()
    assert found is not None
    assert found.torque == pytest.approx(PUSH, abs=1e-9)


def test_a_standing_joint_may_hide_all_its_stiction_and_a_moving_one_a_share_of_its_friction() -> None:
    friction = DriveFriction(ROBOT)
    standing, moving = friction.uncertainty(STILL), friction.uncertainty(SPEED)
    largest = np.maximum(ROBOT.friction["corke"].coulomb_pos, ROBOT.friction["corke"].coulomb_neg)
    assert standing[:3] == pytest.approx(ROBOT.friction["corke"].stiction_factor * largest[:3])
    assert moving[:3] == pytest.approx(MOVING_SHARE * np.abs(friction.torque(SPEED))[:3])


def test_a_setpoint_and_what_the_servo_adds_to_a_joint_that_stands_are_the_torque_wanted() -> None:
    friction, total = DriveFriction(ROBOT), np.array([30.0, -20.0, 3.0, 1.5, -0.4, 0.05])
    setpoint = friction.setpoint(total, STILL)
    assert setpoint + friction.added(setpoint) == pytest.approx(total)


def test_a_joint_that_moves_gets_its_friction_whatever_its_setpoint() -> None:
    friction, total = DriveFriction(ROBOT), np.array([30.0, -20.0, 3.0, 0.0, 0.0, 0.0])
    v = ROBOT.control.friction_velocity
    assert friction.setpoint(total, 2.0 * v) == pytest.approx(total)
    half = 0.5 * (friction.setpoint(total, STILL) + total)
    assert friction.setpoint(total, 0.5 * v)[:3] == pytest.approx(half[:3])


def test_a_joint_that_is_to_move_by_its_plan_is_told_the_way_as_long_as_it_stands() -> None:
    friction, v = DriveFriction(ROBOT), ROBOT.control.friction_velocity
    preset = ROBOT.friction["corke"]
    hint = friction.hint(STILL, 2.0 * v)
    assert hint[:3] == pytest.approx(PUSH_SHARE * preset.coulomb_pos[:3])
    assert friction.added(hint)[:3] == pytest.approx(REST_SHARE * preset.coulomb_pos[:3])
    assert friction.hint(STILL, -0.5 * v)[:3] == pytest.approx(-0.75 * PUSH_SHARE * preset.coulomb_neg[:3])
    assert friction.hint(v, v)[:3] == pytest.approx(np.zeros(3))
    assert friction.hint(STILL, STILL) == pytest.approx(np.zeros(N))
