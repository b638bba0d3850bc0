"""An absolute stop behind a motion: that ends at its goal, of whatever kind, and the stop begins there."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.errors import MotionError
from qrobot.motion import (
    HERE,
    Compliance,
    Drift,
    EventKind,
    Goal,
    MotionMode,
    MoveRequest,
    SpeedShare,
    Termination,
    ToolSpeed,
)
from tests.support.motion import ended
from tests.support.puma import PARK, PERIOD_S, Conveyor, arm, at_park, puma_generator, shift

DONE = Termination.COMPLETED
PACE = 0.05  # m/s, of the belt
STOP_S = 0.1  # of joints that are not fast
STAY_S = 0.5


def goal_of(kind: str, belt: Conveyor) -> Goal:
    """200 mm beside park: there, on a belt that moves or could, or there with an arm that gives way."""
    if kind in ("moves", "could move"):
        return at_park(belt.trsf, shift(y=0.2)).goal()
    return at_park(shift(y=0.2)).goal(compliance=Compliance(np.zeros(6), (2,), Drift()) if kind == "complies" else None)


@pytest.mark.parametrize("mode", list(MotionMode))
@pytest.mark.parametrize("factor", [1.0, 0.6])
@pytest.mark.parametrize("kind", ["rests", "could move", "moves", "complies"])
def test_a_motion_that_an_absolute_stop_follows_ends_at_its_goal(kind: str, factor: float, mode: MotionMode) -> None:
    gen, belt = puma_generator(), Conveyor(lambda t: (PACE * t if kind == "moves" else 0.0, 0.0, 0.0, 0.0))
    goal, told = goal_of(kind, belt), {}
    gen.push(MoveRequest("goal", goal, ToolSpeed(0.2, 1.0), mode=mode))
    gen.push(MoveRequest("there", HERE, SpeedShare(0.5)))
    gen.override, places = factor, []
    for tick in range(1, 400):
        belt.tick = tick
        output = gen.update(tick)
        places.append(arm().forward(output.q))
        for event in output.events:
            if event.kind is EventKind.ENDED and event.request is not None:
                told[event.request.name] = event.code, tick
        if told.get("goal", (0, 0))[1] == tick:
            assert places[-1] == pytest.approx(goal.pose(tick), abs=1e-9)
    assert {name: code for name, (code, _) in told.items()} == {"goal": DONE, "there": DONE}
    arrived, rests = told["goal"][1], told["there"][1]
    assert (rests - arrived) * PERIOD_S <= STOP_S + 3 * PERIOD_S
    further = np.linalg.norm(places[-1][:3, 3] - places[arrived - 1][:3, 3])
    assert further <= {"rests": 1e-9, "moves": PACE * STOP_S + 2e-4}.get(kind, 2e-4)
    assert np.ptp(places[rests:], axis=0).max() == 0.0


@pytest.mark.parametrize("factor", [1.0, 0.5])
@pytest.mark.parametrize("kind", ["rests", "moves", "complies"])
def test_an_absolute_stop_lasts_its_time_before_another_motion_begins(kind: str, factor: float) -> None:
    """At half the speed twice as long, as every time of a motion."""
    gen, belt = puma_generator(), Conveyor(lambda t: (PACE * t if kind == "moves" else 0.0, 0.0, 0.0, 0.0))
    gen.override, told, path = factor, {}, []
    gen.push(MoveRequest("goal", goal_of(kind, belt), ToolSpeed(0.2, 1.0), mode=MotionMode.CARTESIAN))
    gen.push(MoveRequest("there", HERE, SpeedShare(0.5), stay_s=STAY_S))
    gen.push(MoveRequest("away", PARK, SpeedShare(0.5)))
    for tick in range(1, 500):
        belt.tick = tick
        output = gen.update(tick)
        path.append(output.q)
        told |= {(event.request.name, event.kind): tick for event in output.events if event.request is not None}
        assert all(event.code in (DONE, Termination.NONE) for event in output.events)
    over, away = told["there", EventKind.ENDED], told["away", EventKind.BEGUN]
    assert over == away
    stands = [k for k in range(1, over) if (path[k] == path[over - 1]).all()]
    assert STAY_S / factor <= (stands[-1] - stands[0]) * PERIOD_S <= STAY_S / factor + STOP_S + 6 * PERIOD_S


@pytest.mark.parametrize(("way", "code"), [("stop", int(Termination.STOPPED)), ("abort", 5), ("skip", 3)])
@pytest.mark.parametrize("at", [31, 60])
def test_a_stay_is_given_up_when_it_is_ended_also_while_the_arm_still_slows_down(way: str, code: int, at: int) -> None:
    gen, codes = puma_generator(), []
    gen.push(MoveRequest("cut", PARK + 0.4, SpeedShare(0.3)))
    gen.push(MoveRequest("there", HERE, SpeedShare(0.5), stay_s=20.0))
    for tick in range(1, 90):
        if tick == 28:
            gen.skip(9)
        if tick == at:
            {"stop": gen.stop, "abort": lambda: gen.abort(5), "skip": lambda: gen.skip(3)}[way]()
        codes += ended([gen.update(tick)])
    slows_down = way == "skip" and at == 31  # a skip does nothing during a stop
    assert codes == [("cut", 9)] + ([] if slows_down else [("there", code)])
    assert gen.busy == slows_down


def test_a_stay_waits_while_there_is_a_pause() -> None:
    gen, busy = puma_generator(), []
    gen.push(MoveRequest("there", HERE, SpeedShare(0.5), stay_s=2.0))
    for tick in range(1, 260):
        gen.override = float(not 10 <= tick < 150)
        gen.update(tick)
        busy.append(gen.busy)
    assert all(busy[:150])
    assert not busy[-1]


@pytest.mark.parametrize("seconds", [-1.0, float("nan"), float("inf")])
def test_a_stay_of_no_possible_time_is_refused(seconds: float) -> None:
    with pytest.raises(MotionError, match="an arm stands for no less than no time"):
        MoveRequest("there", HERE, SpeedShare(0.5), stay_s=seconds)
