"""Amplifiers, friction and brakes against their definitions."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from qrobot.config import load_robot
from qrobot.errors import ConfigError
from qrobot.hwif.registers import DAC_ZERO, N_DACS
from qrobot.sim_board.drive import JointDrives, drive_torque, friction_torque, make_drive
from qrobot.sim_board.mismatch import PlantMismatch

ROBOT = load_robot("puma560")
DT = 0.00025
NOMINAL = PlantMismatch.nominal(6)
STICKY = PlantMismatch(NOMINAL.viscous, NOMINAL.coulomb_pos, NOMINAL.coulomb_neg, NOMINAL.torque_gain, 1.0, 1.3)
CORKE = ROBOT.friction["corke"]


def torque_of(
    drive: JointDrives, dac: list[int], velocity: NDArray[np.float64], powered: bool = True
) -> NDArray[np.float64]:
    words, tau = np.full(N_DACS, DAC_ZERO), np.zeros(6)
    words[: len(dac)] = dac
    drive_torque(drive, words, powered, np.zeros(6), velocity, tau)
    return tau


def slide(drive: JointDrives, joint: int, velocity: float, steps: int = 2000, braked: float = 0.0) -> float:
    """Friction after moving at one velocity for a while."""
    torque = 0.0
    for _ in range(steps):
        torque = friction_torque(drive, joint, velocity, braked)
    return torque


@given(st.lists(st.integers(0, 0xFFF), min_size=6, max_size=6))
def test_amplifiers_give_nothing_while_power_is_off(dac: list[int]) -> None:
    drive = make_drive(ROBOT, NOMINAL, "corke", DT)
    assert torque_of(drive, dac, np.zeros(6), powered=False).tolist() == [0.0] * 6


def test_full_scale_is_the_vendors() -> None:
    """2048 counts over the vendor's motorScale: 102.45 186.7 90.42 24.15 20.97 21.56 N m, J2 and J4-J6 inverted."""
    drive = make_drive(ROBOT, NOMINAL, "corke", DT)
    torque_of(drive, [0] * 6, np.zeros(6))
    published = [-102.45, 186.7, -90.42, 24.15, 20.97, 21.56]
    np.testing.assert_allclose(drive.tau_motor, published, rtol=3e-4)


def test_rising_dac_code_turns_every_motor_towards_rising_counts() -> None:
    """The polarity test of power-up: the signs of torque scale and encoder scale agree on every axis [V]."""
    drive = make_drive(ROBOT, NOMINAL, "corke", DT)
    torque_of(drive, [DAC_ZERO + 100] * 6, np.zeros(6))
    assert (np.sign(drive.tau_motor) == ROBOT.transmission.count_sign).all()


@given(st.lists(st.integers(0, 0xFFF), min_size=6, max_size=6), st.lists(st.floats(-3, 3), min_size=6, max_size=6))
def test_power_is_the_same_on_both_sides_of_the_coupling(dac: list[int], velocity: list[float]) -> None:
    drive, v = make_drive(ROBOT, NOMINAL, "corke", DT), np.array(velocity)
    tau = torque_of(drive, dac, v)
    motor_side = drive.tau_motor @ (ROBOT.transmission.coupling @ v)
    assert tau @ v == pytest.approx(motor_side, rel=1e-9, abs=1e-9)


def test_joint_6_torque_reaches_joint_5_through_the_wrist() -> None:
    """20 N m of motor 6 put 3.6 N m on joint 5 (C^T, k56 = 13/72)."""
    drive = make_drive(ROBOT, NOMINAL, "corke", DT)
    tau = torque_of(drive, [DAC_ZERO] * 5 + [DAC_ZERO - 1900], np.zeros(6))
    assert tau[5] == pytest.approx(20.0)
    assert tau[4] == pytest.approx(3.61, abs=0.005)


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("velocity", [-1.0, -0.3, 0.3, 1.0])
def test_sliding_friction_is_the_published_line_in_each_direction(joint: int, velocity: float) -> None:
    drive = make_drive(ROBOT, NOMINAL, "corke", DT)
    coulomb = CORKE.coulomb_pos[joint] if velocity > 0 else -CORKE.coulomb_neg[joint]
    assert slide(drive, joint, velocity) == pytest.approx(coulomb + CORKE.viscous[joint] * velocity)


@pytest.mark.parametrize("joint", range(6))
def test_with_stiction_a_joint_breaks_away_above_the_level_it_slides_at(joint: int) -> None:
    drive = make_drive(ROBOT, STICKY, "corke", DT)
    creeping = slide(drive, joint, 1e-4)
    assert creeping == pytest.approx(1.3 * CORKE.coulomb_pos[joint], rel=1e-3)
    fast = slide(drive, joint, 50 / drive.stribeck_slowness[joint])
    viscous = CORKE.viscous[joint] * 50 / drive.stribeck_slowness[joint]
    assert fast - viscous == pytest.approx(CORKE.coulomb_pos[joint], rel=1e-3)


@given(st.integers(0, 5), st.lists(st.floats(-2.0, 2.0), min_size=1, max_size=60), st.sampled_from([0.0, 1.0]))
def test_friction_gives_back_no_more_than_its_bristle_stored(
    joint: int, velocities: list[float], braked: float
) -> None:
    drive = make_drive(ROBOT, STICKY, "corke", DT)
    taken, stiffness = 0.0, drive.stiffness_dt[joint] / DT
    for v in velocities:
        before = drive.load[joint]
        torque = friction_torque(drive, joint, v, braked)
        stored = (drive.load[joint] ** 2 - before**2) / (2.0 * stiffness)
        taken = torque * v * DT
        step_error = 0.5 * stiffness * (v * DT) ** 2 + (1.0 + drive.damping_share[joint]) * 1e-9
        assert taken - stored >= -step_error


def test_a_brake_holds_more_than_its_motor_can_give_on_joints_1_to_3_only() -> None:
    drive = make_drive(ROBOT, NOMINAL, "corke", DT)
    full_scale = 2048 / np.abs(ROBOT.transmission.dac_per_Nm)
    held = np.array([slide(drive, joint, 1e-3, braked=1.0) for joint in range(6)])
    assert (held[:3] > 2.0 * full_scale[:3]).all()
    assert (held[3:] < full_scale[3:] / 10).all()


def test_the_mismatched_plant_is_one_fixed_draw_at_its_bounds() -> None:
    draw, again = PlantMismatch.mismatched(6), PlantMismatch.mismatched(6)
    for name in ("viscous", "coulomb_pos", "coulomb_neg"):
        assert set(getattr(draw, name)) <= {0.7, 1.3}
        np.testing.assert_array_equal(getattr(draw, name), getattr(again, name))
    assert set(draw.torque_gain) == {0.8, 1.2}
    assert (draw.gravity, draw.stiction) == (1.05, 1.3)
    assert (draw.coulomb_pos != draw.coulomb_neg).any()


def test_mismatch_scales_what_the_drive_does() -> None:
    draw = PlantMismatch.mismatched(6)
    drive = make_drive(ROBOT, draw, "corke", DT)
    np.testing.assert_allclose(drive.torque_per_count * ROBOT.transmission.dac_per_Nm, draw.torque_gain)
    np.testing.assert_allclose(drive.coulomb_neg, CORKE.coulomb_neg * draw.coulomb_neg)


def test_an_unknown_friction_preset_is_refused_with_those_that_exist() -> None:
    with pytest.raises(ConfigError, match=r"no friction preset 'none', only corke, akb"):
        make_drive(ROBOT, NOMINAL, "none", DT)
