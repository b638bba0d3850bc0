"""A stop of the joints begins with the motion of the newest setpoint, whatever was to begin in that very sample."""

from __future__ import annotations

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.errors import FenceCrossed
from qrobot.motion import Generator, JointSpeed, MoveRequest, Termination
from qrobot.motion.path.phase import Phase
from tests.support.motion import LIMITS, PERIOD_S, ended, generator


class ObjectionAtOneSample:
    """A judge of ways by fences who has nothing against any way, and objects to one setpoint."""

    def __init__(self, gen: Generator, tick: int) -> None:
        self._gen, self._tick = gen, tick

    def check_way(self, *_: object) -> None:
        """Nothing is against it."""

    def check_entry(self, *_: object) -> None:
        """Nothing is against it."""

    def rests_at(self, q: Floats) -> None:
        """Nothing is against it."""

    def judge(self, _: Floats) -> None:
        if self._gen._trajectory.tick == self._tick:
            raise FenceCrossed("there")


def round_two_corners(objection: int, override: float) -> Generator:
    """Turns in a few samples from one joint motion into the next, of which one setpoint does not go out."""
    gen = generator()
    gen._fences = gen._planner._fences = ObjectionAtOneSample(gen, objection)  # type: ignore[assignment]
    gen.override = override
    for name, waist, speed in (("a", 0.3, 0.6), ("b", 0.4, 0.1), ("c", 0.7, 0.6)):
        gen.push(MoveRequest(name, np.array([waist, 0.0]), JointSpeed(speed), 0.06))
    return gen


@pytest.mark.parametrize("override", [1.0, 0.73])
def test_a_setpoint_that_may_not_go_out_is_followed_by_a_stop_that_goes_on_as_the_arm_moves(override) -> None:
    for objection in range(2, 60):
        gen = round_two_corners(objection, override)
        for tick in range(1, objection):
            gen.update(tick)
        before = gen.state()
        output = gen.update(objection)
        assert gen.phase is Phase.JOINT_STOP
        assert gen._path.piece.rows[:3] == pytest.approx(before, abs=1e-9), objection
        q, events = [gen.newest], [output]
        while output.moving:
            output = gen.update(gen._trajectory.tick + 1)
            events.append(output)
            q.append(output.q)
        assert Termination.FENCE in [code for _, code in ended(events)]
        assert (np.abs(np.diff(q, 2, axis=0)) <= LIMITS.a_max * PERIOD_S**2 * (1.0 + 1e-9)).all()
