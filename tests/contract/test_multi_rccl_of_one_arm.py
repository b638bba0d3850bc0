"""Calls of Multi-RCCL about one arm among others: what it measures, how fast it goes, and that the others go on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from qrobot import rci
from qrobot.errors import MotionError
from qrobot.model.arm import Arm
from qrobot.multi_rccl import (
    EQ,
    TL,
    TRANS,
    RobotManip,
    make_position,
    move,
    override,
    pause,
    pose,
    rccl_control,
    rccl_open,
    rccl_release,
    resume,
    setload,
    teach,
    update,
    wait_as,
    wait_for,
)
from qrobot.multi_rccl.program import _program
from qrobot.rccl import gentr_rpy, gentr_trsl
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.program import ending
from qrobot.rccl.setpoints import Setpoints

PLACE = gentr_rpy("PLACE", 500, 0, 0, 0, 180, 0)


@pytest.fixture
def arms() -> Iterator[tuple[RobotManip, RobotManip]]:
    """Two under control."""
    token = _program.set(None)
    with rci.use(OfflineLink), ending():
        opened = [rccl_open(name) for name in ("left", "right")]
        for arm in opened:
            rccl_control(arm)
        left, right = opened
        assert isinstance(left, RobotManip)
        assert isinstance(right, RobotManip)
        yield left, right
    _program.reset(token)


def test_a_transform_is_measured_where_the_next_motion_of_its_arm_ends(arms) -> None:
    left, right = arms
    seen, tool = gentr_trsl("SEEN", 0, 0, 0), gentr_trsl("TOOL", 0, 0, 150)
    update(left, seen, make_position(TRANS, tool, EQ, PLACE, seen, TL, tool))
    move(right, pose(right, "end"))
    goal = make_position(TRANS, tool, EQ, PLACE, gentr_trsl("ASIDE", 30, -40, -50), TL, tool)
    move(left, goal)
    wait_for(goal.end)
    assert np.allclose((seen.p.x, seen.p.y, seen.p.z), (30, -40, -50), atol=0.1)  # measured, a sample behind


def test_what_is_measured_by_another_arms_position_or_with_a_frame_is_refused(arms) -> None:
    left, right = arms
    seen = gentr_trsl("SEEN", 0, 0, 0)
    others = make_position(right.trans, EQ, PLACE, seen, TL, right.trans, unknown=right.trans, name="HIS")
    with pytest.raises(MotionError, match=r"HIS is solved for right\.trans: it is no goal of left"):
        update(left, seen, others)
    with pytest.raises(MotionError, match=r"HIS is solved for right\.trans"):
        teach(left, seen, others)
    obj = rccl_open("OBJECT_FRAME")
    rccl_control(obj)
    for call in (update, teach):
        with pytest.raises(MotionError, match=f"{call.__name__}: OBJECT_FRAME is an object frame; an arm is needed"):
            call(obj, seen, make_position(TRANS, EQ, PLACE, seen, TL, TRANS))
    for frame_call in (lambda: override(obj, 50), lambda: pause(obj), lambda: setload(obj, 1.0)):
        with pytest.raises(MotionError, match="is an object frame"):
            frame_call()


def test_one_arm_is_paused_or_slowed_down_while_the_other_goes_on_and_its_path_stays_the_same(arms) -> None:
    left, right = arms
    samples: dict[str, list[np.ndarray]] = {"as programmed": [], "slow": []}
    for name, percent in (("as programmed", 100.0), ("slow", 50.0)):
        override(left, percent)
        for arm in arms:
            move(arm, pose(arm, "end"))
        way = samples[name]

        def there(way: list[np.ndarray] = way) -> bool:
            way.append(np.array(left.j6))
            return bool(left.completed.count)

        wait_as(there)
        assert right.completed.count
        for arm in arms:
            move(arm, pose(arm, "park"))
        wait_for(left.completed)
        wait_for(right.completed)
    fast, slow = (np.array(samples[name]) for name in samples)
    assert 1.5 < len(slow) / len(fast) < 2.5
    travelled = fast[-1] - fast[0]
    for way in (fast, slow):  # on one straight line of joints
        off = way - way[0] - np.outer((way - way[0]) @ travelled / (travelled @ travelled), travelled)
        assert np.abs(off).max() < 1e-6

    move(left, pose(left, "end"))
    move(right, pose(right, "end"))
    pause(left)
    wait_for(right.completed)
    assert not left.completed.count
    assert np.allclose(np.radians(right.j6), pose(right, "end").q, atol=1e-9)
    resume(left)
    wait_for(left.completed)
    assert np.allclose(np.radians(left.j6), pose(left, "end").q, atol=1e-9)
    rccl_release(left)


def test_an_arm_that_plays_setpoints_is_told_of_by_its_transform_as_in_any_motion(arms) -> None:
    left, right = arms
    robot = left.channel.robot
    q = np.tile(np.radians(left.j6), (51, 1))
    q[:, 0] += 0.2 * (1.0 - np.cos(2.0 * np.pi * np.linspace(0.0, 1.0, 51)))
    away: list[float] = []

    def arrived() -> bool:
        assert np.allclose(left.trans.value, Arm(robot).forward(np.radians(left.j6)), atol=1e-12)
        away.append(float(np.radians(left.j6)[0] - q[0, 0]))
        return bool(left.completed.count)

    left.channel.play(Setpoints(robot.name, round(left.task.period_s * 1e6), q))
    wait_as(arrived)
    assert max(away) > 0.35
    assert away[-1] == pytest.approx(0.0, abs=1e-9)
    assert (right.j6 == np.degrees(robot.poses["park"])).all()
