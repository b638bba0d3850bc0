"""Orientations in the papers' angles, and small motions and forces carried between frames."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import MotionError
from qrobot.model.differential import cross_matrix, twist_to_child, wrench_to_parent
from qrobot.model.orientation import (
    OAT_ZERO,
    axis_angle,
    euler,
    euler_angles,
    oat,
    oat_angles,
    rpy_angles,
)
from qrobot.model.transform import inverse, rot_x, rot_y, rot_z, rpy, so3_exp, transform

ANGLE = st.one_of(st.floats(-pi, pi), st.sampled_from([0.0, pi / 2, -pi / 2, pi, -pi]))
ANGLES = st.tuples(ANGLE, ANGLE, ANGLE)
VECTOR = st.tuples(*[st.floats(-2.0, 2.0)] * 3).map(np.array)
SIX = st.tuples(*[st.floats(-2.0, 2.0)] * 6).map(np.array)
POSES = st.builds(lambda w, p: transform(so3_exp(w), p), VECTOR, VECTOR)


@pytest.mark.parametrize(
    ("make", "read"), [(euler, euler_angles), (rpy, rpy_angles), (oat, oat_angles)], ids=["euler", "rpy", "oat"]
)
@given(angles=ANGLES)
def test_angles_read_off_a_rotation_make_it_again(make, read, angles) -> None:
    R = make(*angles)
    assert make(*read(R)) == pytest.approx(R, abs=1e-9)


@given(ANGLES)
def test_euler_angles_turn_about_z_then_the_new_y_then_the_new_z(angles) -> None:
    phi, theta, psi = angles
    assert euler(*angles) == pytest.approx(rot_z(phi) @ rot_y(theta) @ rot_z(psi))


def test_a_val_location_without_angles_points_along_minus_y_and_o_turns_it_about_the_vertical() -> None:
    """VAL manuals 1977-79: with O = A = T = 0 the hand points along -Y; READY is (90, -90, 0), the tool up."""
    assert oat(0.0, 0.0, 0.0) == pytest.approx(OAT_ZERO)
    assert OAT_ZERO[:, 2].tolist() == [0.0, -1.0, 0.0]
    assert oat(pi / 2, 0.0, 0.0)[:, 2] == pytest.approx([1.0, 0.0, 0.0])
    assert oat(pi / 2, -pi / 2, 0.0)[:, 2] == pytest.approx([0.0, 0.0, 1.0])


@pytest.mark.parametrize(("axis", "turn"), [([5.0, 0, 0], rot_x), ([0, 0.1, 0], rot_y), ([0, 0, 1], rot_z)])
def test_an_axis_of_any_length_turns_as_the_unit_axis(axis, turn) -> None:
    assert axis_angle(axis, 0.7) == pytest.approx(turn(0.7))


@pytest.mark.parametrize("axis", [[0.0, 0.0, 0.0], [1.0, 0.0], [np.nan, 0.0, 1.0]])
def test_an_axis_without_direction_is_refused(axis) -> None:
    with pytest.raises(MotionError, match="needs a direction"):
        axis_angle(axis, 1.0)


@given(POSES, SIX, SIX)
def test_power_is_the_same_in_either_frame(T, twist, wrench) -> None:
    assert wrench_to_parent(T, wrench) @ twist == pytest.approx(wrench @ twist_to_child(T, twist), abs=1e-9)


@given(POSES, SIX)
def test_the_way_back_is_that_of_the_inverse_pose(T, twist) -> None:
    assert twist_to_child(inverse(T), twist_to_child(T, twist)) == pytest.approx(twist, abs=1e-9)


def differential(motion: np.ndarray) -> np.ndarray:
    """The differential transform of a small motion: identity plus `[delta x, d]`, to first order. Shape (4, 4)."""
    D = np.eye(4)
    D[:3, :3] += cross_matrix(motion[3:])
    D[:3, 3] = motion[:3]
    return D


@given(POSES, SIX)
def test_a_small_motion_seen_in_another_frame_is_the_same_motion(T, motion) -> None:
    """Delta_c = T^-1 Delta_r T, the definition of the map (Paul 1981, chapter 4)."""
    small = 1e-6 * motion
    there = inverse(T) @ differential(small) @ T
    assert there == pytest.approx(differential(twist_to_child(T, small)), abs=1e-11)
