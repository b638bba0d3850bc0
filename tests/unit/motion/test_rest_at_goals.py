"""An absolute stop behind a motion: that ends at its goal, of whatever kind, and the stop begins there."""

from __future__ import annotations

import numpy as np
import pytest

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
from tests.support.puma import PERIOD_S, Conveyor, arm, at_park, puma_generator, shift

DONE = Termination.COMPLETED
PACE = 0.05  # m/s, of the belt
STOP_S = 0.1  # of joints that are not fast


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
