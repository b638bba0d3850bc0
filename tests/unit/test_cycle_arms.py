"""The cycle on other arms than the PUMA, at other rates, and the bits it writes beside torque."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest

from qrobot.config import Robot, load_robot
from qrobot.config.robot import robot_of
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_CALIBRATED,
    DISCRETE_HAND_CLOSE,
    DISCRETE_HAND_OPEN,
    DISCRETE_POWER,
    N_DACS,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_J6_OVERFLOW,
)
from qrobot.servo.law import KP
from qrobot.servo.modes import Mode
from qrobot.servo.settings import ServoSettings
from qrobot.servo.state import MAX_OPS
from tests.support.servo_bench import ServoBench, cruise, moving, play, writes_at

ONE_SLIDE = """
name = "slide"
about = "one sliding joint"
[joints]
names = ["slide"]
kinds = ["prismatic"]
[geometry]
family = "generic"
alpha_deg = [0]
a_m = [0]
d_m = [0]
theta_deg = [0]
base_height_m = 0.0
flange_m = 0.0
gravity_m_s2 = [0, 0, -9.81]
[limits]
q_min_deg = [0.0]
q_max_deg = [0.5]
v_max_deg_s = [0.4]
a_max = [3.0]
[poses]
park = [0.1]
ready = [0.1]
end = [0.4]
[transmission]
gear = [400]
rotor_inertia = [1e-5]
coupling = {}
counts_per_rev = [1000]
count_sign = [1]
count_offset = [0]
q_offset_deg = [0]
dac_per_Nm = [10.0]
brake = [true]
index_phase = [0]
pot_at_zero = [8192]
pot_per_rev = 150.0
scales = "gear"
[links]
mass = [2.0]
com = [[0, 0, 0]]
inertia = [[0.01, 0.01, 0.01]]
[friction.corke]
viscous = [5.0]
coulomb_pos = [2.0]
coulomb_neg = [3.0]
stiction_factor = 1.0
[control]
kp = [4000]
kv = [200]
inertia = [3.0]
velocity_filter_hz = 40.0
gravity_joints = [true]
friction_preset = "corke"
friction_velocity = [0.02]
[guard]
tau_max = [150.0]
velocity_factor = 1.1
following_error = [0.02]
start_tolerance = 0.005
range_margin = [0.005]
a_stop = [2.5]
[board]
revision = "F"
"""


def sourced(section: dict[str, Any]) -> dict[str, Any]:
    """A section of a robot file with the source that every key has to have."""
    return section | {"source": dict.fromkeys(section, "[A] made up for this test")}


@pytest.fixture(scope="module")
def slide() -> Robot:
    document = tomllib.loads(ONE_SLIDE)
    for name in ("geometry", "limits", "poses", "transmission", "links", "control", "guard", "board"):
        document[name] = sourced(document[name])
    document["friction"] = {name: sourced(preset) for name, preset in document["friction"].items()}
    return robot_of(document, "slide")


def test_an_arm_of_one_sliding_joint_is_held_against_gravity_and_follows(slide: Robot) -> None:
    bench = ServoBench(slide).hold()
    bench.run(0.05)
    assert bench.snapshot.tau[0] == pytest.approx(2.0 * 9.81, abs=0.5)
    assert np.all(bench.dac[1:] == DAC_ZERO)
    play(bench, cruise(bench.q, np.array([0.2])))
    bench.run(0.8)
    assert bench.mode is Mode.TRACKING
    assert bench.snapshot.v[0] == pytest.approx(0.2, rel=0.02)


def test_an_arm_of_one_sliding_joint_is_stopped_before_its_end(slide: Robot) -> None:
    bench = ServoBench(slide).hold()
    play(bench, cruise(bench.q, np.array([0.3])))
    bench.until(lambda: bench.mode is Mode.STOPPING)
    bench.until(lambda: bench.mode is Mode.HOLDING)
    assert 0.3 < bench.q[0] <= 0.5


def test_an_arm_with_a_sliding_joint_among_revolute_ones_tracks() -> None:
    bench = ServoBench(load_robot("stanford"))
    moving(bench, speed=0.2, joint=2)
    assert bench.snapshot.v[2] == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize("rate_hz", [500.0, 1000.0, 2000.0, 4000.0, 10_000.0])
def test_every_rate_holds_and_tracks(rate_hz: float) -> None:
    bench = ServoBench(rate_hz=rate_hz)
    moving(bench, speed=0.7, joint=2, seconds=0.6)
    assert bench.snapshot.missed_frames == 0
    assert bench.settings.period_ns == ServoSettings(rate_hz=rate_hz).period_ns


# ---------------------------------------------------------------------------------------------------- discrete outputs


@pytest.mark.parametrize(
    ("hand", "open_bit", "close_bit"),
    [(0, True, True), (1, False, True), (2, True, False), (7, True, True)],
)
def test_hand_solenoids_are_active_low_and_never_both_on(hand: int, open_bit: bool, close_bit: bool) -> None:
    bench = ServoBench().tick(3)
    bench.mailbox.request_hand(hand)
    bench.tick()
    assert bool(bench.discrete & DISCRETE_HAND_OPEN) is open_bit
    assert bool(bench.discrete & DISCRETE_HAND_CLOSE) is close_bit
    assert not bench.discrete & DISCRETE_POWER
    assert bench.snapshot.hand == hand


def test_the_hand_keeps_what_it_holds_over_power_off() -> None:
    bench = ServoBench().hold()
    bench.mailbox.request_hand(2)
    bench.tick()
    bench.mailbox.request_power(False)
    bench.tick()
    assert not bench.discrete & DISCRETE_HAND_CLOSE
    assert bench.mode is Mode.OFF


def test_discrete_is_written_only_when_it_changes_and_every_dac_every_tick() -> None:
    bench = ServoBench().hold()
    bench.tick(100)
    ticks = {write.t_ns for write in bench.writes}
    assert all(sum(offset >= DAC for offset, _ in writes_at(bench, t_ns)) == N_DACS for t_ns in ticks)
    assert len([write for write in bench.writes if write.offset == DISCRETE]) == 2  # at start, and power
    assert N_DACS + 1 <= MAX_OPS


def test_scratch_bits_of_the_board_survive_everything_the_servo_writes() -> None:
    bench = ServoBench()
    bench.status = STATUS_CALIBRATED | STATUS_J6_OVERFLOW | STATUS_ESTOP_OK
    bench.tick(3)
    bench.status = None
    bench.hold()
    bench.mailbox.request_hand(1)
    bench.tick()
    bench.estop_ok = False
    bench.tick()
    assert bench.mode is Mode.FAULT
    kept = DISCRETE_CALIBRATED | STATUS_J6_OVERFLOW
    assert all(write.value & kept == kept for write in bench.writes if write.offset == DISCRETE)


def test_spare_dacs_stay_at_zero_torque() -> None:
    bench = ServoBench()
    moving(bench)
    assert all(write.value == DAC_ZERO for write in bench.writes if write.offset >= DAC + 2 * 6)


# ------------------------------------------------------------------------------------------------------------- torque


def test_torque_is_clipped_to_the_limit_and_counted_not_faulted() -> None:
    bench = ServoBench().hold()
    bench.state.swap.gains[KP] = 1e6
    bench.follows = False
    bench.q = bench.q + 2e-3 * np.eye(6)[3]
    bench.run(0.1)
    rows = bench.rows()
    assert bench.mode is Mode.HOLDING
    assert rows["tau"][:, 3].min() == -bench.robot.guard.tau_max[3]
    assert (rows["flags"][-1] >> 8) & 0xFF >= 1


def test_friction_is_compensated_where_the_motors_are() -> None:
    """Joint 4 alone turns motors 4, 5 and 6: their friction comes back through the wrist coupling."""
    bench = ServoBench()
    moving(bench, speed=0.5, joint=3)
    coupling, friction = bench.robot.transmission.coupling, bench.robot.friction["corke"]
    rates = coupling @ np.array([0, 0, 0, 0.5, 0, 0])
    coulomb = np.where(rates > 0, friction.coulomb_pos, friction.coulomb_neg)
    smooth = np.tanh(rates / bench.robot.control.friction_velocity)
    expected = coupling.T @ (friction.viscous * rates + coulomb * smooth)
    np.testing.assert_allclose(bench.state.friction[3:], expected[3:], rtol=0.25, atol=0.02)
    assert bench.state.friction[0] == 0.0


def test_gravity_is_compensated_on_the_joints_of_the_robot_file_only() -> None:
    bench = ServoBench(pose="stretched").hold()
    bench.run(0.1)
    assert list(bench.state.gravity != 0.0) == [False, True, True, False, False, False]
    assert bench.state.gravity[1] == pytest.approx(-46.07, abs=0.6)  # Corke 1994's parameters, arm stretched level
