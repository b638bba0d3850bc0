"""The servo stops an arm before a fence, whoever moves it, and lets it leave one."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot import rccl
from qrobot.arrays import Floats
from qrobot.config.fences import Fence
from qrobot.errors import ServoFault
from qrobot.faultcodes import FaultCode
from qrobot.fences.fence_set import FenceSet
from qrobot.modecodes import Mode
from qrobot.rig.lockstep import LockstepRig, link_factory
from qrobot.servo.settings import ServoSettings
from qrobot.servo.stop_categories import category_of
from qrobot.sim_board.emulator import Emulator
from tests.support.puma import PARK, ROBOT

TURNED = np.array([0.9, 0.0, 0.0, 0.0, 0.0, 0.0])  # of the waist, through the plane


def plane_beside(distance_m: float) -> FenceSet:
    """A plane across y, so far from the tool at park, on the side to which the waist turns."""
    _, start, end, radius = FenceSet(ROBOT, [], self_collision=True).capsules_at(PARK)[-1]
    place = (0.0, max(start[1], end[1]) + radius + distance_m, 0.0)
    fence = Fence(name="beside", shape="plane", bodies="tool", position_m=place, rpy_deg=(0.0, 0.0, 90.0))
    return FenceSet(ROBOT, [fence])


def rig(fences: FenceSet | None, start: Floats = PARK) -> LockstepRig:
    """An emulated arm whose servo knows of fences; its programs do not."""
    settings = ServoSettings(rate_hz=500.0, fences=fences)
    return LockstepRig(ROBOT, settings, Emulator(ROBOT, physics="rigid", start=start))


def turn(rig: LockstepRig, q: Floats, percent: float) -> None:
    """A program that turns the arm to `q` (n,)."""
    with rccl.use(lambda hello: link_factory(rig, 28_000, hello)), rccl.control(ROBOT.name) as arm:
        arm.setjvel(percent)
        arm.move(arm.jposition("there", np.degrees(q).tolist()))
        arm.waitfor(arm.completed)


@pytest.mark.parametrize("speed", [0.3, 1.4])
def test_setpoints_into_a_fence_are_stopped_before_it(speed: float) -> None:
    fences = plane_beside(0.2)
    assert fences.distances(PARK + TURNED)[0] < -0.1
    fenced = rig(fences)
    with pytest.raises(ServoFault, match="FENCE: the arm would enter a fence"):
        turn(fenced, PARK + TURNED, speed)
    fenced.run_for(1.0)
    rows = fenced.rows()
    assert FaultCode.FENCE in {FaultCode(int(code)) for code in rows["fault"]}
    distances = [fences.distances(q)[0] for q in rows["q"][::5]]
    assert 0.0 <= min(distances) < 0.03
    assert fenced.mailbox.snapshot().mode == Mode.HOLDING
    assert category_of(FaultCode.FENCE) == 2


def test_an_arm_inside_a_fence_may_leave_it_and_not_go_deeper() -> None:
    inside = plane_beside(-0.03)
    out = rig(inside)
    turn(out, PARK - TURNED, 0.5)
    assert inside.distances(out.rows()["q"][-1])[0] > 0.1
    with pytest.raises(ServoFault, match="FENCE"):
        turn(rig(inside), PARK + TURNED, 0.5)


def test_a_fence_far_away_changes_no_bit_of_what_the_servo_does() -> None:
    free, fenced = rig(None), rig(plane_beside(1.0))
    for each in (free, fenced):
        turn(each, PARK + 0.3 * TURNED, 1.0)
    for name in ("q", "q_ref", "tau", "fault"):
        assert free.rows()[name].tobytes() == fenced.rows()[name].tobytes()
