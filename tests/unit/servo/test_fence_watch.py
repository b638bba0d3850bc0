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
from qrobot.fences.gate import CREEP_M, DEEPER_M, GATE, N_VERDICT, OUTSIDE, REACTION_S
from qrobot.fences.table import N_ROWS, N_WORK
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


FOLDED = PARK + np.radians([0.0, 65.0, 0.0, 0.0, 0.0, 0.0])  # the elbow before the chest
FAR = Fence(name="far", shape="plane", position_m=(0.0, 0.0, -5.0))


@pytest.mark.parametrize(
    ("fences", "start", "goal"),
    [
        (FenceSet(ROBOT, [FAR, *plane_beside(0.2).fences]), PARK, PARK + TURNED),
        (FenceSet(ROBOT, [], self_collision=True), FOLDED, FOLDED + np.radians([0.0, 23.0, 0.0, 0.0, 0.0, 0.0])),
        (FenceSet(ROBOT, [FAR], self_collision=True), FOLDED, FOLDED + np.radians([0.0, 5.0, 55.0, 0.0, 0.0, 0.0])),
    ],
    ids=["the second fence", "itself", "itself behind a fence"],
)
def test_every_fence_stops_the_arm_and_so_does_the_arm_itself(fences: FenceSet, start: Floats, goal: Floats) -> None:
    assert fences.distances(goal)[-2:].min() < -0.01
    fenced = rig(fences, start)
    with pytest.raises(ServoFault, match="FENCE: the arm would enter a fence"):
        turn(fenced, goal, 1.0)
    fenced.run_for(0.5)
    distances = [fences.distances(q).min() for q in fenced.rows()["q"][::5]]
    assert 0.0 <= min(distances) < 0.03


def box(name: str, *place: float) -> Fence:
    """A box of half a metre."""
    return Fence(name=name, shape="box", size_m=(0.5, 0.5, 0.5), position_m=place)


def test_the_gate_stops_where_one_that_stops_now_would_come_to_rest_in_any_fence_or_in_the_arm_itself() -> None:
    """Each by itself, whichever joint moves; distances are those that `test_fence_distances` holds."""
    boxes = [box("front", 0.9, 0.0, 0.0), box("side", 0.0, 0.9, 0.3), box("back", -0.8, 0.0, -0.3)]
    fences = FenceSet(ROBOT, boxes, self_collision=True)
    limits, a_stop, overshoot_s = ROBOT.limits, np.array(ROBOT.guard.a_stop), np.array(ROBOT.control.stop_overshoot_s)
    random, verdict, alone, free = np.random.default_rng(3), np.zeros(N_VERDICT), set[tuple[int, int]](), 0
    for draw in range(900):
        joint, q, v = draw % 6, random.uniform(limits.q_min, limits.q_max), np.zeros(6)
        v[joint] = random.uniform(-1.0, 1.0) * limits.v_max[joint]
        work, rows = np.zeros(N_WORK), np.full(4 * N_ROWS, OUTSIDE)
        GATE(q, v, a_stop, overshoot_s, fences.words, work, rows, np.zeros(6), verdict)
        seconds = 0.5 * 15.0 / 8.0 * abs(v[joint]) / a_stop[joint] + overshoot_s.max() + REACTION_S
        now = fences.distances(q)
        there = np.array([fences.distances(q + v * seconds * part / 3.0) for part in (1, 2, 3)])
        entered = (there < 0.0) & ((now >= 0.0) | (now - there > DEEPER_M))
        assert verdict[0] == entered.any()
        free += not entered.any()
        if entered.any():
            assert verdict[1] == pytest.approx(there[entered].min(), abs=1e-12)
            assert entered[:, int(verdict[2])].any()
        if np.count_nonzero(entered.any(axis=0)) == 1:
            alone.add((int(verdict[2]), joint))
    assert free > 200
    assert {row for row, _ in alone} == {0, 1, 2, 3}
    assert {joint for _, joint in alone} >= {0, 1, 2}


def test_an_arm_inside_a_fence_may_leave_it_and_not_go_deeper() -> None:
    inside = plane_beside(-0.03)
    out = rig(inside)
    turn(out, PARK - TURNED, 0.5)
    assert inside.distances(out.rows()["q"][-1])[0] > 0.1
    with pytest.raises(ServoFault, match="FENCE"):
        turn(rig(inside), PARK + TURNED, 0.5)


def test_an_arm_inside_a_fence_does_not_creep_deeper_however_slowly() -> None:
    """At 3 mm/s no single look sees a way of a tenth of a millimetre."""
    inside = plane_beside(-0.03)
    work, rows, verdict = np.zeros(N_WORK), np.full(4 * N_ROWS, OUTSIDE), np.zeros(N_VERDICT)
    a_stop, overshoot_s = np.array(ROBOT.guard.a_stop), np.array(ROBOT.control.stop_overshoot_s)
    deeper = inside.distances(PARK)[0] - inside.distances(PARK + 1e-3 * TURNED)[0]  # m, for so much of the turn
    turn_s = 1e-3 * TURNED * 0.003 / deeper

    def depth_at_verdict(q: Floats, v: Floats, seconds: float = 2.0) -> float | None:
        """How much deeper the arm is when it is stopped, m; None when it is not. It begins at `q`."""
        begin = inside.distances(q)[0]
        for k in range(round(500 * seconds)):
            now = q + v * k / 500.0
            GATE(now, v, a_stop, overshoot_s, inside.words, work, rows, np.zeros(6), verdict)
            if verdict[0] != 0.0:
                return float(begin - inside.distances(now)[0])
        return None

    assert depth_at_verdict(PARK, turn_s) == pytest.approx(CREEP_M, abs=1e-4)
    rows[:] = OUTSIDE  # stopped, and another run begins
    assert depth_at_verdict(PARK + turn_s, turn_s) == pytest.approx(CREEP_M, abs=1e-4)
    assert depth_at_verdict(PARK + turn_s, -turn_s) is None  # out of it
    assert depth_at_verdict(PARK - turn_s, turn_s) == pytest.approx(CREEP_M, abs=1e-4)


def test_a_fence_far_away_changes_no_bit_of_what_the_servo_does() -> None:
    free, fenced = rig(None), rig(plane_beside(1.0))
    for each in (free, fenced):
        turn(each, PARK + 0.3 * TURNED, 1.0)
    for name in ("q", "q_ref", "tau", "fault"):
        assert free.rows()[name].tobytes() == fenced.rows()[name].tobytes()
