"""Rigid transforms: the group axioms, and the identities their docstrings state."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.arrays import Floats
from qrobot.model.transform import (
    inverse,
    is_transform,
    quaternion,
    quaternion_into,
    rot_x,
    rot_y,
    rot_z,
    rpy,
    so3_exp,
    so3_log,
    transform,
)

angles = st.floats(-np.pi, np.pi)
points = st.tuples(*[st.floats(-2, 2)] * 3).map(np.array)
unit_vectors = points.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))
#: Any angle, and many close to none and to half a turn, where logarithms lose their digits.
turns = st.one_of(
    st.floats(0, np.pi),
    st.floats(-18, -1).map(lambda e: 10.0**e),
    st.floats(-18, -1).map(lambda e: np.pi - 10.0**e),
)
rotation_vectors = st.builds(lambda k, angle: k * angle, unit_vectors, turns)
rotations = rotation_vectors.map(so3_exp)
transforms = st.builds(transform, rotations, points)


@given(transforms, transforms)
def test_transforms_form_a_group(A: Floats, B: Floats) -> None:
    np.testing.assert_allclose(A @ inverse(A), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(inverse(A) @ A, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(inverse(A), np.linalg.inv(A), atol=1e-12)
    assert is_transform(A @ B)


@given(rotations, points, points)
def test_a_transform_turns_and_then_shifts_a_point(R: Floats, t: Floats, x: Floats) -> None:
    np.testing.assert_allclose(transform(R, t) @ [*x, 1.0], [*(R @ x + t), 1.0], atol=1e-12)


@given(unit_vectors, turns)
def test_exponential_turns_about_the_axis_by_the_angle(k: Floats, angle: float) -> None:
    R = so3_exp(k * angle)
    np.testing.assert_allclose(R @ k, k, atol=1e-14)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(np.trace(R), 1 + 2 * np.cos(angle), atol=1e-14)
    assert np.linalg.det(R) == pytest.approx(1.0)
    across = np.cross(k, [k[1], k[2], k[0]])
    assert np.cross(across, R @ across) @ k == pytest.approx(np.sin(angle) * (across @ across), abs=1e-14)


@given(unit_vectors, turns)
def test_logarithm_gives_the_rotation_vector_back_near_identity_and_near_half_a_turn(k: Floats, angle: float) -> None:
    w = so3_log(so3_exp(k * angle))
    if angle > np.pi - 1e-8:  # both axes are right at half a turn
        w *= np.sign(w @ k)
    np.testing.assert_allclose(w, k * angle, rtol=1e-9, atol=2e-15)


@given(rotations)
def test_exponential_undoes_the_logarithm_and_no_logarithm_exceeds_half_a_turn(R: Floats) -> None:
    w = so3_log(R)
    assert np.linalg.norm(w) <= np.pi + 1e-15
    np.testing.assert_allclose(so3_exp(w), R, atol=1e-14)


@given(rotations)
def test_quaternions_are_unit_with_positive_scalar_and_keep_the_rotation(R: Floats) -> None:
    q, back = quaternion(R), np.empty((3, 3))
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-14)
    assert q[0] >= 0
    quaternion_into(q, back)
    np.testing.assert_allclose(back, R, atol=1e-14)


@given(angles)
def test_elementary_rotations_move_the_axes_as_their_docstrings_say(a: float) -> None:
    c, s = np.cos(a), np.sin(a)
    np.testing.assert_allclose(rot_x(a) @ [0, 1, 0], [0, c, s], atol=1e-15)
    np.testing.assert_allclose(rot_y(a) @ [0, 0, 1], [s, 0, c], atol=1e-15)
    np.testing.assert_allclose(rot_z(a) @ [1, 0, 0], [c, s, 0], atol=1e-15)


@given(angles, st.floats(-1.5, 1.5), angles)
def test_roll_pitch_yaw_are_read_off_the_matrix_as_in_paul(roll: float, pitch: float, yaw: float) -> None:
    R = rpy(roll, pitch, yaw)
    assert np.exp(1j * np.arctan2(R[1, 0], R[0, 0])) == pytest.approx(np.exp(1j * roll))
    assert -np.arcsin(R[2, 0]) == pytest.approx(pitch)
    assert np.exp(1j * np.arctan2(R[2, 1], R[2, 2])) == pytest.approx(np.exp(1j * yaw))


@pytest.mark.parametrize(
    "bad",
    [
        np.full((4, 4), np.nan),
        np.diag([1.0, 1.0, -1.0, 1.0]),
        1.001 * np.eye(4),
        np.eye(3),
        transform(np.eye(3), [np.inf, 0, 0]),
        np.eye(4) + np.diag([1e-3] * 3, k=-1),
    ],
)
def test_what_is_no_rigid_transform_is_told_apart(bad: Floats) -> None:
    assert is_transform(np.eye(4))
    assert not is_transform(bad)
