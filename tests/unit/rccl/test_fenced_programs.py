"""Programs inside fences, off line: what is refused moves nothing, a goal that moves is followed up to the fence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import nullcontext

import numpy as np
import pytest

from qrobot import rccl
from qrobot.config import load_robot
from qrobot.config.fences import Fence
from qrobot.errors import FenceCrossed, MotionError
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.in_force import use_fences
from qrobot.motion import Termination
from qrobot.rccl import connect
from qrobot.rccl.held_motion import HeldMotion
from qrobot.rccl.offline import OfflineLink

ROBOT = load_robot("puma560")
PARK = ROBOT.poses["park"]
AHEAD_M = 0.12
TURN = -1.0  # of joint 3, towards the plane


def plane_ahead(ahead_m: float = AHEAD_M) -> FenceSet:
    """A plane across x, AHEAD_M before the flange at park, for the tool alone."""
    name, start, end, radius = FenceSet(ROBOT, [], self_collision=True).capsules_at(PARK)[-1]
    assert name == "flange"
    place = (max(start[0], end[0]) + radius + ahead_m, 0.0, 0.0)
    return FenceSet(
        ROBOT, [Fence(name="window", shape="plane", position_m=place, rpy_deg=(0.0, -90.0, 0.0), bodies="tool")]
    )


@pytest.fixture
def fenced() -> Iterator[tuple[rccl.Channel, FenceSet]]:
    """An arm off line behind a plane."""
    fences = plane_ahead()
    with rccl.use(OfflineLink), use_fences(fences):
        yield rccl.control(), fences
        rccl.release()


def ahead_by(arm: rccl.Channel, mm: float, kind: str = "hold") -> rccl.Position:
    """A place so far along x from where the arm is; one of kind varb may change on the way."""
    here = rccl.newtrans("HERE")
    start = rccl.makeposition("here", rccl.t6, rccl.EQ, here, rccl.TL, here)
    arm.update(here, start)
    arm.move(arm.there)
    arm.waitfor(arm.completed)
    value = here.value.copy()
    value[0, 3] += mm * 1e-3
    goal = rccl.newtrans("GOAL", kind)
    goal.set(value)
    return rccl.makeposition("goal", rccl.t6, rccl.EQ, goal, rccl.TL, goal)


@pytest.mark.parametrize("mode", ["joint", "cartesian"])
def test_a_motion_through_a_fence_is_refused_and_the_next_one_is_done(
    fenced: tuple[rccl.Channel, FenceSet], mode: str
) -> None:
    arm, fences = fenced
    arm.setmode(mode)
    through, before = ahead_by(arm, 200.0), ahead_by(arm, 80.0)
    stood = np.array(arm.how.q)
    with pytest.raises(FenceCrossed, match="fence 'window'"):
        arm.move(through)
    assert not arm.nbrequest
    assert np.array(arm.how.q) == pytest.approx(stood, abs=1e-12)
    arm.move(before)
    arm.waitfor(arm.completed)
    assert before.code == Termination.COMPLETED
    assert 0.02 <= fences.nearness(np.array(arm.how.q))[0].distance < 0.06


@pytest.mark.parametrize("mode", ["joint", "cartesian"])
def test_an_arm_stops_before_a_fence_on_its_way_to_a_goal_that_may_change(
    fenced: tuple[rccl.Channel, FenceSet], mode: str
) -> None:
    arm, fences = fenced
    arm.setmode(mode)
    through, back = ahead_by(arm, 200.0, "varb"), ahead_by(arm, 0.0)
    nearest = []
    arm.each_sample(lambda: nearest.append(fences.nearness(np.array(arm.how.q))[0].distance))
    arm.move(through)
    arm.waitfor(arm.completed)
    assert through.code == Termination.FENCE
    assert 0.018 < min(nearest) < 0.06
    arm.each_sample(None)
    arm.move(back)
    arm.waitfor(arm.completed)
    assert back.code == Termination.COMPLETED


@pytest.mark.parametrize("ahead_m", [0.12, 0.127, 0.135])
def test_a_straight_jog_goes_as_near_to_a_fence_as_it_may_whatever_its_pieces_are(ahead_m: float) -> None:
    fences = plane_ahead(ahead_m)
    with rccl.use(OfflineLink), use_fences(fences), rccl.control() as arm:
        motion = HeldMotion(arm, lambda: "key")
        with motion.watched():
            arm.waitas(lambda: motion.held)
            for _ in range(3):  # to press again leads no nearer
                with pytest.raises(MotionError, match="fence 'window'"):
                    motion.go_along("dx", 1.0, 1.0, in_base=True)
                assert 0.0195 < fences.nearness(np.array(arm.how.q))[0].distance < 0.023


@pytest.mark.parametrize("go", ["joint", "axis"])
def test_a_jog_ends_before_a_fence_and_leads_back(fenced: tuple[rccl.Channel, FenceSet], go: str) -> None:
    arm, fences = fenced
    released_ms = 30e3
    motion = HeldMotion(arm, lambda: "key" if arm.time < released_ms else None)

    def jog(way: float) -> float:
        """Jog one way; where that ends."""
        arm.waitas(lambda: motion.held)
        if go == "joint":
            motion.turn_joint(2, way * TURN, 1.0)
        else:
            motion.go_along("dx", way, 1.0, in_base=True)
        return fences.nearness(np.array(arm.how.q))[0].distance

    with motion.watched():
        with pytest.raises(MotionError, match="keep 20 mm away") if go == "axis" else nullcontext():
            jog(1.0)
        nearest = fences.nearness(np.array(arm.how.q))[0].distance
        assert 0.018 < nearest < 0.03
        released_ms = arm.time + 1000.0
        assert jog(-1.0) > nearest + 0.01


def test_a_program_that_asks_how_far_it_may_go_leaves_the_numbers_of_the_generator_alone(fenced) -> None:
    arm, _ = fenced
    fences = arm._task.fences
    fences.distances(PARK)
    before = fences._work.copy(), fences._rows.copy()
    assert arm.clear_share(np.degrees(PARK), np.degrees(PARK) + np.array([0.0, 60.0, -60.0, 0.0, 0.0, 0.0])) < 1.0
    assert (fences._work == before[0]).all()
    assert (fences._rows == before[1]).all()


@pytest.mark.parametrize("robot", ["puma560", "stanford"])
def test_what_moves_an_arm_is_compiled_whether_its_file_tells_a_body_for_fences_or_not(
    robot: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled: list[str] = []
    monkeypatch.setattr(connect, "compile_all", lambda arm, _blend: compiled.append(arm.name))
    connect.compile_motion(robot)
    assert compiled == [robot]
