"""Torques with gravity, inertia and friction taken out (B-06)."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.model.dynamics import dynamics_params, dynamics_work, inverse_dynamics
from qrobot.motion.external import MOVING_SHARE, ExternalTorque, Friction, Seen
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
    estimate.look(Seen(PARK, STILL, carried(PARK, STILL) + PUSH, PARK), 1)
    found = estimate.estimate()
    assert found is not None
    assert found.torque == pytest.approx(PUSH)


def test_in_motion_friction_and_rigid_body_torques_are_taken_out() -> None:
    estimate, friction = ExternalTorque(ROBOT, PERIOD_S), Friction(ROBOT)
    for tick in range(1, 7):
        q = PARK + SPEED * tick * PERIOD_S
        tau = carried(q, SPEED) + friction.torque(SPEED) + PUSH
        estimate.look(Seen(q, SPEED, tau, q), tick)
    found = estimate.estimate()
    assert found is not None
    assert found.torque == pytest.approx(PUSH, abs=1e-9)


def test_a_standing_joint_may_hide_all_its_stiction_and_a_moving_one_a_share_of_its_friction() -> None:
    friction = Friction(ROBOT)
    standing, moving = friction.uncertainty(STILL), friction.uncertainty(SPEED)
    largest = np.maximum(ROBOT.friction["corke"].coulomb_pos, ROBOT.friction["corke"].coulomb_neg)
    assert standing[:3] == pytest.approx(ROBOT.friction["corke"].stiction_factor * largest[:3])
    assert moving[:3] == pytest.approx(MOVING_SHARE * np.abs(friction.torque(SPEED))[:3])


def test_break_away_torque_fades_as_the_servos_own_compensation_comes_up() -> None:
    friction, push = Friction(ROBOT), np.array([30.0, -30.0, 30.0, 0.0, 0.0, 0.0])
    at_rest = friction.breakaway(STILL, STILL, push)
    preset = ROBOT.friction["corke"]
    assert at_rest[:3] == pytest.approx([preset.coulomb_pos[0], -preset.coulomb_neg[1], preset.coulomb_pos[2]])
    v = ROBOT.control.friction_velocity
    assert friction.breakaway(0.5 * v, STILL, push)[:3] == pytest.approx(0.5 * at_rest[:3])
    assert friction.breakaway(2.0 * v, STILL, push)[:3] == pytest.approx(np.zeros(3))


def test_break_away_torque_goes_the_planned_way_and_vanishes_where_nothing_is_to_move() -> None:
    friction, v = Friction(ROBOT), ROBOT.control.friction_velocity
    preset = ROBOT.friction["corke"]
    assert friction.breakaway(STILL, 2.0 * v, STILL)[:3] == pytest.approx(preset.coulomb_pos[:3])
    assert friction.breakaway(STILL, -0.5 * v, STILL)[:3] == pytest.approx(-0.5 * preset.coulomb_neg[:3])
    assert friction.breakaway(STILL, STILL, STILL) == pytest.approx(np.zeros(N))
