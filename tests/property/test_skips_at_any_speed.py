"""A motion that is ended at any override, whatever waits behind it: it goes on no further, and has its code."""

from __future__ import annotations

from random import Random

import numpy as np
import pytest

from qrobot.motion import Compliance, Drift, Generator, MotionMode, MoveRequest, SpeedShare, Termination
from qrobot.motion.path.setpoint_history import DEPTH
from tests.support.motion import ended
from tests.support.puma import PARK, Conveyor, arm, at_park, puma_generator, shift

DONE = int(Termination.COMPLETED)
CODE = 3
KINDS = ("joints", "line", "belt", "complies")


def motion(kind: str, name: str, y: float, mode: MotionMode = MotionMode.CARTESIAN) -> MoveRequest:
    """To `y` beside park: where the goal moves or complies it could, but does not."""
    speed = SpeedShare(0.1)
    if kind == "joints":
        return MoveRequest(name, PARK + y, speed)
    belt = Conveyor(lambda _: (0.0, 0.0, 0.0, 0.0))
    terms = (belt.trsf, shift(y=y)) if kind == "belt" else (shift(y=y),)
    compliance = Compliance(np.zeros(6), (2,), Drift()) if kind == "complies" else None
    return MoveRequest(name, at_park(*terms, name=name).goal(compliance=compliance), speed, mode=mode)


def run_skipped(gen: Generator, at: int, overrides: dict[int, float]) -> list[tuple[str, int]]:
    """Skip the motion under way before sample `at`: what ended, and with which codes, until nothing is left to do."""
    codes, cut = [], gen.serving
    for tick in range(1, 2000):
        gen.override = overrides.get(tick, gen.override)
        if tick == at:
            cut = gen.serving
            gen.skip(CODE)
        output = gen.update(tick)
        codes += ended([output])
        if tick >= at + DEPTH:
            assert gen.serving is not cut or gen.stopping or cut is None
        if tick > max(at, *overrides) and not output.moving:
            return codes
    raise AssertionError(f"still busy: {codes}")


@pytest.mark.sampled(32)
@pytest.mark.parametrize("first", KINDS)
@pytest.mark.parametrize("behind", KINDS)
@pytest.mark.parametrize("factor", [0.0, 0.05, 0.5, 1.0])
def test_a_motion_that_is_skipped_ends_with_its_code_whatever_waits_and_how_fast_the_arm_is(
    first: str, behind: str, factor: float
) -> None:
    gen = puma_generator()
    gen.push(motion(first, "first", 0.25))
    gen.push(motion(behind, "behind", 0.1))
    assert run_skipped(gen, 30, {8: factor, 150: 1.0}) == [("first", CODE), ("behind", DONE)]


@pytest.mark.parametrize("behind", ["belt", "complies"])
@pytest.mark.parametrize("factor", [0.3, 0.9])
def test_a_skip_on_the_way_to_what_cannot_be_met_in_motion_is_a_stop_on_the_way(behind: str, factor: float) -> None:
    """As of a tool that is pushed down until it feels a table, with 250 mm to go, and is to follow it then."""
    gen, places = puma_generator(), []
    gen.push(motion("line", "first", 0.25))
    gen.push(motion(behind, "behind", -0.1))
    gen.override = factor
    for tick in range(1, 300):
        if tick == 50:
            gen.skip(CODE)
        places.append(arm().forward(gen.update(tick).q)[:3, 3])
    start, goal = arm().forward(PARK)[:3, 3], at_park(shift(y=0.25)).goal().pose(0)[:3, 3]
    way = (np.array(places) - start) @ (goal - start) / 0.25
    assert 0.01 < way[48] < way.max() < way[48] + 0.02
    assert way[-1] == pytest.approx(-0.1, abs=1e-6)


@pytest.mark.sampled(20)
@pytest.mark.parametrize("seed", range(40))
def test_no_motion_outlives_its_skip_at_any_instant_of_any_change_of_speed(seed: int) -> None:
    random, gen = Random(seed), puma_generator()
    names = [str(k) for k in range(random.randint(2, 4))]
    for name in names:
        gen.push(motion(random.choice(KINDS), name, random.uniform(-0.2, 0.2), random.choice(list(MotionMode))))
    overrides = {random.randint(1, 150): random.choice((0.0, 1.0, random.random())) for _ in range(4)} | {300: 1.0}
    codes = run_skipped(gen, random.randint(2, 160), overrides)
    assert [name for name, _ in codes] == names
    assert [code for _, code in codes if code != DONE] in ([], [CODE])
