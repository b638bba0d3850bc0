"""Kinematics from the definition: forward and inverse undo each other branch by branch, branches mean what they say."""

from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.model.arm import Arm
from qrobot.model.branch import ALL_BRANCHES, Branch
from qrobot.model.paul import from_paul, pose_from_paul, pose_to_paul, to_paul
from qrobot.model.puma import InverseStatus, puma_branch, puma_inverse, puma_inverse_all, wrap_into_range
from qrobot.model.transform import so3_log
from tests.support.thorough import examples

PUMA = Arm(load_robot("puma560"))
STANFORD = Arm(load_robot("stanford"))
Q_MIN, Q_MAX = PUMA.robot.limits.q_min, PUMA.robot.limits.q_max
shares = st.lists(st.floats(0.01, 0.99), min_size=6, max_size=6).map(np.array)
joints = shares.map(lambda share: Q_MIN + share * (Q_MAX - Q_MIN))
arms = st.sampled_from([PUMA, STANFORD])


def manipulability(q: Floats) -> float:
    """Product of what vanishes at the shoulder, elbow and wrist singularities."""
    return abs(float(np.linalg.det(PUMA.jacobian(q))))


@given(joints)
@settings(max_examples=examples(100))
def test_the_inverse_of_the_own_branch_gives_the_joints_back(q: Floats) -> None:
    assume(manipulability(q) > 1e-4)
    np.testing.assert_allclose(PUMA.inverse(PUMA.forward(q), PUMA.branch(q), q), q, atol=1e-8)


@given(joints)
@settings(max_examples=examples(100))
def test_all_eight_branches_reach_the_pose_and_each_stands_on_its_own_branch(q: Floats) -> None:
    assume(manipulability(q) > 1e-4)
    T, solution = PUMA.forward(q), np.empty(6)
    for branch in ALL_BRANCHES:
        status = puma_inverse(T, PUMA.params, int(branch), q, solution)
        assert status in (InverseStatus.OK, InverseStatus.JOINT_LIMIT)
        np.testing.assert_allclose(PUMA.forward(solution), T, atol=1e-9)
        assert puma_branch(solution, PUMA.params) == branch
        assert (status == InverseStatus.OK) == bool(((solution >= Q_MIN) & (solution <= Q_MAX)).all())


@given(joints)
def test_all_at_once_is_each_in_turn(q: Floats) -> None:
    T, rows, status, one = PUMA.forward(q), np.empty((8, 6)), np.empty(8, dtype=np.int64), np.empty(6)
    puma_inverse_all(T, PUMA.params, q, rows, status)
    for branch in range(8):
        assert puma_inverse(T, PUMA.params, branch, q, one) == status[branch]
        np.testing.assert_array_equal(rows[branch], one)


def elbow_and_wrist(q: Floats) -> tuple[Floats, Floats]:
    """Positions of elbow (where link 3 begins) and wrist in the vertical frame that turns with the waist, m."""
    c, s = np.cos(q[0]), np.sin(q[0])
    to_waist = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    elbow = np.array([0.4318 * np.cos(q[1]), 0.0, -0.4318 * np.sin(q[1])])
    return elbow, to_waist @ PUMA.forward(q)[:3, 3]


@given(joints)
def test_left_and_right_are_the_side_of_the_waist_on_which_the_arm_is_looking_out_along_it(q: Floats) -> None:
    _, wrist = elbow_and_wrist(q)
    assume(abs(wrist[0]) > 1e-6)
    outwards, offset = np.array([wrist[0], 0, 0]), np.array([0, wrist[1], 0])
    assert bool(PUMA.branch(q) & Branch.LEFT) == (np.cross(outwards, offset)[2] > 0)


@given(joints)
def test_up_and_down_are_the_elbow_above_or_below_the_line_from_shoulder_to_wrist(q: Floats) -> None:
    elbow, wrist = elbow_and_wrist(q)
    assume(abs(wrist[0]) > 1e-3)
    over_the_line = elbow[2] - elbow[0] * wrist[2] / wrist[0]
    assume(abs(over_the_line) > 1e-6)
    assert bool(PUMA.branch(q) & Branch.DOWN) == (over_the_line < 0)


@given(joints)
def test_flip_is_a_negative_joint_5_and_the_other_wrist_of_the_same_arm(q: Floats) -> None:
    assume(manipulability(q) > 1e-4)
    branch, other = PUMA.branch(q), np.empty(6)
    assert bool(branch & Branch.FLIP) == (q[4] < 0)
    puma_inverse(PUMA.forward(q), PUMA.params, int(branch ^ Branch.FLIP), q, other)
    np.testing.assert_allclose(other[:3], q[:3], atol=1e-8)
    np.testing.assert_allclose(other[4], -q[4], atol=1e-8)
    np.testing.assert_allclose(np.exp(1j * (other[[3, 5]] - q[[3, 5]])), -1, atol=1e-6)


@given(joints, joints)
def test_the_nearest_solution_is_no_farther_than_any_other(q: Floats, near: Floats) -> None:
    assume(manipulability(q) > 1e-4)
    T = PUMA.forward(q)
    best = np.abs(PUMA.nearest(T, near) - near).max()
    assert all(best <= np.abs(solution - near).max() for solution in PUMA.inverses(T, near).values())


@given(st.lists(st.floats(-50, 50), min_size=6, max_size=6).map(np.array), joints)
def test_wrapping_moves_by_whole_turns_to_the_place_in_range_nearest_to_the_arm(q: Floats, near: Floats) -> None:
    wrapped = q.copy()
    fits = wrap_into_range(wrapped, PUMA.params, near)
    turns = (wrapped - q) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    places = q + 2 * np.pi * np.arange(-12, 13)[:, None]
    inside = (places >= Q_MIN) & (places <= Q_MAX)
    assert fits == inside.any(axis=0).all()
    distance = np.where(inside, np.abs(places - near), np.inf).min(axis=0)
    reachable = np.isfinite(distance)
    np.testing.assert_allclose(np.abs(wrapped - near)[reachable], distance[reachable], atol=1e-9)


@given(arms, shares, st.integers(0, 5))
def test_the_jacobian_is_the_derivative_of_the_pose(arm: Arm, share: Floats, j: int) -> None:
    low, high, h = arm.robot.limits.q_min, arm.robot.limits.q_max, 1e-6
    q = low + share * (high - low)
    step = h * np.eye(6)[j]
    ahead, behind, J = arm.forward(q + step), arm.forward(q - step), arm.jacobian(q)
    np.testing.assert_allclose(J[:3, j], (ahead[:3, 3] - behind[:3, 3]) / (2 * h), atol=1e-8)
    turned = so3_log(ahead[:3, :3] @ behind[:3, :3].T) / (2 * h)
    np.testing.assert_allclose(J[3:, j], turned, atol=1e-8)


@given(joints)
def test_the_determinant_is_the_published_product_of_the_three_singularities(q: Floats) -> None:
    """det J = a2 (a3 s3 + d4 c3) (a2 c2 + a3 c23 - d4 s23) s5, Paul's angles."""
    a2, a3, d4 = 0.4318, 0.0203, 0.4331
    _, q2, q3, _, q5, _ = to_paul(q)
    elbow = a3 * np.sin(q3) + d4 * np.cos(q3)
    shoulder = a2 * np.cos(q2) + a3 * np.cos(q2 + q3) - d4 * np.sin(q2 + q3)
    np.testing.assert_allclose(manipulability(q), abs(a2 * elbow * shoulder * np.sin(q5)), atol=1e-12)


@given(joints)
def test_pauls_standard_table_gives_the_same_pose_as_ours(q: Floats) -> None:
    """Standard DH: alpha (90, 0, -90, 90, -90, 0), a (0, a2, a3, 0, 0, 0), d (0, 0, d3, d4, 0, 0)."""
    alpha = np.radians([90, 0, -90, 90, -90, 0])
    a, d = [0, 0.4318, 0.0203, 0, 0, 0], [0, 0, 0.1501, 0.4331, 0, 0]
    T = np.eye(4)
    for theta, al, ai, di in zip(to_paul(q), alpha, a, d, strict=True):
        ct, st_, ca, sa = np.cos(theta), np.sin(theta), np.cos(al), np.sin(al)
        T = T @ np.array(
            [[ct, -st_ * ca, st_ * sa, ai * ct], [st_, ct * ca, -ct * sa, ai * st_], [0, sa, ca, di], [0, 0, 0, 1]]
        )
    np.testing.assert_allclose(pose_to_paul(PUMA.forward(q)), T, atol=1e-12)
    np.testing.assert_allclose(pose_from_paul(T), PUMA.forward(q), atol=1e-12)


@given(shares)
def test_val_and_paul_angles_are_inverse_in_the_inner_range(share: Floats) -> None:
    middle, half = 0.5 * (Q_MIN + Q_MAX), np.minimum(0.5 * (Q_MAX - Q_MIN), np.pi)
    q = middle + (2 * share - 1) * half
    np.testing.assert_allclose(from_paul(to_paul(q), Q_MIN, Q_MAX), q, atol=1e-12)
    assert (np.abs(to_paul(q)) <= np.pi + 1e-12).all()
