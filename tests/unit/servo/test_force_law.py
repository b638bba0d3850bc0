"""The law `force`: QRobot's feedback with a spring along one axis that is moved ahead, and bounded."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.model.arm import Arm
from qrobot.servo.laws.force import ADVANCE, CORRECTION, N_KEPT, N_TOLD, PRESSED, TIME, ZERO
from qrobot.servo.laws.law import MEMORY_WORDS, SIGNALS_AT
from qrobot.servo.laws.shipped import find_law
from tests.support.thorough import examples
from tests.unit.servo.test_law import call

ROBOT = load_robot("puma560")
ARM = Arm(ROBOT)
CONTROL = ROBOT.control
GAINS = np.array([CONTROL.kp, CONTROL.kv, CONTROL.inertia])
PARK = np.array(ROBOT.poses["park"])
LAW = find_law("force", ROBOT)
poses = st.lists(st.floats(-1.5, 1.5), min_size=6, max_size=6).map(np.array)
small = st.lists(st.floats(-1e-3, 1e-3), min_size=6, max_size=6).map(np.array)


def tared(correction: float = 0.0, ahead: float = 0.0, pressed: float = 0.0) -> np.ndarray:
    memory = np.zeros(MEMORY_WORDS)
    memory[[TIME, ZERO, PRESSED, ADVANCE, CORRECTION]] = 1.0, 0.05, pressed, ahead, correction
    return memory


def axial_jacobian(q, reach: float = 0.1) -> np.ndarray:
    """Of the tip along z of the tool. Shape (6,)."""
    J, T = ARM.jacobian(q), ARM.forward(q)
    lever = (reach + ROBOT.geometry.flange_m) * T[:3, 2]
    return T[:3, 2] @ (J[:3] + np.cross(J[3:], lever, axisa=0, axisb=0, axisc=0))


@settings(max_examples=examples(40), deadline=None)
@given(poses, small, small, poses, poses)
def test_before_the_sensor_has_its_zero_it_is_qrobots_law(q, error, v, gravity, friction) -> None:
    given_terms = {"q_ref": q + error, "q": q, "v": v, "gravity": gravity, "friction": friction, "gains": GAINS}
    free = LAW.with_settings({"force": 200.0})
    expected = call(find_law("qrobot", ROBOT), **given_terms)
    np.testing.assert_allclose(call(free, **given_terms), expected, rtol=1e-9, atol=1e-8)


@settings(max_examples=examples(40), deadline=None)
@given(poses)
def test_a_spring_that_is_fully_drawn_pulls_with_the_force_through_the_transposed_jacobian(q) -> None:
    memory = tared(ahead=0.02, pressed=20.0)
    tau = call(LAW, q_ref=q, q=q, gains=GAINS, memory=memory, sensors=np.full(8, 0.05 - 2.0))
    np.testing.assert_allclose(tau, 20.0 * axial_jacobian(q), rtol=1e-6, atol=1e-6)


@settings(max_examples=examples(40), deadline=None)
@given(poses, small)
def test_across_the_axis_the_arm_is_as_stiff_as_ever_and_along_it_not_at_all(q, error) -> None:
    """A displacement e along no axial direction, J e = 0, meets Kp e; the rest changes nothing."""
    J = axial_jacobian(q)
    softened = J / CONTROL.kp
    across = error - softened * (J @ error) / (J @ softened)
    here = {"gains": GAINS, "sensors": np.full(8, 0.05 - 2.0), "q": q}
    at_rest = call(LAW, q_ref=q, memory=tared(ahead=0.02, pressed=20.0), **here)
    aside = call(LAW, q_ref=q + across, memory=tared(ahead=0.02, pressed=20.0), **here)
    along = call(LAW, q_ref=q + 1e-4 * softened / np.abs(softened).max(), memory=tared(0.0, 0.02, 20.0), **here)
    np.testing.assert_allclose(aside - at_rest, CONTROL.kp * across, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(along, at_rest, atol=1e-6)


@given(st.floats(-9.9, 9.9), st.floats(-15, 15), st.floats(-100, 100), st.floats(0, 0.02))
@settings(max_examples=examples(100), deadline=None)
def test_whatever_the_sensor_says_the_pull_is_bounded(volts, correction, pressed, ahead) -> None:
    q = PARK
    tau = call(LAW, q_ref=q, q=q, gains=GAINS, memory=tared(correction, ahead, pressed), sensors=np.full(8, volts))
    J = axial_jacobian(q)
    pull = tau @ J / (J @ J)
    assert -1e-6 <= pull <= max(0.0, 20.0 + (20.0 - pressed) * 1.0 + 15.0) + 110.0 / 15.0 + 1e-6


def test_the_zero_is_the_mean_of_what_the_sensor_says_at_first() -> None:
    memory, q, volts = np.zeros(MEMORY_WORDS), PARK, [0.2, 0.3, 0.1, 0.2]
    for value in volts:
        call(LAW, q_ref=q, q=q, gains=GAINS, memory=memory, sensors=np.full(8, value))
    assert memory[ZERO] == pytest.approx(np.mean(volts))
    assert memory[ADVANCE] == memory[CORRECTION] == 0.0


def test_only_the_sensors_own_channel_matters_and_without_it_there_is_no_torque() -> None:
    q, sensors = PARK, np.full(8, np.nan)
    sensors[6] = 0.0
    assert np.isfinite(call(LAW, q_ref=q, q=q, gains=GAINS, sensors=sensors)).all()
    assert np.isnan(call(LAW.with_settings({"channel": 5.0}), q_ref=q, q=q, gains=GAINS, sensors=sensors)).all()


@pytest.mark.parametrize("volts", [9.96, -9.96])
def test_a_reading_at_the_end_of_the_range_is_no_force(volts) -> None:
    q = PARK
    assert np.isnan(call(LAW, q_ref=q, q=q, gains=GAINS, sensors=np.full(8, volts))).all()


def test_what_the_law_does_not_use_of_its_memory_it_leaves() -> None:
    memory, q = np.arange(float(MEMORY_WORDS)), PARK
    call(LAW, q_ref=q, q=q, gains=GAINS, memory=memory)
    unused = [*range(N_KEPT, SIGNALS_AT), *range(N_TOLD, MEMORY_WORDS)]
    assert memory[unused].tolist() == unused


def test_a_robot_with_a_sliding_joint_presses_too() -> None:
    stanford = load_robot("stanford")
    q = next(iter(stanford.poses.values())) + 0.1
    control = stanford.control
    gains = np.array([control.kp, control.kv, control.inertia])
    arm = Arm(stanford)
    J, T = arm.jacobian(q), arm.forward(q)
    expected = 20.0 * (T[:3, 2] @ J[:3])  # the axis goes through the origin of the last frame
    law = find_law("force", stanford)
    tau = call(law, q_ref=q, q=q, gains=gains, memory=tared(0.0, 0.02, 20.0), sensors=np.full(8, 0.05 - 2.0))
    np.testing.assert_allclose(tau, expected, rtol=1e-6, atol=1e-6)
