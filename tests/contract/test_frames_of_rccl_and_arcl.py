"""RCCL counts joints and poses as VAL does, ARCL as Paul did: the map between them that a page tells."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from qrobot import rccl
from qrobot.arcl.kinematics import config_letters, kinematics
from qrobot.config import load_robot
from qrobot.model.arm import Arm
from qrobot.model.branch import Branch
from qrobot.motion import kinematics_of, motion_limits
from qrobot.rccl import EQ, TL, gentr_rot, makeposition, newtrans, t6, zunit
from qrobot.rccl.offline import OfflineLink

ROBOT, ARCL = load_robot("puma560"), kinematics("puma560")
PAGE = (Path(__file__).parents[2] / "docs/reference/c-surface.md").read_text()
HALF_TURN = gentr_rot("PAUL", 0.0, 0.0, 0.0, zunit, 180.0)


def offsets() -> np.ndarray:
    """What the page adds to the joints, rad. Shape (6,)."""
    (told,) = re.findall(r"plus ((?:-?\d+, ){5}-?\d+) degrees", PAGE)
    return np.radians([float(number) for number in told.split(", ")])


def test_the_two_libraries_tell_one_pose_by_the_map_of_the_page() -> None:
    arm, random = Arm(ROBOT), np.random.default_rng(9)
    limits = motion_limits(ROBOT)
    for q in random.uniform(limits.q_min, limits.q_max, (50, 6)):
        assert ARCL.forward(q + offsets()) == pytest.approx(HALF_TURN.value @ arm.forward(q), abs=1e-12)


def test_configurations_have_the_same_letters_in_both() -> None:
    own = kinematics_of(Arm(ROBOT))
    assert own is not None
    for q in ROBOT.poses.values():
        assert config_letters(ARCL.branch(q + offsets())) == Branch(own.branch(q)).letters


def test_a_program_with_numbers_of_pauls_frame_puts_half_a_turn_before_t6() -> None:
    assert 'gentr_rot("PAUL", 0., 0., 0., zunit, 180.)' in PAGE
    q, place = ROBOT.poses["end"], newtrans("PLACE")
    place.set(ARCL.forward(q + offsets()))
    with rccl.use(OfflineLink), rccl.control("puma560") as arm:
        arm.setconf(Branch(kinematics_of(Arm(ROBOT)).branch(q)).letters)
        arm.move(makeposition("P", HALF_TURN, t6, EQ, place, TL, t6))
        arm.waitfor(arm.completed)
        done = arm.time
        arm.waitas(lambda: arm.time > done + 60.0)  # the robot has taken the last setpoint
        assert np.array(arm.how.q_setpoint) == pytest.approx(q, abs=1e-9)
