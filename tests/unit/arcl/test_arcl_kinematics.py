"""ARCL's kinematics layer, from Paul's equations and the numbers that the papers and the Robotics Toolbox print."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.arcl.kinematics import config_letters, config_word, kinematics, kinematics_names, register_kinematics
from qrobot.config import load_robot
from qrobot.errors import ConfigError, JointLimit, MotionError, Singular, Unreachable
from qrobot.model.branch import ALL_BRANCHES, branch_of
from qrobot.model.transform import rpy, transform

PUMA = kinematics("puma560")


def toolbox_puma():
    """The lengths of the Toolbox's model: a2 = d4 = 431.8, a3 = 20.3, d3 = 150.05 mm."""
    robot = load_robot("puma560")
    geometry = robot.geometry.model_copy(update={"d_m": np.array([0.0, 0.2435, 0.15005 - 0.2435, 0.4318, 0.0, 0.0])})
    return kinematics(robot.model_copy(update={"geometry": geometry}), unlimited=True)


def pauls_table(theta: np.ndarray, d4: float = 0.4331) -> np.ndarray:
    """T6 by Paul's standard table, one row at a time, shape (4, 4)."""
    twists, a, d = np.radians([90, 0, -90, 90, -90, 0]), [0, 0.4318, 0.0203, 0, 0, 0], [0, 0, 0.1501, d4, 0, 0]
    T = np.eye(4)
    for angle, twist, length, offset in zip(theta, twists, a, d, strict=True):
        ct, st, ca, sa = np.cos(angle), np.sin(angle), np.cos(twist), np.sin(twist)
        row = [[ct, -st * ca, st * sa, length * ct], [st, ct * ca, -ct * sa, length * st], [0, sa, ca, offset]]
        T = T @ np.array([*row, [0, 0, 0, 1]])
    return T


def test_ready_stands_as_in_pauls_convention() -> None:
    T = PUMA.forward(np.radians([0.0, 90.0, -90.0, 0.0, 0.0, 0.0]))
    assert np.allclose(T[:3, :3], np.eye(3), atol=1e-12)
    assert np.allclose(T[:3, 3], [0.0203, -0.1501, 0.8649], atol=1e-9)


def test_forward_is_pauls_table() -> None:
    random = np.random.default_rng(17)
    for _ in range(50):
        theta = random.uniform(PUMA.limits.q_min, PUMA.limits.q_max)
        assert np.allclose(PUMA.forward(theta), pauls_table(theta), atol=1e-12)


def test_the_ranges_are_those_published_for_pauls_angles() -> None:
    low, high = np.degrees(PUMA.limits.q_min), np.degrees(PUMA.limits.q_max)
    published = [(-160, 160), (-45, 225), (-225, 45), (-110, 170), (-100, 100)]
    for joint, (least, most) in enumerate(published):
        assert abs(low[joint] - least) <= 15.0
        assert abs(high[joint] - most) <= 15.0


def test_the_papers_program_has_the_solutions_computed_for_it() -> None:
    """BASE T6 TOOL = STAND WORK of section 2.4: T6 at (415, 150, 397.776) mm with a pitch of 30 degrees."""
    aki = toolbox_puma()
    T = transform(rpy(0.0, np.radians(30.0), 0.0), [0.415, 0.150, 0.397776])
    near = np.radians([0.0, 90.0, -180.0, 0.0, 0.0, 0.0])
    run = np.degrees(aki.inverse(T, config_word("run"), near))
    lun = np.degrees(aki.inverse(T, config_word("lun"), np.radians([180.0, 90.0, 0.0, 180.0, 60.0, 0.0])))
    assert np.allclose(run, [39.751, 92.120, -183.904, 20.018, 69.067, -43.181], atol=2e-3)
    assert np.allclose(lun, [179.993, 87.880, 9.287, 179.996, 67.167, 0.007], atol=2e-3)


def test_lun_of_the_papers_program_is_an_error_that_names_the_joint() -> None:
    T = transform(rpy(0.0, np.radians(30.0), 0.0), [0.415, 0.150, 0.397776])
    with pytest.raises(JointLimit, match=r"'lun', T6 at \[415.0, 150.0, 397.8\] mm: joint 1 \(waist\) at 179.9"):
        PUMA.inverse(T, config_word("lun"), np.zeros(6))


def test_an_inverse_leads_back_in_each_configuration() -> None:
    free = kinematics("puma560", unlimited=True)
    theta = np.radians([20.0, 70.0, -200.0, 30.0, 50.0, -40.0])
    T = free.forward(theta)
    for branch in ALL_BRANCHES:
        found = free.inverse(T, branch, theta)
        assert np.allclose(free.forward(found), T, atol=1e-9)
        assert free.branch(found) == branch


def test_a_limit_names_a_configuration_that_gets_there_and_the_inverse_agrees() -> None:
    rng, park, told = np.random.default_rng(3), np.radians([0.0, 135.0, 0.0, 0.0, 45.0, -180.0]), []
    for q in rng.uniform(PUMA.limits.q_min, PUMA.limits.q_max, (50, 6)):
        T = PUMA.forward(q)
        for branch in ALL_BRANCHES:
            try:
                PUMA.inverse(T, branch, park)
            except JointLimit as error:
                told.append((T, str(error)))
            except (Singular, Unreachable):
                continue
    assert len(told) > 20
    for T, words in told:
        letters = words.split("configuration '")[-1][:3]
        assert words.endswith(f"; configuration '{letters}' gets there")
        assert np.allclose(PUMA.forward(PUMA.inverse(T, branch_of(letters), park)), T, atol=1e-9)


def test_a_limit_names_no_configuration_where_none_gets_there() -> None:
    T = kinematics("puma560", unlimited=True).forward(np.radians([0.0, -90.0, -90.0, 0.0, 120.0, 0.0]))
    for branch in ALL_BRANCHES:
        with pytest.raises(JointLimit) as error:
            PUMA.inverse(T, branch, np.zeros(6))
        assert "gets there" not in str(error.value)


def test_a_pose_out_of_reach_is_told_with_its_place() -> None:
    with pytest.raises(Unreachable, match=r"T6 at \[2000.0, 0.0, 0.0\] mm"):
        PUMA.inverse(transform(None, [2.0, 0.0, 0.0]), config_word("run"), np.zeros(6))


@pytest.mark.parametrize("name", ["puma560", "stanford"])
def test_the_jacobian_is_the_derivative_of_the_pose_and_its_inverse_undoes_it(name: str) -> None:
    aki = kinematics(name)
    q = 0.5 * (aki.limits.q_min + aki.limits.q_max) + 0.3
    J, step = aki.jacobian(q), 1e-6
    for joint in range(6):
        turned = q + step * np.eye(6)[joint]
        v = (aki.forward(turned)[:3, 3] - aki.forward(q)[:3, 3]) / step
        assert np.allclose(J[:3, joint], v, atol=1e-5)
    assert np.allclose(aki.jacobian_inverse(q) @ J, np.eye(6), atol=1e-9)


def test_a_singular_jacobian_has_no_inverse() -> None:
    with pytest.raises(Singular):
        PUMA.jacobian_inverse(np.radians([0.0, 90.0, -90.0, 0.0, 0.0, 0.0]))


def test_the_stanford_arm_turns_and_slides() -> None:
    aki = kinematics("stanford")
    assert aki.structure == "RRPRRR"
    q = load_robot("stanford").poses["end"]
    assert np.allclose(aki.inverse(aki.forward(q), aki.branch(q), q), q, atol=1e-9)


@pytest.mark.parametrize(("letters", "word"), [("run", 0), ("lun", 1), ("rdn", 2), ("ruf", 4), ("ldf", 7)])
def test_a_configuration_word_has_a_bit_for_each_choice(letters: str, word: int) -> None:
    assert config_word(letters) == word
    assert config_letters(word) == letters


@pytest.mark.parametrize("bad", ["lrn", "x", 3, None])
def test_a_configuration_is_named_by_its_letters(bad: object) -> None:
    with pytest.raises(MotionError):
        config_word(bad)  # type: ignore[arg-type]


def test_layers_are_chosen_by_name_and_a_program_may_bring_its_own() -> None:
    assert {"puma", "stanford"} <= set(kinematics_names())
    made = []
    register_kinematics("mine", lambda robot: made.append(robot.name) or PUMA)
    assert kinematics("puma560", "mine") is PUMA
    assert made == ["puma560"]
    with pytest.raises(ConfigError, match="no kinematics layer 'yours'; there are"):
        kinematics("puma560", "yours")
