"""Multi-RCCL through servo, board and physics: two arms that hold one object."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from qrobot import rci
from qrobot.arrays import Floats
from qrobot.cli.console import run_app
from qrobot.cli.main import make_app
from qrobot.model.arm import Arm
from qrobot.model.transform import inverse
from qrobot.multi_rccl import (
    EQ,
    TL,
    TRANS,
    RobotManip,
    comply,
    make_position,
    move,
    rccl_control,
    rccl_open,
    rccl_release,
    setmode,
    wait_as,
    wait_for,
)
from qrobot.multi_rccl.program import _program
from qrobot.rccl import gentr_rpy
from qrobot.rccl.program import ending
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.sim_board.emulator import Emulator
from qrobot.sim_board.mismatch import PlantMismatch
from tests.support.two_hands import GRIP, ROBOT, TOOL, WORLD, carry, off, reach

EXAMPLES = Path(__file__).parents[2] / "examples"
ARM = Arm(ROBOT)


def hand(robot: RobotManip, q: tuple[float, ...]) -> Floats:
    """Its hand in the world. Shape (4, 4)."""
    return np.asarray(inverse(WORLD[robot.name].value) @ ARM.forward(np.array(q)) @ TOOL.value)


def run(*words: str) -> int:
    return run_app(make_app("run"), ["run", *words])


def test_the_dual_arm_program_grasps_and_carries_what_its_camera_tracks_s08(capsys: pytest.CaptureFixture[str]) -> None:
    """`examples/22_two_hands.py` with two servos that stay behind their setpoints; off line both hands are ideal."""
    assert run("--lockstep", "--deployment", "two_arms", str(EXAMPLES / "22_two_hands.py")) == 0
    found = re.search(r"the hands came ([0-9.]+) mm closer", capsys.readouterr().out)
    assert found is not None
    assert 0.0 < float(found[1]) < 3.0  # 1.1 mm on the way, the rest where they come to rest slowly


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--lockstep", "22_two_hands.py"), "the one emulated arm, already.* --deployment two_arms"),
        (("--lockstep", "--deployment", "two_arms", "--log", "x.mcap", "22_two_hands.py"), "give a folder"),
        (("--offline", "--deployment", "two_arms", "01_park_and_return.py"), "several arms.* with --arm"),
        (("--deployment", "two_arms", "01_park_and_return.py"), "several arms.* with --arm"),
        (
            ("--deployment", "two_arms", "arcl/s11_first_program.py"),
            "no way to robot 'puma560'.* left, right, .* --arm",
        ),
        (("--deployment", "two_arms", "22_two_hands.py"), r"no bridge at 127\.0\.0\.1:5600"),
    ],
)
def test_a_run_whose_arms_are_not_clear_says_what_to_give(
    words: tuple[str, ...],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    token = _program.set(None)  # what this one opens is not for the programs of other tests
    assert run(*words[:-1], str(EXAMPLES / words[-1])) == 1
    _program.reset(token)
    assert re.search(told, capsys.readouterr().err)


def test_an_arm_whose_wrist_has_fallen_beyond_its_range_takes_part_as_well() -> None:
    """Its goal moves, so that every setpoint is judged, from the first one on."""
    start = np.radians([63.2, -57.3, 157.8, 21.7, 100.01, -38.6])
    rigs = {
        "left": LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), Emulator(ROBOT, start=start)),
        "right": LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0)),
    }
    token = _program.set(None)
    with rci.use({name: partial(link_factory, rig, 28_000) for name, rig in rigs.items()}), ending():
        obj, robots = reach()
        left, right = (hand(robot, tuple(robot.channel.how.q)) for robot in robots)
        for place, grip in ((left, GRIP["left"]), (right, GRIP["right"])):
            assert off(obj.trans.value @ grip.value, place)[0] < 0.002
    _program.reset(token)
    assert not any(rig.rows()["fault"].any() for rig in rigs.values())


def test_an_arm_that_gives_way_is_let_go_of_though_it_never_stands_still() -> None:
    """In the air nothing stops it; it is stopped."""
    token = _program.set(None)
    with rci.use(partial(link_factory, LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0)), 28_000)), ending():
        arm = rccl_open("left")
        rccl_control(arm)
        setmode(arm, "cartesian")
        comply(arm, "fz", 5.0)
        move(arm, make_position(TRANS, EQ, gentr_rpy("AIR", 500, 0, 100, 0, 180, 0), TL, TRANS))
        wait_for(arm.completed)
        assert isinstance(arm, RobotManip)
        before, begun = arm.j6, arm.sample
        wait_as(lambda: arm.sample > begun + 10)
        assert np.abs(arm.j6 - before).max() > 0.01  # degrees
        begun = arm.sample
        rccl_release(arm)
        assert arm.sample - begun < 60
    _program.reset(token)


def test_two_hands_keep_their_distance_within_the_sum_of_their_tracking_errors() -> None:
    other = Emulator(ROBOT, physics="rigid", mismatch=PlantMismatch.mismatched(ROBOT.n, seed=1))
    rigs = {
        "left": LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0)),
        "right": LockstepRig(ROBOT, ServoSettings(rate_hz=1000.0), other),
    }
    seen: list[list[tuple[Floats, Floats]]] = []
    with rci.use({name: partial(link_factory, rig, 28_000) for name, rig in rigs.items()}), ending():
        obj, robots = reach()
        carry(obj)

        def look() -> int:
            states = [(robot, robot.channel.how) for robot in robots]
            seen.append([(hand(robot, how.q_setpoint), hand(robot, how.q)) for robot, how in states])
            return obj.completed.count

        wait_as(look)
    assert not any(rig.rows()["fault"].any() for rig in rigs.values())
    assert len(seen) > 30
    farthest = 0.0
    for left, right in seen:
        wanted, found = (inverse(left[k]) @ right[k] for k in (0, 1))
        errors = [off(*left), off(*right)]
        lever = float(np.linalg.norm(found[:3, 3]))
        between = off(wanted, found)[0]
        farthest = max(farthest, between)
        assert between <= sum(far for far, _ in errors) + lever * sum(turned for _, turned in errors) + 1e-9
        assert abs(lever - 0.2) < 5e-3
    assert farthest > 1e-5  # the arms are real ones
