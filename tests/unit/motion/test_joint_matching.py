"""Joint matching by relative gains, on the PUMA."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.errors import Singular
from qrobot.model.differential import wrench_to_parent
from qrobot.model.transform import inverse, transform
from qrobot.motion.force.controlled_frame import controlled_frame
from qrobot.motion.force.joint_matching import drift_step, fitness, match
from tests.support.puma import PARK, ROBOT, TOOL, arm, kinematics

TIP = inverse(TOOL.value)
DOWN = (2,)


def over_the_table() -> np.ndarray:
    """Joints with the tool pointing down in front of the arm."""
    from qrobot.model.transform import rot_y

    frame = transform(rot_y(np.pi), [0.55, 0.0, -0.4])
    return kinematics().inverse(frame @ TIP, kinematics().branch(PARK), PARK)


def gains() -> tuple[np.ndarray, np.ndarray]:
    """The Jacobian over the table, and its inverse."""
    here = controlled_frame(arm(), over_the_table(), TIP)
    return here.jacobian, here.inverse


def test_the_jacobian_of_the_controlled_frame_is_that_of_its_motion() -> None:
    q = over_the_table() + np.array([0.2, -0.1, 0.1, 0.3, 0.2, -0.4])
    here = controlled_frame(arm(), q, TIP)
    step = 1e-6
    for j in range(6):
        moved = controlled_frame(arm(), q + step * np.eye(6)[j], TIP)
        D = inverse(here.frame) @ moved.frame
        motion = np.array([*D[:3, 3], D[2, 1], D[0, 2], D[1, 0]]) / step
        assert here.jacobian[:, j] == pytest.approx(motion, abs=1e-5)


def test_a_wrench_is_found_again_in_the_torques_that_balance_it() -> None:
    here = controlled_frame(arm(), over_the_table(), TIP)
    wrench = np.array([3.0, -4.0, 20.0, 0.5, -0.2, 0.1])
    tau = here.jacobian.T @ wrench
    assert here.wrench(tau) == pytest.approx(wrench)
    t6 = arm().forward(over_the_table())
    seen = transform(here.frame[:3, :3], here.frame[:3, 3] - t6[:3, 3])
    assert tau == pytest.approx(arm().jacobian(over_the_table()).T @ wrench_to_parent(seen, wrench))


def test_the_shoulder_serves_the_vertical_of_a_tool_that_points_down() -> None:
    assert match(*gains(), DOWN) == (1,)


def test_the_waist_serves_the_sideways_direction() -> None:
    assert match(*gains(), (1,)) == (0,)


def test_two_axes_take_two_joints_and_all_take_all() -> None:
    J, G = gains()
    assert match(J, G, (0, 2)) == (1, 2)
    assert match(J, G, tuple(range(6))) == tuple(range(6))
    assert fitness(J, G, tuple(range(6)), tuple(range(6))) == pytest.approx(1.0)


def test_relative_gains_of_one_axis_add_up_to_one() -> None:
    """Bristol 1966: rows and columns of the array of relative gains sum to 1."""
    J, G = gains()
    relative = J * G.T
    assert relative.sum(axis=0) == pytest.approx(np.ones(6))
    assert relative.sum(axis=1) == pytest.approx(np.ones(6))
    assert fitness(J, G, DOWN, (1,)) == pytest.approx(min(relative[2, 1], 1.0 / relative[2, 1]))


def test_a_joint_that_cannot_move_along_the_axis_is_unfit() -> None:
    assert fitness(*gains(), DOWN, (0,)) < 0.05


def test_nothing_matches_at_a_singular_pose() -> None:
    there = controlled_frame(arm(), ROBOT.poses["ready"], TIP)
    with pytest.raises(Singular, match="singular"):
        match(there.jacobian, there.inverse, DOWN)


def test_the_drift_explains_the_error_of_the_joint_when_all_else_is_held() -> None:
    q, push = over_the_table(), 0.002
    frame = controlled_frame(arm(), q, TIP).frame @ transform(None, [0.0, 0.0, push])
    held = kinematics().inverse(frame @ TIP, kinematics().branch(q), q)  # all joints for a motion along the axis alone
    assert drift_step(controlled_frame(arm(), q, TIP).inverse, DOWN, (1,), (held - q)[[1]]) == pytest.approx(
        [push], rel=0.02
    )
