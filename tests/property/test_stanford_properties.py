"""The Stanford arm's inverse from the definition: it undoes forward kinematics on every branch, or says why not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.errors import JointLimit, Singular, Unreachable
from qrobot.model.arm import Arm
from qrobot.model.branch import ALL_BRANCHES, Branch
from qrobot.model.puma import InverseStatus
from qrobot.model.stanford import stanford_branch, stanford_inverse
from tests.support.thorough import examples

ARM = Arm(load_robot("stanford"))
Q_MIN, Q_MAX = ARM.robot.limits.q_min, ARM.robot.limits.q_max
READY = np.array(ARM.robot.poses["ready"])
joints = st.lists(st.floats(0.01, 0.99), min_size=6, max_size=6).map(
    lambda share: Q_MIN + np.array(share) * (Q_MAX - Q_MIN)
)


def regular(q: Floats) -> bool:
    return abs(float(np.linalg.det(ARM.jacobian(q)))) > 1e-4


@given(joints)
@settings(max_examples=examples(100))
def test_the_inverse_of_the_own_branch_gives_the_joints_back(q: Floats) -> None:
    assume(regular(q))
    np.testing.assert_allclose(ARM.inverse(ARM.forward(q), ARM.branch(q), q), q, atol=1e-8)


@given(joints)
@settings(max_examples=examples(100))
def test_four_branches_reach_the_pose_and_there_is_no_elbow(q: Floats) -> None:
    assume(regular(q))
    T, solution = ARM.forward(q), np.empty(6)
    for branch in ALL_BRANCHES:
        status = stanford_inverse(T, ARM.params, int(branch), q, solution)
        if branch & Branch.DOWN:
            assert status == InverseStatus.UNREACHABLE
            continue
        assert status in (InverseStatus.OK, InverseStatus.JOINT_LIMIT)
        np.testing.assert_allclose(ARM.forward(solution), T, atol=1e-9)
        assert stanford_branch(solution, ARM.params) == branch
        assert (status == InverseStatus.OK) == bool(((solution >= Q_MIN) & (solution <= Q_MAX)).all())


@given(joints)
def test_the_nearest_of_all_solutions_is_where_the_arm_is(q: Floats) -> None:
    assume(regular(q))
    np.testing.assert_allclose(ARM.nearest(ARM.forward(q), q), q, atol=1e-8)


@given(joints)
def test_left_is_where_the_boom_leans_backwards(q: Floats) -> None:
    assume(abs(np.sin(q[1])) > 1e-6)
    outwards = ARM.forward(q)[:2, 3] @ [np.cos(q[0]), np.sin(q[0])]
    assert bool(ARM.branch(q) & Branch.LEFT) == (outwards < 0)


@given(joints, st.floats(-0.5, 0.5))
def test_at_a_straight_wrist_joint_4_stays_and_the_pose_is_kept(q: Floats, near: float) -> None:
    assume(abs(np.sin(q[1])) > 1e-3)  # a boom that stands upright leaves joint 1 open too
    q[4] = 0.0
    T, solution = ARM.forward(q), np.empty(6)
    around = q.copy()
    around[3] = near
    assert stanford_inverse(T, ARM.params, int(ARM.branch(q)), around, solution) == InverseStatus.WRIST_SINGULAR
    assert solution[3] == pytest.approx(near)
    np.testing.assert_allclose(ARM.forward(solution), T, atol=1e-9)


def test_what_cannot_be_reached_is_told_apart() -> None:
    inside, bent = ARM.forward(READY), READY.copy()
    bent[4] = 0.5
    inside[:3, 3] = [0.05, 0.05, 0.6]  # on the near side of the shoulder's offset
    stretched = bent.copy()
    stretched[2] = 1.5
    with pytest.raises(Unreachable):
        ARM.inverse(inside, Branch.RUN, READY)
    with pytest.raises(JointLimit, match=r"boom would be at 1500\.00 of 305\.\.1270 mm"):
        ARM.inverse(ARM.forward(stretched), ARM.branch(bent), bent)
    with pytest.raises(Singular):
        ARM.inverse(ARM.forward(READY), ARM.branch(READY), READY)
    with pytest.raises(Unreachable):
        ARM.inverse(ARM.forward(bent), ARM.branch(bent) | Branch.DOWN, bent)


def test_a_robot_file_that_is_no_stanford_arm_is_refused() -> None:
    from qrobot.config.robot import _is_stanford

    assert _is_stanford(ARM.robot)
    assert not _is_stanford(load_robot("puma560"))
