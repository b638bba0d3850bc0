"""The cycle on other arms than the PUMA, at other rates, and the bits it writes beside torque."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.config import load_robot
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
from qrobot.modecodes import Mode
from qrobot.servo.laws.law import KP
from qrobot.servo.settings import ServoSettings
from qrobot.servo.state import MAX_OPS
from tests.support.servo_bench import ServoBench, moving, writes_at


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


def test_discrete_is_written_until_the_board_shows_it_and_then_when_it_changes_and_every_dac_every_tick() -> None:
    bench = ServoBench().hold()
    bench.tick(100)
    ticks = {write.t_ns for write in bench.writes}
    assert all(sum(offset >= DAC for offset, _ in writes_at(bench, t_ns)) == N_DACS for t_ns in ticks)
    discrete = [write for write in bench.writes if write.offset == DISCRETE]
    powered = [write for write in discrete if write.value & DISCRETE_POWER]
    assert len(powered) == 1
    assert discrete[-1] == powered[0]
    assert len({write.value for write in discrete}) == 2  # at start, and power
    assert len(discrete) <= 1 + 4  # without power until two newer images show it, see `servo.checks.guardian_arming`
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
