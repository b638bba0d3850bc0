"""A machine that stands still stops an emulated arm's world with it: nothing comes of it."""

from __future__ import annotations

import threading

import pytest

from benchmarks.stalls import Stalls, stall_again_and_again, swing
from tests.support.shared_arm import SharedArm

pytestmark = pytest.mark.realtime

TIMES, SEED = 8, 6
TRIES, TOGETHER_S = 3, 0.005  # a run in which the signals themselves came so far apart stopped nobody at once


def test_all_processes_of_a_moving_arm_may_stop_at_once_and_go_on(shared_arm: SharedArm) -> None:
    """Two of these stalls are longer than the guardian's bound of 200 ms; the whole campaign is a benchmark."""
    for _ in range(TRIES):
        found = stalls_of_a_moving_arm(shared_arm)
        if found.apart_s < TOGETHER_S:
            break
    assert (found.events, found.times) == ([], TIMES)
    assert 0.5 * found.stopped_s < found.slipped_s
    assert found.largest_error < 0.02


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
