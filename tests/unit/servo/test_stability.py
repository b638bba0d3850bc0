"""Gains are judged as the arm would: against an arm simulated on its own, and at both sides of each limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.config import Robot, load_robot
from qrobot.config.robot import Friction
from qrobot.errors import ConfigError
from qrobot.model.dynamics import dynamics_params
from qrobot.model.inertia import mass_matrices, mass_matrix
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.laws.law import KP, KV, M0
from qrobot.servo.laws.stability import (
    INWARDS,
    Loop,
    allowed_range,
    are_sound,
    check_gains,
    damping_of,
    inertia_alone,
    loop_of,
    spectral_radius,
)
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.dynamics import model_mass_matrix
from tests.support.transport_rig import RareRig

PUMA, STANFORD = load_robot("puma560"), load_robot("stanford")
ROBOTS = {robot.name: robot for robot in (PUMA, STANFORD)}
TICKS = 400
STEP = 0.002
DECAYED, SHAKES = 0.5, 0.5  # of the step: what the encoder's steps leave, and what the motors' full torque allows


def with_gains(robot: Robot, **gains: Any) -> Robot:
    """The robot with other rows of gains; a pair (joint, value) changes one joint."""
    rows = {}
    for name, value in gains.items():
        row = np.array(getattr(robot.control, name))
        row[value[0]] = value[1]
        rows[name] = row
    return robot.model_copy(update={"control": robot.control.model_copy(update=rows)})


def without_friction(robot: Robot) -> Robot:
    zero = np.zeros(robot.n)
    none = Friction.model_construct(viscous=zero, coulomb_pos=zero, coulomb_neg=zero, stiction_factor=1.0)
    control = robot.control.model_copy(update={"gravity_joints": np.ones(robot.n, dtype=np.bool_)})
    return robot.model_copy(update={"friction": {control.friction_preset: none}, "control": control})


def amplitude(
    robot: Robot,
    settings: ServoSettings,
    joint: int,
    ticks: int = TICKS,
    new_rig: Callable[..., LockstepRig] = LockstepRig,
) -> float:
    """Largest error in the last tenth of a step response on the emulated board, in steps. The guard looks away."""
    rig = new_rig(robot, settings, Emulator(robot, physics="rigid", start="ready"))
    for limit in (rig.params.following_error, rig.params.v_max, rig.params.a_stop, rig.params.range_margin):
        limit[:] = np.inf
    watch = rig.params.watch
    for limit in (watch.unexplained, watch.impossible, watch.runaway_speed, watch.holds_up, watch.holds_down):
        limit[:] = np.inf
    rig.mailbox.request_power(True)
    rig.run_for(0.3)
    rig.take_rows()
    rig.state.q_ref[joint] += STEP
    rig.ticks(ticks)
    error = rig.rows()["q_ref"] - rig.rows()["q"]
    return float(np.abs(error[-ticks // 10 :, joint]).max() / STEP)


def critical(robot: Robot, settings: ServoSettings, row: str, joint: int, outwards: float, delay: int = 0) -> float:
    """Factor on a gain of a joint at which the pole leaves the circle; in lock-step the calculation takes no time."""
    inertia = mass_matrix(dynamics_params(robot), robot.poses["ready"])[None]
    period_s, control = settings.period_ns * 1e-9, robot.control
    observer = settings.velocity == "observer"
    hertz = control.velocity_observer_hz if observer else control.velocity_filter_hz
    loop = Loop(period_s, delay, observer, 2.0 * np.pi * hertz, np.array(control.inertia))

    def stable(factor: float) -> bool:
        found = with_gains(robot, **{row: (joint, getattr(control, row)[joint] * factor)}).control
        return spectral_radius(inertia, loop, found.kp, found.kv) < 1.0

    inside, outside = 1.0, outwards
    assert stable(inside)
    assert not stable(outside)
    for _ in range(30):
        middle = float(np.sqrt(inside * outside))
        inside, outside = (middle, outside) if stable(middle) else (inside, middle)
    return inside


@pytest.mark.sampled(6)
@pytest.mark.parametrize("velocity", ["difference", "observer"])
@pytest.mark.parametrize("row", ["kp", "kv"])
@pytest.mark.parametrize("joint", [0, 2, 4])
def test_a_simulated_arm_decays_below_the_limit_of_a_gain_and_shakes_above_it(
    velocity: str, row: str, joint: int
) -> None:
    settings, robot = ServoSettings(rate_hz=500.0, velocity=velocity), without_friction(PUMA)
    limit = critical(robot, settings, row, joint, 1e4) * getattr(robot.control, row)[joint]
    assert amplitude(with_gains(robot, **{row: (joint, limit / 1.3)}), settings, joint) < DECAYED
    assert amplitude(with_gains(robot, **{row: (joint, limit * 1.3)}), settings, joint) > SHAKES


@pytest.mark.sampled(2)
@pytest.mark.parametrize("velocity", ["difference", "observer"])
@pytest.mark.parametrize("lasts", [0, 1])
def test_so_it_does_behind_a_gateway_where_a_torque_acts_one_exchange_later_or_two(lasts: int, velocity: str) -> None:
    """Two where the servo computes while an exchange is under way."""
    settings, robot = ServoSettings(rate_hz=500.0, velocity=velocity, pots=False), without_friction(PUMA)
    limit = critical(robot, settings, "kp", 0, 1e4, delay=1 + lasts) * robot.control.kp[0]

    def error(kp: float) -> float:
        return amplitude(with_gains(robot, kp=(0, kp)), settings, 0, new_rig=partial(RareRig, cycles=1, lasts=lasts))

    assert error(limit / 1.3) < DECAYED
    assert error(limit * 1.3) > SHAKES


@pytest.mark.parametrize("joint", [0, 2, 4])
def test_a_simulated_arm_with_too_little_damping_swings_up(joint: int) -> None:
    settings, robot = ServoSettings(rate_hz=500.0), without_friction(PUMA)
    stiff = with_gains(robot, kp=(joint, 8.0 * robot.control.kp[joint]))
    limit = critical(stiff, settings, "kv", joint, 1e-4) * robot.control.kv[joint]
    assert amplitude(with_gains(stiff, kv=(joint, 4.0 * limit)), settings, joint, 3 * TICKS) < DECAYED
    assert amplitude(with_gains(stiff, kv=(joint, 0.0)), settings, joint, 3 * TICKS) > SHAKES


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
@pytest.mark.parametrize("velocity", ["difference", "observer"])
@pytest.mark.parametrize("rate_hz", [1000.0, 2000.0, 4000.0, 10_000.0])
@pytest.mark.parametrize("law", ["qrobot", "computed-torque"])
def test_the_gains_that_are_shipped_pass(robot: Robot, velocity: str, rate_hz: float, law: str) -> None:
    check_gains(robot, ServoSettings(rate_hz=rate_hz, velocity=velocity, law=law))


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
@pytest.mark.parametrize(
    "gains", [{"kv": (2, 0.0)}, {"kp": (2, 1e9)}, {"kp": (2, np.nan)}, {"kv": (2, np.inf)}, {"kv": (2, 1e9)}]
)
def test_gains_far_outside_are_refused_by_joint(robot: Robot, gains: dict[str, tuple[int, float]]) -> None:
    with pytest.raises(ConfigError, match=r"^CFG_GAIN: .*joint 3 \("):
        check_gains(with_gains(robot, **gains), ServoSettings())


def test_a_rate_too_low_for_the_gains_is_refused() -> None:
    check_gains(PUMA, ServoSettings(rate_hz=500.0))
    with pytest.raises(ConfigError, match=r"cycles of 10 ms.*joint 1 .*for example Kp .*raise rate_hz"):
        check_gains(PUMA, ServoSettings(rate_hz=100.0))


def test_a_slow_gateway_is_as_bad_as_a_slow_servo() -> None:
    check_gains(PUMA, ServoSettings(rate_hz=4000.0, exchange_ms=2.0))
    with pytest.raises(ConfigError, match="cycles of 10 ms"):
        check_gains(PUMA, ServoSettings(rate_hz=4000.0, exchange_ms=10.0))


def test_gains_that_shake_an_arm_whose_gateway_answers_in_the_second_exchange_are_refused() -> None:
    """With a delay of one they bear the double."""
    settings = ServoSettings(rate_hz=250.0, velocity="observer")
    check_gains(PUMA, settings)
    with pytest.raises(ConfigError, match="cycles of 4 ms"):
        check_gains(PUMA, replace(settings, exchange_ms=4.0))


def test_exchanges_that_all_pass_within_a_cycle_answer_in_it() -> None:
    settings = ServoSettings(rate_hz=250.0, velocity="observer", exchange_ms=0.5)
    assert loop_of(PUMA, settings).latest == 0
    check_gains(PUMA, settings)
    assert loop_of(PUMA, replace(settings, exchange_ms=2.0)).latest == 2


@pytest.mark.parametrize(
    ("robot", "velocity"),
    [(PUMA, "difference"), (PUMA, "observer"), (STANFORD, "difference")],
    ids=["puma", "puma observed", "stanford"],
)
@pytest.mark.parametrize("law", ["qrobot", "computed-torque"])
def test_the_gains_that_are_shipped_pass_at_the_rate_of_modbus_and_can(robot: Robot, velocity: str, law: str) -> None:
    check_gains(robot, ServoSettings(rate_hz=500.0, exchange_ms=2.0, velocity=velocity, law=law))


def test_who_signs_for_gains_gets_them_and_drives_that_close_the_loop_need_none() -> None:
    wild = with_gains(PUMA, kp=(2, 1e9))
    check_gains(wild, ServoSettings(unchecked_gains=True))
    check_gains(wild, ServoSettings(position_drives=True))


def test_a_law_that_divides_by_the_inertia_needs_a_fair_one() -> None:
    gains = np.array([PUMA.control.kp, PUMA.control.kv, PUMA.control.inertia])
    check_gains(PUMA, ServoSettings(), "computed-torque", gains)
    for wrong in (0.0, 1e-3):
        gains[M0, 1] = wrong
        check_gains(PUMA, ServoSettings(), "qrobot+a", gains)
        with pytest.raises(ConfigError, match="CFG_GAIN"):
            check_gains(PUMA, ServoSettings(), "computed-torque", gains)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
@pytest.mark.parametrize("row", [KP, KV])
def test_what_is_told_as_allowed_is_so_on_the_whole_arm_and_nothing_beyond_it(robot: Robot, row: int) -> None:
    loop, inertia = loop_of(robot, ServoSettings()), mass_matrices(robot)
    for j in range(robot.n):
        alone = inertia_alone(inertia, j)

        def is_sound(value: float, j: int = j, alone: Any = alone) -> bool:
            gains = [robot.control.kp[[j]].copy(), robot.control.kv[[j]].copy()]
            gains[row][0] = value
            one = Loop(loop.period_s, loop.delay, loop.observer, loop.bandwidth, loop.inertia[[j]])
            return are_sound(alone, one, *gains)

        found = allowed_range(is_sound)
        assert found is not None
        low, high = found
        assert not is_sound(1.01 * high)
        assert row == KP or not is_sound(low / 1.01)
        for value in (max(low, 1e-2) * INWARDS, high / INWARDS):
            gains = np.array([robot.control.kp, robot.control.kv])
            gains[row, j] = value
            assert are_sound(inertia, loop, gains[KP], gains[KV])


@given(real=st.floats(-400.0, 400.0), imaginary=st.floats(0.0, 2000.0))
def test_the_damping_of_a_pole_is_that_of_its_root(real: float, imaginary: float) -> None:
    s = complex(real, imaginary)
    if abs(s) < 1.0:
        return
    assert damping_of(np.array([np.exp(s * 1e-3)]))[0] == pytest.approx(-real / abs(s), abs=1e-6)


def test_the_mass_matrix_is_that_of_the_oracle() -> None:
    params = dynamics_params(PUMA)
    for q in PUMA.poses.values():
        np.testing.assert_allclose(mass_matrix(params, q), model_mass_matrix(params, q), atol=1e-10)


def test_a_payload_makes_the_arm_heavier_and_never_lighter() -> None:
    inertia = mass_matrices(PUMA)
    empty, loaded = np.split(inertia, 2)
    assert (np.linalg.eigvalsh(loaded - empty) >= -1e-9).all()
    assert loaded[:, 0, 0].max() > empty[:, 0, 0].max() + 1.0
