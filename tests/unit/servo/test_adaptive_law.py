"""The law `adaptive`: its recursion against all cycles at once, and what it makes of a load it was not told of."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.codegen.load import FRICTION_DOUBT, LIKELY_KG, LIKELY_M, MOVES, TORQUE_DOUBT
from qrobot.config import load_robot
from qrobot.ident.regressor import gravity_regressor
from qrobot.model.dynamics import dynamics_params, dynamics_work, inverse_dynamics
from qrobot.servo.laws.adaptive import APPLIED, LOAD, SPREAD, SUMS
from qrobot.servo.laws.law import MEMORY_WORDS
from qrobot.servo.laws.shipped import find_law
from tests.unit.servo.test_law import call

ROBOT = load_robot("puma560")
N, CONTROL = ROBOT.n, ROBOT.control
GAINS = np.array([CONTROL.kp, CONTROL.kv, CONTROL.inertia])
LAW = find_law("adaptive", ROBOT)
DT, HORIZON = 0.001, 10.0
TRUE = np.array([1.5, 0.02, -0.03, 0.12])  # kg, kg m
WATCH = LAW.with_settings({"use": 0.0})


def rigid(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
    tau = np.zeros(N)
    inverse_dynamics(q, v, a, dynamics_params(ROBOT), dynamics_work(N), tau)
    return tau


def columns(q: np.ndarray) -> np.ndarray:
    """Torques of a load at rest, from the regressor of identification: another derivation. Shape (n, 4)."""
    return gravity_regressor(ROBOT)(q[None])[0, :, -4:]


def states(count: int, seed: int = 0) -> list[tuple[np.ndarray, np.ndarray]]:
    """Positions, and speeds of which some are too slow to tell anything."""
    random = np.random.default_rng(seed)
    q = random.uniform(ROBOT.limits.q_min, ROBOT.limits.q_max, (count, N))
    v = random.uniform(-0.12, 0.12, (count, N)) * ROBOT.limits.v_max
    return list(zip(q, v, strict=True))


def after(motion: list[tuple[np.ndarray, np.ndarray]], theta: np.ndarray, memory: np.ndarray | None = None):
    """Memory of the law after cycles in which `theta` was carried without acceleration."""
    memory = np.zeros(MEMORY_WORDS) if memory is None else memory
    still = np.zeros(N)
    for q, v in motion:
        memory[APPLIED : APPLIED + N] = rigid(q, v, still) + moving_load(q, v) @ theta
        call(WATCH, q_ref=q, q=q, v_ref=v, v=v, gains=GAINS, memory=memory, dt=DT)
    return memory


def moving_load(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Torques of a load that moves at constant joint speeds, by differences of the arm's own dynamics. Shape (n, 4)."""
    params, still = dynamics_params(ROBOT), np.zeros(N)
    bare = rigid(q, v, still)
    torques = np.zeros((N, 4))
    for k in range(4):
        mass, moment = params.mass.copy(), params.moment.copy()
        mass[-1] += k == 0
        moment[-1] += np.eye(4)[k, 1:]
        tau = np.zeros(N)
        inverse_dynamics(q, v, still, params._replace(mass=mass, moment=moment), dynamics_work(N), tau)
        torques[:, k] = tau - bare
    return torques


def all_at_once(motion, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weighted least squares with a prior, each cycle counting by its age in motion: (load, deviations)."""
    friction = ROBOT.friction[CONTROL.friction_preset]
    doubt = FRICTION_DOUBT * np.maximum(friction.coulomb_pos, friction.coulomb_neg) + TORQUE_DOUBT * ROBOT.guard.tau_max
    A = np.diag(1.0 / np.array([LIKELY_KG] + [LIKELY_KG * LIKELY_M] * 3) ** 2)
    b, keep = np.zeros(4), 1.0
    for q, v in reversed(motion):
        moves = np.abs(v) > MOVES * ROBOT.limits.v_max
        weight = keep * moves * DT / doubt**2
        Y = moving_load(q, v)
        A += Y.T @ (weight[:, None] * Y)
        b += Y.T @ (weight * (Y @ theta))
        keep *= 1.0 - DT / HORIZON if moves.any() else 1.0
    return np.linalg.solve(A, b), np.sqrt(np.diag(np.linalg.inv(A)))


def test_the_recursion_is_weighted_least_squares_over_all_cycles() -> None:
    motion = states(40)
    memory = after(motion, TRUE)
    load, spread = all_at_once(motion, TRUE)
    np.testing.assert_allclose(memory[LOAD:SPREAD], load, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(memory[SPREAD:APPLIED], spread, rtol=1e-6)


def test_the_columns_at_rest_are_those_of_the_last_link() -> None:
    for q, _ in states(3):
        np.testing.assert_allclose(moving_load(q, np.zeros(N)), columns(q), atol=1e-9)


def test_it_converges_to_the_load_and_its_deviations_shrink() -> None:
    early, late = after(states(20), TRUE), after(states(600), TRUE)
    assert (late[SPREAD:APPLIED] < 0.5 * early[SPREAD:APPLIED]).all()
    assert (np.abs(late[LOAD:SPREAD] - TRUE) < late[SPREAD:APPLIED]).all()
    assert late[LOAD] == pytest.approx(TRUE[0], abs=0.1)


def test_a_load_put_down_is_forgotten_by_motion_and_not_at_rest() -> None:
    memory = after(states(300), TRUE)
    before = memory[SUMS:LOAD].copy()
    after([(q, np.zeros(N)) for q, _ in states(50)], np.zeros(4), memory)
    np.testing.assert_array_equal(memory[SUMS:LOAD], before)
    quick = LAW.with_settings({"use": 0.0, "horizon": 0.5})
    still = np.zeros(N)
    for q, v in states(1500, seed=1):
        memory[APPLIED : APPLIED + N] = rigid(q, v, still)
        call(quick, q_ref=q, q=q, v_ref=v, v=v, gains=GAINS, memory=memory, dt=DT)
    assert abs(memory[LOAD]) < 0.1 * TRUE[0]


def test_what_was_found_is_borne_watched_or_reset() -> None:
    memory, (q, _) = after(states(300), TRUE), states(1, seed=2)[0]
    here = {"q_ref": q, "q": q, "gains": GAINS, "dt": DT}
    without = call(find_law("computed-torque", ROBOT), **here)
    borne, watched = (call(law, **here, memory=memory.copy()) for law in (LAW, WATCH))
    np.testing.assert_allclose(borne - without, columns(q) @ memory[LOAD:SPREAD], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(watched, without, rtol=1e-9, atol=1e-9)
    forgetful = memory.copy()
    reset = call(LAW.with_settings({"reset": 1.0}), **here, memory=forgetful)
    np.testing.assert_allclose(reset, without, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(forgetful[SUMS:SPREAD], np.zeros(SPREAD))
    assert forgetful[SPREAD] == pytest.approx(LIKELY_KG)


def test_what_it_remembers_as_applied_is_within_the_guards_limit_and_the_rest_is_left_alone() -> None:
    memory = np.arange(float(MEMORY_WORDS)) * 0.0 + 7.0
    q = np.array(ROBOT.poses["ready"])
    call(LAW.with_settings({"reset": 1.0}), q_ref=q + 1.0, q=q, gains=GAINS, memory=memory, dt=DT)
    assert (np.abs(memory[APPLIED : APPLIED + N]) <= ROBOT.guard.tau_max).all()
    assert memory[APPLIED + N :].tolist() == [7.0] * (MEMORY_WORDS - APPLIED - N)
