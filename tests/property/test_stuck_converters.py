"""A DAC that holds its last word in mid-motion: what the watches find late, or not at all, does no harm until then.

A word that moves a joint goes on moving it about right, so there may be little to see. What is promised is that the
joint stays within its following error while it follows its program, and stands or has no power when that has ended.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from qrobot.modecodes import Mode
from tests.support.campaign import FRAME_S, PUMA
from tests.support.dead_encoder import Case, SlowArm

SPEEDS = (0.02, 0.1, 0.3, 1.0, 1.4)  # rad/s, at most 95 % of what the joint may
JOINTS = (1, 2, 3, 5)
LONGEST_S = 3.5
MOST_UNNOTICED = 3  # of the twenty, up to the end of the joint's range or of the time: all of them fast


def stick(joint: int, speed: float, way: int, draw: int | None) -> bool:
    """Let the DAC stick on the way, and look where the joint is; whether the servo noticed."""
    speed = min(speed, 0.95 * PUMA.limits.v_max[joint - 1])
    arm = SlowArm(Case(joint, speed * way, True, True, draw))
    for _ in range(round(min(1.0, 0.4 / speed + 0.3) / FRAME_S)):
        arm.frame()
    arm.rig.emulator.faults.add(f"dac:{joint} stuck")
    room = PUMA.limits.q_max if way > 0 else PUMA.limits.q_min
    allowed = PUMA.guard.following_error[joint - 1]
    for _ in range(round(LONGEST_S / FRAME_S)):
        reference = arm.rig.mailbox.snapshot().q_setpoint[joint - 1]
        if abs(room[joint - 1] - reference) < 2.0 * speed * FRAME_S + 0.1:
            break
        arm.frame()
        if arm.mode is not Mode.TRACKING:
            break
        assert abs(arm.rig.mailbox.snapshot().q_setpoint[joint - 1] - arm.angle) <= 1.05 * allowed
    noticed = arm.mode is not Mode.TRACKING
    arm.rig.run_for(1.0)  # the program has ended
    assert arm.mode is Mode.FAULT or np.abs(arm.rig.emulator.v).max() < 0.02
    return noticed


@pytest.mark.parametrize("draw", [None, 0])
def test_a_joint_whose_converter_sticks_on_the_way_stays_within_its_following_error(draw: int | None) -> None:
    cases = enumerate(product(JOINTS, SPEEDS))
    noticed = [stick(joint, speed, 1 if k % 2 else -1, draw) for k, (joint, speed) in cases]
    assert len(noticed) - sum(noticed) <= MOST_UNNOTICED
