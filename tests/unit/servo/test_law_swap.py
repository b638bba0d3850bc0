"""Another law or other gains in a running servo: the arm does not notice, and a bad law does not get in."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.config import load_robot
from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.realtime.flat_record import record_of
from qrobot.rig.lockstep import LockstepRig
from qrobot.servo.laws.law import KP, KV, Law, Setting, law
from qrobot.servo.laws.law_swap import (
    FADE_S,
    NO_TORQUE,
    NOT_NOW,
    SWAPPED,
    ask_for_law,
    fade_bias,
    fall_back,
    install,
    make_swap_state,
    maybe_swap_result,
)
from qrobot.servo.laws.shipped import LAWS, find_law
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from tests.support.servo_bench import ServoBench, moving

ROBOT = load_robot("puma560")
PD, QROBOT = find_law("pd", ROBOT), find_law("qrobot", ROBOT)
RING = list(itertools.pairwise([*LAWS, next(iter(LAWS))]))
PAIRS = [*RING, *((after, before) for before, after in RING)]  # every law gives to two others and takes from them


def swap(bench: ServoBench, new: Law, gains: Any | None = None) -> int | None:
    state = bench.state.swap
    ask_for_law(state, new, state.gains if gains is None else gains)
    assert maybe_swap_result(state) is None
    bench.tick()
    return maybe_swap_result(state)


SOFT_COUNTS = 10  # a tenth of the stiffness, by which what is left of a motion goes as much further
QUIET = {"force": {"creep": 0.0, "travel": 0.0}}  # it would go and look for something to press on


def holding_rig(pose: Any, name: str) -> LockstepRig:
    emulator = Emulator(ROBOT, start=pose, physics="rigid")
    settings = ServoSettings(rate_hz=1000.0, law=name, law_settings=QUIET.get(name, {}), sensor_channels=(6,))
    rig = LockstepRig(ROBOT, settings, emulator, keep_telemetry=False)
    rig.ticks(1)
    rig.mailbox.request_power(True)
    rig.run_for(0.5)
    assert rig.mailbox.snapshot().mode == Mode.HOLDING
    return rig


def at_rest(rig: LockstepRig) -> Any:
    """Counts, once none has changed for a tenth of a second."""
    for _ in range(100):
        counts = np.array(rig.state.counts)
        rig.run_for(0.1)
        if np.array_equal(counts, rig.state.counts):
            return counts
    raise AssertionError("the arm never comes to rest")


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("before", "after"), PAIRS)
@settings(max_examples=2)
@given(st.lists(st.floats(0.1, 0.9), min_size=6, max_size=6), st.floats(0.3, 2.0))
def test_a_swap_while_holding_moves_no_joint_by_more_than_a_count(
    before: str, after: str, share: list[float], factor: float
) -> None:
    q_min, q_max = ROBOT.limits.q_min, ROBOT.limits.q_max
    rig = holding_rig(q_min + np.array(share) * (q_max - q_min), before)
    counts = at_rest(rig)
    new = find_law(after, rig.robot, QUIET.get(after))
    ask_for_law(rig.state.swap, new, factor * rig.state.swap.gains)
    for _ in range(20):
        rig.run_for(0.1)
        assert np.abs(np.array(rig.state.counts) - counts).max() <= (SOFT_COUNTS if new.compliant else 1)
    assert maybe_swap_result(rig.state.swap) == SWAPPED
    assert rig.mailbox.snapshot().mode == Mode.HOLDING


def test_the_torque_goes_on_to_the_last_bit_and_the_new_law_answers_to_what_happens_next() -> None:
    bench = ServoBench(law="qrobot").hold()
    bench.run(0.2)
    before = bench.snapshot.tau.copy()
    assert abs(before[1]) > 5.0
    assert swap(bench, PD) == SWAPPED
    assert np.array_equal(bench.snapshot.tau, before)
    bench.tick()
    np.testing.assert_allclose(bench.snapshot.tau, before, atol=1e-9)
    bench.follows = False
    bench.q[1] += 1e-3
    bench.run(0.2)
    assert bench.snapshot.tau[1] == pytest.approx(before[1] - 1e-3 * bench.params.gains[KP, 1], rel=0.05)


def test_new_gains_are_in_force_after_the_swap() -> None:
    bench = ServoBench(law="pd").hold()
    gains = np.array(bench.state.swap.gains)
    gains[KP] *= 0.5
    gains[KV] *= 0.7
    assert swap(bench, PD, gains) == SWAPPED
    np.testing.assert_array_equal(bench.state.swap.gains, gains)


def test_the_bias_fades_while_the_arm_tracks_and_only_then() -> None:
    bench = ServoBench(law="qrobot").hold()
    swap(bench, PD)
    bias = np.array(bench.state.swap.bias)
    bench.run(1.0)
    np.testing.assert_array_equal(bench.state.swap.bias, bias)
    moving(bench)
    assert bench.mode is Mode.TRACKING
    assert 0.0 < abs(bench.state.swap.bias[1]) < abs(bias[1])


@given(st.floats(-50.0, 50.0), st.floats(1e-4, 0.1))
def test_the_bias_decays_with_its_time_constant_however_long_a_cycle_lasts(bias: float, dt: float) -> None:
    state = ServoBench().state.swap
    state.bias[:] = bias
    fade_bias(state, dt)
    np.testing.assert_allclose(state.bias, bias * np.exp(-dt / FADE_S), rtol=1e-12, atol=1e-12)


def test_power_up_begins_without_a_bias() -> None:
    bench = ServoBench(law="qrobot").hold()
    swap(bench, PD)
    bench.mailbox.request_power(False)
    bench.run(0.1)
    bench.hold()
    np.testing.assert_array_equal(bench.state.swap.bias, 0.0)


def test_no_swap_while_the_arm_moves_and_the_old_law_stays() -> None:
    bench = ServoBench(law="qrobot").hold()
    moving(bench)
    assert bench.mode is Mode.TRACKING
    assert swap(bench, PD) == NOT_NOW
    assert bench.state.swap.law_at == QROBOT.address


def test_without_power_the_next_law_is_simply_the_law() -> None:
    bench = ServoBench(law="qrobot").tick()
    assert bench.mode is Mode.OFF
    assert swap(bench, PD) == SWAPPED
    assert bench.state.swap.law_at == PD.address
    np.testing.assert_array_equal(bench.state.swap.bias, 0.0)


@law
def no_torque(
    q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, gravity: Any, friction: Any,
    sensors: Any, gains: Any, memory: Any, tau: Any,
) -> None:  # fmt: skip
    """Divides by zero on joint 3."""
    memory[0] = 1.0
    for j in range(tau.size):
        tau[j] = 0.0
    tau[2] = np.nan


def test_a_law_that_gives_no_torque_does_not_get_in_and_the_arm_is_held() -> None:
    bench = ServoBench(law="qrobot").hold()
    before = bench.snapshot.tau.copy()
    assert swap(bench, no_torque) == NO_TORQUE
    bench.run(0.1)
    assert (bench.mode, bench.fault) == (Mode.HOLDING, FaultCode.NONE)
    np.testing.assert_allclose(bench.snapshot.tau, before, atol=1e-9)
    assert bench.state.memory[0] == 0.0  # nor has it left anything behind


@law
def fails_later(
    q_ref: Any, v_ref: Any, a_ref: Any, q: Any, v: Any, gravity: Any, friction: Any,
    sensors: Any, gains: Any, memory: Any, tau: Any,
) -> None:  # fmt: skip
    """No torque of its own, and none at all from its third call."""
    memory[0] += 1.0
    for j in range(tau.size):
        tau[j] = 0.0 if memory[0] < 3.0 else np.nan


def test_a_law_that_fails_after_the_swap_takes_its_bias_with_it() -> None:
    bench = ServoBench(law="qrobot").hold()
    assert swap(bench, fails_later) == SWAPPED
    assert abs(bench.state.swap.bias[1]) > 5.0
    bench.run(0.01)
    assert (bench.mode, bench.fault) == (Mode.FAULT, FaultCode.LAW_NAN)
    np.testing.assert_array_equal(bench.state.swap.bias, 0.0)


def test_the_law_that_comes_back_has_the_gains_that_were_judged_for_it() -> None:
    bench = ServoBench().hold()
    state = bench.state.swap
    assert swap(bench, PD) == SWAPPED
    judged = np.array(state.gains)
    assert swap(bench, fails_later) == SWAPPED
    assert swap(bench, fails_later, 3.0 * judged) == SWAPPED
    bench.until(lambda: bench.mode is Mode.FAULT, 2.0)
    bench.mailbox.request_clear()
    bench.until(lambda: bench.mode is Mode.OFF, 2.0)
    assert state.law_at == PD.address
    np.testing.assert_array_equal(state.gains, judged)


def test_when_the_law_that_came_back_fails_too_the_deployments_own_comes_back_and_stays() -> None:
    own = Law(QROBOT.body, (Setting("softness", 1.0, 0.0, 2.0, "", "how soft"),))
    swap_state = record_of(make_swap_state(own, np.full((3, 6), 1.0)))

    def take(new: Law, gains: float, compliant: bool) -> None:
        ask_for_law(swap_state, new, np.full((3, 6), gains))
        swap_state.next_compliant = int(compliant)
        install(swap_state)

    take(own.with_settings({"softness": 1.5}), 2.0, compliant=False)
    take(PD, 3.0, compliant=True)
    take(fails_later, 4.0, compliant=False)
    for address, gains, softness, compliant in (
        (PD.address, 3.0, 0.0, 1),
        (own.address, 2.0, 1.5, 0),
        (own.address, 2.0, 1.5, 0),
    ):
        fall_back(swap_state)
        assert (swap_state.law_at, swap_state.compliant, swap_state.settings[0]) == (address, compliant, softness)
        assert (swap_state.gains == gains).all()
