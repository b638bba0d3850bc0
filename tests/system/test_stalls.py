"""A machine that stands still stops an emulated arm's world with it: nothing comes of it. A servo alone is late."""

from __future__ import annotations

import threading
from pathlib import Path

import numpy as np
import pytest

from benchmarks.stalls import Stalls, slipped_s, stall, stall_again_and_again, swing
from qrobot.modecodes import Mode
from qrobot.servo.memory.telemetry import Rows
from qrobot.servo.operator.client import ServoClient
from qrobot.units import NS_PER_S
from tests.support.patience import wait_until
from tests.support.processes import RunningArm, running_arms
from tests.support.shared_arm import SharedArm

pytestmark = pytest.mark.realtime

TIMES, SEED = 8, 6
TRIES, TOGETHER_S = 3, 0.005  # a run in which the signals themselves came so far apart stopped nobody at once
ALONE_S, TOO_LONG_S = 0.025, 0.06  # beyond it an arm has left its path
RAD_S, AFTER_S = 0.8, 0.03
STILL_S, RATE_HZ = 0.3, 1000


def test_all_processes_of_a_moving_arm_may_stop_at_once_and_go_on(shared_arm: SharedArm) -> None:
    """Two of these stalls are longer than the guardian's bound of 200 ms; the whole campaign is a benchmark."""
    for _ in range(TRIES):
        found = stalls_of_a_moving_arm(shared_arm)
        if found.apart_s < TOGETHER_S:
            break
    assert (found.events, found.times) == ([], TIMES), shared_arm.running().told_of_the_stop()
    assert 0.5 * found.stopped_s < found.slipped_s
    assert found.largest_error < 0.02
    with ServoClient(shared_arm.running().name) as client:
        assert client.status().board.slipped_ms * 1e-3 >= found.slipped_s
    wait_until(lambda: "time stood still for" in shared_arm.running().said("board"), "its board says so")


def test_without_time_slip_a_machine_that_stands_still_makes_a_servo_late(tmp_path: Path) -> None:
    with running_arms(tmp_path, board="time_slip = false") as (arm,):
        before = arm.snapshot().late_cycles
        stall(arm.running().values(), STILL_S)
        missed = 0.5 * STILL_S * RATE_HZ
        wait_until(lambda: arm.snapshot().late_cycles - before > missed, "the servo counts what it missed")
        assert slipped_s(arm.name) == 0.0


def stalls_of_a_moving_arm(shared_arm: SharedArm) -> Stalls:
    shared_arm.park()
    arm, done = shared_arm.running(), threading.Event()
    with arm.control() as channel:
        program = threading.Thread(target=swing, args=(channel, done))
        program.start()
        try:
            return stall_again_and_again(arm.name, lambda: list(arm.running().values()), TIMES, SEED)
        finally:
            done.set()
            program.join()


def test_a_servo_that_is_held_up_alone_for_a_moment_goes_on_without_a_blow(shared_arm: SharedArm) -> None:
    """Its board goes on, so the joint does: the setpoint that the servo compares it with has gone as far."""
    shared_arm.park()
    arm = shared_arm.running()
    for _ in range(TRIES):
        with arm.swinging(RAD_S):
            rows = rows_from_the_longest_cycle(arm)
        held_up_s = float(rows["t_ns"][1] - rows["t_ns"][0]) / NS_PER_S
        if held_up_s < TOO_LONG_S:
            break
    assert held_up_s > 0.5 * ALONE_S  # it was asleep for most of it
    assert set(rows["mode"]) == {Mode.TRACKING}
    gone = np.abs(rows["q"][1] - rows["q"][0]).max()
    assert gone > 0.5 * RAD_S * held_up_s
    assert np.abs(rows["q_ref"] - rows["q"]).max() < 0.2 * gone


def rows_from_the_longest_cycle(arm: RunningArm) -> Rows:
    """Hold its servo up, and see what it did from the cycle before until `AFTER_S` later."""
    before_ns = arm.now_ns()
    stall([arm.pid("servo")], ALONE_S)
    goes_on_ns = arm.now_ns()
    wait_until(lambda: arm.word("heartbeat", "t_ns") > goes_on_ns + 2.0 * AFTER_S * NS_PER_S, "the servo goes on")
    rows = arm.telemetry()
    rows = rows[int(np.searchsorted(rows["t_ns"], before_ns)) - 1 :]
    rows = rows[int(np.diff(rows["t_ns"]).argmax()) :]
    return rows[rows["t_ns"] - rows["t_ns"][1] <= AFTER_S * NS_PER_S]
