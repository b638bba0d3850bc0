"""A payload at run time: what an arm can carry, and how the servo goes over to it."""

from __future__ import annotations

from math import inf, nan

import numpy as np
import pytest

from qrobot.config import load_robot
from qrobot.model.dynamics import dynamics_params, dynamics_work, gravity_torque, inverse_dynamics, with_payload
from qrobot.model.payload_judge import HOLDING_SHARE, PayloadJudge
from qrobot.servo.laws.law import KP, KV, M0
from qrobot.servo.laws.shipped import find_law
from qrobot.servo.stages.payload import RAMP_S
from qrobot.wire import Payload
from tests.support.puma import ROBOT
from tests.support.servo_bench import ServoBench
from tests.unit.servo.test_law import call

JUDGE = PayloadJudge(ROBOT)
LOAD = Payload(2.0, (0.02, -0.01, 0.1))
AT = np.array([0.02, -0.01, 0.1 + ROBOT.geometry.flange_m])
BODY = np.array([2.0, *(2.0 * AT), *np.zeros(6)])
BODY[4:] = with_payload(dynamics_params(ROBOT), 2.0, AT).inertia[-1] - dynamics_params(ROBOT).inertia[-1]


def weight(q: np.ndarray, mass: float, at: np.ndarray) -> np.ndarray:
    tau = np.zeros(ROBOT.n)
    gravity_torque(q, with_payload(dynamics_params(ROBOT), mass, at), dynamics_work(ROBOT.n), tau)
    return tau


# ------------------------------------------------------------------------------------------------- what can be carried


@pytest.mark.parametrize(
    ("load", "objection"),
    [
        (Payload(0.0), ""),
        (LOAD, ""),
        (Payload(2.5, (0.0, 0.0, 0.05), (0.01, 0.01, 0.005, 0.0, 0.001, 0.0)), ""),
        (Payload(-1.0), "a mass of 0 kg or more"),
        (Payload(nan), "finite numbers"),
        (Payload(1.0, (inf, 0.0, 0.0)), "finite numbers"),
        (Payload(1.0, (0.0, 0.0, 100.0)), "too far from the flange"),
        (Payload(1.0, inertia=(1.0, 0.1, 0.1, 0.0, 0.0, 0.0)), "no inertia of a body"),
        (Payload(1.0, inertia=(0.1, 0.1, 0.1, 0.2, 0.0, 0.0)), "no inertia of a body"),
        (Payload(1.0, inertia=(0.9, 0.9, 0.9, 0.0, 0.0, 0.0)), ""),
        (Payload(1.0, inertia=(20.0, 20.0, 20.0, 0.0, 0.0, 0.0)), "is it in kg m2?"),
        (Payload(0.0, inertia=(0.01, 0.01, 0.01, 0.0, 0.0, 0.0)), "too much for 0 kg"),
        (Payload(1.0, inertia=(1e308,) * 3 + (0.0,) * 3), "is it in kg m2?"),
        (Payload(2.6), "carries 2.5 kg"),
        (Payload(2.4, (0.0, 0.0, 0.9)), "wrist_bend would have to hold"),
    ],
)
def test_a_load_that_the_arm_cannot_carry_is_refused_with_the_reason(load: Payload, objection: str) -> None:
    said = JUDGE.objection(load)
    assert objection in said
    assert bool(said) is bool(objection)


@pytest.mark.parametrize("name", ["puma560", "stanford"])
def test_what_is_let_pass_can_be_held_at_every_pose(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(3)
    judge, tau, work = PayloadJudge(robot), np.zeros(robot.n), dynamics_work(robot.n)
    passed = 0
    for _ in range(40):
        mass, centre = rng.uniform(0, 8), rng.uniform(-0.4, 0.4, 3)
        at = centre + np.array([0.0, 0.0, robot.geometry.flange_m])
        params = with_payload(dynamics_params(robot), mass, at)
        worst = np.zeros(robot.n)
        for _ in range(200):
            gravity_torque(rng.uniform(robot.limits.q_min, robot.limits.q_max), params, work, tau)
            worst = np.maximum(worst, np.abs(tau))
        if not judge.objection(Payload(mass, tuple(centre))):
            passed += 1
            assert (worst <= robot.guard.tau_max).all()
        elif robot.limits.payload_kg == 0.0:
            assert (worst > 0.8 * HOLDING_SHARE * robot.guard.tau_max).any()
    assert passed > 3


# ------------------------------------------------------------------------------------------------- in the servo


def test_the_servo_goes_over_to_a_load_without_a_bump_and_holds_its_weight_then() -> None:
    bench = ServoBench().hold()
    bench.run(0.1)
    bench.mailbox.request_payload(LOAD)
    bench.run(RAMP_S + 0.1)
    rows = bench.rows()[-650:]  # from before it was asked for
    q = np.array(bench.q)
    share = ROBOT.control.gravity_joints
    np.testing.assert_allclose(rows["gravity"][-1], weight(q, 2.0, AT) * share, atol=1e-12)
    np.testing.assert_allclose(rows["payload"][-1], BODY, atol=1e-12)
    assert bench.snapshot.payload_mass == 2.0
    step = weight(q, 2.0, AT) - weight(q, 0.0, AT)
    most = 1.6 * np.abs(step).max() * 1e-3 / RAMP_S  # the ramp's steepest slope is 1.5 of its mean
    assert np.abs(np.diff(rows["gravity"], axis=0)).max() < most
    assert np.abs(np.diff(np.diff(rows["payload"][:, 0]))).max() < 1e-4 * 2.0


def test_a_load_that_is_let_go_of_leaves_the_model_as_it_was_to_the_last_bit() -> None:
    bench, bare = ServoBench().hold(), ServoBench().hold()
    bench.mailbox.request_payload(LOAD)
    bench.run(0.3)  # on the way
    bench.mailbox.request_payload(Payload(0.0))
    bench.run(RAMP_S + 0.01)
    bare.run(0.3 + RAMP_S + 0.01)
    np.testing.assert_array_equal(bench.rows()["gravity"][-1], bare.rows()["gravity"][-1])
    assert bench.snapshot.payload_mass == 0.0


@pytest.mark.parametrize("spoilt", [Payload(nan), Payload(-0.1), Payload(1.0, (nan, 0.0, 0.0)), Payload(1e9)])
def test_numbers_that_would_spoil_the_model_change_nothing(spoilt: Payload) -> None:
    bench = ServoBench().hold()
    bench.mailbox.request_payload(LOAD)
    bench.run(RAMP_S + 0.01)
    before = bench.rows()["gravity"][-1].copy()
    bench.mailbox.request_payload(spoilt)
    bench.run(RAMP_S + 0.01)
    np.testing.assert_array_equal(bench.rows()["gravity"][-1], before)


def test_computed_torque_is_inverse_dynamics_of_the_arm_with_its_load() -> None:
    rng, law = np.random.default_rng(5), find_law("computed-torque", ROBOT)
    gains, zero = np.zeros((3, 6)), np.zeros(6)
    gains[KP], gains[KV], gains[M0] = ROBOT.control.kp, ROBOT.control.kv, ROBOT.control.inertia
    for q, v, a in rng.uniform(-2, 2, (20, 3, 6)):
        tau = call(law, q_ref=q, q=q, v_ref=v, v=v, a_ref=a, friction=zero, gains=gains, payload=BODY)
        wanted = np.zeros(6)
        inverse_dynamics(q, v, a, with_payload(dynamics_params(ROBOT), 2.0, AT), dynamics_work(6), wanted)
        np.testing.assert_allclose(tau, wanted, rtol=1e-9, atol=1e-9)
