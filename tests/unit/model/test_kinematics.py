"""Where published numbers put the PUMA 560: VAL poses, Paul's nominal pose, the ARCL example."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.errors import ConfigError, JointLimit, MotionError, Singular, Unreachable
from qrobot.model.arm import Arm
from qrobot.model.branch import ALL_BRANCHES, Branch, branch_of
from qrobot.model.paul import from_paul, pose_from_paul, pose_to_paul, to_paul
from qrobot.model.puma import InverseStatus, puma_inverse
from qrobot.model.transform import rot_y, transform

PUMA = load_robot("puma560")
ARM = Arm(PUMA)
STANFORD = Arm(load_robot("stanford"))
READY = PUMA.poses["ready"]
PARK = PUMA.poses["park"]


def degrees(*angles: float) -> Floats:
    return np.radians(np.array(angles, dtype=np.float64))


def test_val_ready_is_straight_up() -> None:
    """p = (-20.3, 150.05, 863.6) mm with the RCCL lengths; here d3 = 150.1 and d4 = 433.1 (AKB 1986)."""
    T = ARM.forward(READY)
    np.testing.assert_allclose(T[:3, 3], [-0.0203, 0.1501, 0.4318 + 0.4331], atol=1e-12)
    np.testing.assert_allclose(T[:3, :3], np.eye(3), atol=1e-12)


def test_val_zero_has_the_upper_arm_level_and_the_forearm_up() -> None:
    np.testing.assert_allclose(ARM.forward(np.zeros(6))[:3, 3], [0.4318 - 0.0203, 0.1501, 0.4331], atol=1e-12)


def test_the_wrist_position_is_that_of_the_vendors_driver() -> None:
    """x = c1 f - s1 d3, y = s1 f + c1 d3, f = c2 a2 + c23 a3 + s23 d4, z = c23 d4 - s23 a3 - s2 a2 (trajq.c)."""
    a2, a3, d3, d4 = 0.4318, -0.0203, 0.1501, 0.4331
    q1, q2, q3 = q = degrees(20, -70, 110)
    f = np.cos(q2) * a2 + np.cos(q2 + q3) * a3 + np.sin(q2 + q3) * d4
    z = np.cos(q2 + q3) * d4 - np.sin(q2 + q3) * a3 - np.sin(q2) * a2
    expected = [np.cos(q1) * f - np.sin(q1) * d3, np.sin(q1) * f + np.cos(q1) * d3, z]
    np.testing.assert_allclose(ARM.forward(np.array([*q, 1, 2, 3]))[:3, 3], expected, atol=1e-12)


def test_the_flange_is_56_mm_along_the_approach_axis() -> None:
    T = ARM.forward(PARK)
    np.testing.assert_allclose(ARM.flange(PARK)[:3, 3] - T[:3, 3], 0.05625 * T[:3, 2], atol=1e-12)


def paul(*angles: float) -> Floats:
    return from_paul(degrees(*angles), PUMA.limits.q_min, PUMA.limits.q_max)


@pytest.mark.parametrize(
    ("angles", "position"),
    [
        ((0, 90, -90, 0, 0, 0), (0.0203, -0.1501, 0.8649)),  # ready
        ((0, 0, -90, 0, 0, 0), (0.8649, -0.1501, -0.0203)),  # stretched
        ((0, 0, 0, 0, 0, 0), (0.4521, -0.1501, 0.4331)),  # zero: along +x, forearm up, a right arm
    ],
)
def test_paul_poses_stand_where_paul_says(angles: tuple[float, ...], position: tuple[float, ...]) -> None:
    q = paul(*angles)
    np.testing.assert_allclose(pose_to_paul(ARM.forward(q))[:3, 3], position, atol=1e-12)
    assert ARM.branch(q) & Branch.LEFT == 0


def test_paul_ready_is_val_ready() -> None:
    """READY (0, 90, -90, 0, 0, 0) is VAL's (0, -90, 90, 0, 0, 180): straight up, the hand turned by half."""
    np.testing.assert_allclose(paul(0, 90, -90, 0, 0, -180), READY, atol=1e-12)


def test_pauls_joint_limits_are_the_published_ones() -> None:
    low, high = np.degrees(PUMA.limits.q_min), np.degrees(PUMA.limits.q_max)
    offset = np.array([0, 180, -180, 0, 0, 0])
    np.testing.assert_allclose((low + offset)[:3], [-160, -43, -220])  # published -160, -45, -225
    np.testing.assert_allclose((high + offset)[:3], [160, 223, 60])  # published 160, 225, 45


def test_corkes_map_with_half_a_turn_on_joint_1_keeps_the_base_frame() -> None:
    """q_corke = q_val + (180, 180, 180, 0, 0, 180) deg (Robotics Toolbox, checked numerically)."""
    q = PUMA.poses["end"]
    as_corke = q + degrees(180, 180, 180, 0, 0, 180)
    in_paul = to_paul(q) + degrees(180, 0, 0, 0, 0, 0)
    np.testing.assert_allclose(np.exp(1j * as_corke), np.exp(1j * in_paul), atol=1e-12)


def arm_of_the_papers() -> Arm:
    """An arm with Corke's lengths (1995), to which the published angles belong: d3 = 0.15005, d4 = 0.4318."""
    arm = Arm(PUMA)
    arm.params.chain.d[2], arm.params.chain.d[3] = 0.15005 - 0.2435, 0.4318
    return arm


@pytest.mark.parametrize(
    ("letters", "expected"),
    [
        ("run", [0.0, 0.7854, 3.1416, 0.0, 0.7854, 0.0]),
        ("lun", [2.6486, 2.3562, 0.0940, 2.5326, 0.9743, 0.3734]),
    ],
)
def test_nominal_pose_has_the_published_run_and_lun_angles(letters: str, expected: list[float]) -> None:
    """Robotics Toolbox, with its d4 = 0.4318."""
    arm, q = arm_of_the_papers(), paul(0, 45, 180, 0, 45, 0)
    solution = to_paul(arm.inverse(arm.forward(q), branch_of(letters), q))
    np.testing.assert_allclose(np.exp(1j * solution), np.exp(1j * np.array(expected)), atol=1e-4)


def test_the_arcl_example_is_reached_by_run_at_the_published_angles() -> None:
    """ARCL paper, section 2.4: T6 at (415, 150, 397.776) mm, pitch 30 degrees."""
    target = pose_from_paul(transform(rot_y(np.radians(30)), [0.415, 0.150, 0.397776]))
    q = to_paul(arm_of_the_papers().inverse(target, branch_of("run"), PARK))
    np.testing.assert_allclose(np.degrees(q), [39.751, 92.120, 176.096, 20.018, 69.067, -43.181], atol=1.5e-3)


def test_the_arcl_example_by_lun_needs_joint_1_beyond_its_range() -> None:
    target = pose_from_paul(transform(rot_y(np.radians(30)), [0.415, 0.150, 0.397776]))
    with pytest.raises(JointLimit, match=r"'lun'.*waist would be at 1(79|80)\.\d\d of -160\.\.160 deg"):
        arm_of_the_papers().inverse(target, branch_of("lun"), PARK)


def test_stanford_reaches_out_with_its_boom() -> None:
    low, high = (STANFORD.forward(np.array([0, np.pi / 2, d, 0, 0, 0])) for d in (0.4, 1.2))
    np.testing.assert_allclose(high[:3, 3] - low[:3, 3], [0.8, 0, 0], atol=1e-12)
    np.testing.assert_allclose(low[:3, 3], [0.4, 0.154, 0.412], atol=1e-12)


def test_letters_name_branches_and_back() -> None:
    assert [b.letters for b in ALL_BRANCHES] == ["run", "lun", "rdn", "ldn", "ruf", "luf", "rdf", "ldf"]
    assert [branch_of(b.letters) for b in ALL_BRANCHES] == list(ALL_BRANCHES)


def test_missing_letters_are_taken_from_the_default() -> None:
    assert branch_of("r", branch_of("ldf")).letters == "rdf"
    assert branch_of("", branch_of("ldf")).letters == "ldf"
    assert branch_of("nl", branch_of("ruf")).letters == "lun"


@pytest.mark.parametrize("letters", ["x", "lr", "runn", "RUN", "llu"])
def test_letters_that_name_no_branch_are_refused(letters: str) -> None:
    with pytest.raises(ConfigError, match="at most one letter each"):
        branch_of(letters)


@pytest.mark.parametrize(
    "position",
    [(1.0, 0, 0), (0, 0, 0.9), (0.1, 0.1, 0.0), (0, 0, 0), (0.150103, 0, 0), (1e6, 0, 0)],
)
def test_poses_out_of_reach_are_unreachable_on_every_branch(position: tuple[float, float, float]) -> None:
    target = transform(translation=position)
    assert ARM.inverses(target, PARK) == {}
    for branch in ALL_BRANCHES:
        with pytest.raises(Unreachable, match="out of the arm's reach"):
            ARM.inverse(target, branch, PARK)
    with pytest.raises(Unreachable):
        ARM.nearest(target, PARK)


STRAIGHT_WRIST = degrees(10, -60, 150, 25, 0, 30)


def test_a_straight_wrist_is_singular_not_unreachable() -> None:
    with pytest.raises(Singular, match="joints 4 and 6 are in line"):
        ARM.inverse(ARM.forward(STRAIGHT_WRIST), ARM.branch(STRAIGHT_WRIST), PARK)


def test_a_stretched_arm_is_singular_not_unreachable() -> None:
    a2, forearm = 0.4318, np.hypot(0.0203, 0.4331)
    q = degrees(10, -30, 0, 20, 30, 40)
    q[2] = np.pi / 2 + np.arctan2(0.0203, 0.4331)
    T = ARM.forward(q)
    assert np.hypot(np.linalg.norm(T[:2, 3]), T[2, 3]) ** 2 == pytest.approx((a2 + forearm) ** 2 + 0.1501**2)
    with pytest.raises(Singular, match="stretched"):
        ARM.inverse(T, ARM.branch(q), PARK)


def test_the_wrist_on_the_shoulder_cylinder_is_singular_not_unreachable() -> None:
    for side in (1.0, -1.0):
        target = transform(rot_y(0.3), [0.0, 0.1501 * side, 0.7])
        with pytest.raises(Singular, match="shoulder"):
            ARM.inverse(target, Branch.RUN, PARK)


def test_at_a_straight_wrist_the_kernel_keeps_joint_4_and_still_reaches_the_pose() -> None:
    T, q = ARM.forward(STRAIGHT_WRIST), np.empty(6)
    near = STRAIGHT_WRIST + degrees(1, 1, 1, 20, 0, 0)
    for branch in (ARM.branch(STRAIGHT_WRIST), ARM.branch(STRAIGHT_WRIST) ^ Branch.FLIP):
        assert puma_inverse(T, ARM.params, int(branch), near, q) == InverseStatus.WRIST_SINGULAR
        assert q[3] == pytest.approx(near[3])
        np.testing.assert_allclose(ARM.forward(q), T, atol=1e-9)


def test_what_is_no_rigid_transform_is_refused() -> None:
    for bad in (np.full((4, 4), np.nan), np.diag([1.0, 1, -1, 1]), np.eye(3), 2 * np.eye(4)):
        with pytest.raises(MotionError, match="not a rigid transform"):
            ARM.inverse(bad, Branch.RUN, PARK)


def test_a_robot_of_another_family_says_that_it_has_no_closed_form() -> None:
    generic = STANFORD.robot.model_copy(
        update={"geometry": STANFORD.robot.geometry.model_copy(update={"family": "generic"})}
    )
    with pytest.raises(MotionError, match="'stanford' has no closed-form inverse: its family is 'generic'"):
        Arm(generic).inverse(np.eye(4), Branch.RUN, generic.poses["park"])


def test_the_nearest_solution_from_park_to_park_is_park() -> None:
    np.testing.assert_allclose(ARM.nearest(ARM.forward(PARK), PARK), PARK, atol=1e-9)


@pytest.mark.parametrize("link", [1, 4, 6])
def test_the_jacobian_in_the_axes_of_a_link_is_the_motion_those_axes_see(link: int) -> None:
    q = np.array([0.3, -0.7, 1.1, 0.4, -0.6, 0.2])
    R = ARM.forward(q)[:3, :3] if link == 6 else ARM._orientation(q, link)
    np.testing.assert_allclose(R @ ARM.link_jacobian(q, link)[:3], ARM.jacobian(q)[:3], atol=1e-15)
    np.testing.assert_allclose(R @ ARM.link_jacobian(q, link)[3:], ARM.jacobian(q)[3:], atol=1e-15)


def test_in_the_axes_of_link_4_the_wrist_turns_and_does_not_travel() -> None:
    q = np.array([0.3, -0.7, 1.1, 0.4, -0.6, 0.2])
    J = ARM.link_jacobian(q, 4)
    np.testing.assert_allclose(J[:3, 3:], 0.0, atol=1e-15)  # joints 4 to 6 leave the centre of the wrist where it is
    np.testing.assert_allclose(J[3:, 3], [0.0, 0.0, 1.0], atol=1e-15)  # joint 4 is the link's own axis
    np.testing.assert_allclose(np.abs(J[3:, 4]), [0.0, 1.0, 0.0], atol=1e-15)  # joint 5 a constant direction in it
    turned = q + np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(J, ARM.link_jacobian(turned, 4), atol=1e-15)  # the arm does not see its waist turn


def test_a_link_that_is_not_there_has_no_jacobian() -> None:
    for link in (0, 7):
        with pytest.raises(MotionError, match="links 1 to 6"):
            ARM.link_jacobian(np.zeros(6), link)


def test_joint_vectors_of_another_length_are_refused() -> None:
    with pytest.raises(MotionError, match="'puma560' has 6 joints"):
        ARM.forward(np.zeros(5))
