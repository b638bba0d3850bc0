"""Motion in which a hand leads the arm, or a program drives joints by torque, tells nothing of the arm."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.errors import IdentificationError
from qrobot.ident.motion import observe_motion
from qrobot.ident.observe import Observer, steady_passes
from qrobot.ident.session import identify_log
from qrobot.modecodes import Mode
from qrobot.rccl_bridge.request_port import tell_key
from qrobot.servo.memory.setpoint_queue import TORQUE_SETPOINT
from qrobot.servo.memory.telemetry import Rows
from tests.support.observations import puma_base
from tests.support.servo_bench import ServoBench, cruise, play

PUMA = load_robot("puma560")
STREAM, PERIOD_S, SECONDS = 1, 0.001, 9.0
PARK, RATES = np.array(PUMA.poses["park"]), np.array([0.15, 0.0, 0.0, 0.2, 0.0, 0.3])
ALL, ONE = range(PUMA.n), (0,)


@cache
def recorded(by_torque: tuple[int, ...] = (), key: bool = False) -> Rows:
    """A real servo's telemetry of an arm that turns steadily, some joints driven by torque, its key held or not."""
    bench, path = ServoBench(PUMA), cruise(PARK, RATES)
    bench.hold().follows = not by_torque
    start_ns = bench.now_ns

    def lead(now_ns: int) -> None:
        if key:
            tell_key(bench.mailbox, STREAM, now_ns)
        if by_torque:
            bench.q = path((now_ns - start_ns) * 1e-9)

    def give_way(_seq: int, modes: list[int], values: Floats) -> None:
        for joint in by_torque:
            modes[joint], values[joint] = TORQUE_SETPOINT, 0.0

    bench.before.append(lead)
    play(bench, path, edit=give_way)
    first = len(bench.rows())
    bench.run(SECONDS)
    assert bench.mode is Mode.TRACKING
    return bench.rows()[first:]


LED = pytest.mark.parametrize(("by_torque", "key"), [(tuple(ALL), True), (tuple(ALL), False), (ONE, False)])


def test_the_same_motion_of_joints_that_are_led_to_positions_is_a_pass() -> None:
    assert sum(p.stop - p.start for p in steady_passes(recorded(), PERIOD_S)) > 0.8 * SECONDS / PERIOD_S
    assert len(observe_motion(PUMA, *puma_base(), recorded(), PERIOD_S))


@LED
def test_nothing_is_taken_of_an_arm_that_something_else_moves(by_torque: tuple[int, ...], key: bool) -> None:
    rows = recorded(by_torque, key)
    assert np.abs(rows["v_ref"]).max() > 0.1
    assert steady_passes(rows, PERIOD_S) == []
    with pytest.raises(IdentificationError, match="nothing recorded moves for long"):
        observe_motion(PUMA, *puma_base(), rows, PERIOD_S)
    with pytest.raises(IdentificationError, match="nothing recorded moves steadily"):
        identify_log(PUMA, rows, PERIOD_S)


@LED
def test_observations_of_a_recording_are_the_same_when_an_arm_was_led_behind_it(
    by_torque: tuple[int, ...], key: bool
) -> None:
    later = recorded(by_torque, key).copy()
    later["tick"] += recorded()["tick"][-1] + 1000
    for alone, both in zip(*map(values, (recorded(), np.concatenate([recorded(), later]))), strict=True):
        np.testing.assert_array_equal(both, alone)


def values(rows: Rows) -> Iterator[np.ndarray]:
    observed = Observer(PUMA, *puma_base()).observe(rows, PERIOD_S)
    assert len(observed)
    return iter(vars(observed).values())
