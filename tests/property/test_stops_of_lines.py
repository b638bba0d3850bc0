"""Stops of straight lines, at each sample: on the line, and never beyond a range or a fence."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from qrobot.arrays import Floats
from qrobot.config.fences import Fence
from qrobot.fences.fence_set import FenceSet
from qrobot.motion import (
    T6,
    Equation,
    Generator,
    MotionMode,
    MoveRequest,
    Output,
    Termination,
    ToolSpeed,
    TransformKind,
    Trsf,
)
from qrobot.motion.path.phase import Phase
from tests.support.motion import ended, run
from tests.support.puma import LIMITS, PARK, PERIOD_S, ROBOT, Conveyor, arm, at_park, kinematics, puma_generator, shift

FAST = ToolSpeed(0.5, 3.0)
STOPPED = int(Termination.STOPPED)
ROUNDING = 1e-9


def line_to(q: Floats, name: str = "line", speed: ToolSpeed = FAST) -> MoveRequest:
    """Straight to where the last frame is at `q` (n,)."""
    place = Trsf(name, TransformKind.HOLD, arm().forward(q))
    return MoveRequest(name, Equation(name, [T6], [place], T6).goal(), speed, mode=MotionMode.CARTESIAN)


def stopped_at(gen: Generator, sample: int, seconds: float | None, slow: float = 1.0) -> list[Output]:
    """All outputs of motions that are stopped before `sample`, and go at the override `slow` from the sixth on.

    Without `seconds` the one under way is skipped, until none is left.
    """

    def at_tick(tick: int) -> None:
        if tick == 6:
            gen.override = slow
        if tick >= sample and seconds is None:
            gen.skip(3)
        elif tick == sample:
            gen.stop(seconds or 0.0)

    return list(run(gen, at_tick))


def assert_smooth(begin: Floats, outputs: list[Output]) -> None:
    v = np.diff([begin, begin, *(output.q for output in outputs)], axis=0) / PERIOD_S
    assert (np.abs(v) <= LIMITS.v_max * (1.0 + ROUNDING)).all()
    assert (np.abs(np.diff(v, axis=0)) <= LIMITS.a_max * PERIOD_S * (1.0 + ROUNDING)).all()


def near_the_end(before_rad: float) -> Floats:
    """Park, with joint 2 so far before the end of its range, and joint 3 to keep the arm bent."""
    q = np.array(PARK)
    q[1] = ROBOT.limits.q_max[1] - before_rad
    return q


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seconds", [0.0, 0.3, 2.0])
@pytest.mark.parametrize("slow", [1.0, 0.4])
def test_a_stop_of_a_line_to_the_end_of_a_range_stays_on_the_line(seconds, slow) -> None:
    begin, end = near_the_end(0.6), near_the_end(0.01)
    a, b = (arm().forward(q)[:3, 3] for q in (begin, end))
    along = (b - a) / np.linalg.norm(b - a)
    for sample in range(2, 60, 3):
        gen = puma_generator(begin)
        gen.push(line_to(end))
        outputs = stopped_at(gen, sample, seconds, slow)
        q = np.array([output.q for output in outputs])
        assert (q <= LIMITS.q_max).all()
        assert_smooth(begin, outputs)
        places = np.array([arm().forward(row)[:3, 3] for row in q]) - a
        assert np.abs(places - np.outer(places @ along, along)).max() <= 1e-6
        assert (np.diff(places @ along) >= -1e-9).all()
        lasted_s = PERIOD_S * (len(outputs) - sample + 1)
        assert ended(outputs) == [("line", Termination.COMPLETED)] or lasted_s >= seconds
        assert gen.goal is None or ended(outputs) == [("line", Termination.COMPLETED)]


@cache
def wall(distance_m: float, ahead: bool = True) -> FenceSet:
    """A plane across x, so far ahead of the flange at park or behind it, with a margin of 20 mm."""
    _, start, end, radius = FenceSet(ROBOT, [], self_collision=True).capsules_at(PARK)[-1]
    assert start[0] == pytest.approx(end[0])
    place = (start[0] + (radius + distance_m) * (1.0 if ahead else -1.0), 0.0, 0.0)
    fence = Fence(name="wall", shape="plane", position_m=place, rpy_deg=(0.0, -90.0 if ahead else 90.0, 0.0),
                  margin_m=0.02, bodies="tool")  # fmt: skip
    return FenceSet(ROBOT, [fence])


WAYS = {
    "to it": (wall(0.15), [shift(-0.128)], 0.002),
    "turns before it": (wall(0.15), [shift(-0.128), shift(-0.128, 0.2)], 0.002),
    "along it": (wall(0.0205, ahead=False), [shift(y=0.25)], 0.0005),
}


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seconds", [None, 0.0, 2.0])
@pytest.mark.parametrize("way", WAYS)
def test_a_stop_of_a_line_near_a_wall_keeps_the_margin(way, seconds) -> None:
    """Stops of the joints would end up to 0.5 mm within it, those in 2 s some 100 mm; each way itself keeps `room`."""
    fences, places, room = WAYS[way]
    for sample in range(2, 50):
        gen = Generator(LIMITS, PERIOD_S, np.array(PARK), kinematics=kinematics(), fences=fences)
        for k, place in enumerate(places):
            goal = at_park(place).goal()
            gen.push(MoveRequest(f"{k}", goal, ToolSpeed(0.5, 3.0), mode=MotionMode.CARTESIAN))
        outputs = stopped_at(gen, sample, seconds)
        least = 0.0 if seconds is None else room - ROUNDING
        assert min(fences.slack(output.q)[0] for output in outputs) >= least
        assert_smooth(PARK, outputs)


def test_a_stop_on_the_way_to_a_goal_that_moves_takes_no_longer_than_the_joints_need() -> None:
    paths = []
    for seconds in (0.0, 3.0):
        gen, belt = puma_generator(), Conveyor(lambda t: (0.2 * t, 0.0, 0.0, 0.0))
        gen.push(MoveRequest("belt", at_park(belt.trsf, shift(y=0.1)).goal(), FAST, mode=MotionMode.CARTESIAN))
        path = []
        for tick in range(1, 60):
            belt.tick = tick
            if tick == 25:
                gen.stop(seconds)
            path.append(gen.update(tick).q.tolist())
        assert gen.phase is Phase.RESTING
        paths.append(path)
    assert paths[0] == paths[1]


def test_where_no_stop_on_the_line_keeps_the_limits_the_joints_leave_it_as_soon_as_they_can() -> None:
    gen = puma_generator()
    gen.push(line_to(PARK + np.radians([20.0, 0.0, 0.0, 0.0, 0.0, 0.0])))
    outputs = [gen.update(tick) for tick in range(1, 15)]
    slow = replace(LIMITS, v_max=1e-3 * LIMITS.v_max)  # to plan by: the arm is faster already
    gen._planner.scheduler = replace(gen._planner.scheduler, limits=slow)
    gen.stop(2.0)
    assert gen.phase is Phase.JOINT_STOP
    outputs += [gen.update(tick) for tick in range(15, 26)]
    assert ended(outputs) == [("line", STOPPED)]
    assert gen.phase is Phase.RESTING
    assert_smooth(PARK, outputs)


def test_before_a_short_transition_a_stop_ends_on_the_line_or_at_its_end() -> None:
    for sample in range(12, 30):
        gen = puma_generator()
        for name, place, transition_s in (("0", shift(-0.1), None), ("1", shift(-0.2), 0.05)):
            goal = at_park(place).goal()
            gen.push(MoveRequest(name, goal, ToolSpeed(0.2, 3.0), transition_s, MotionMode.CARTESIAN))
        outputs = stopped_at(gen, sample, 1.0)
        places = np.array([arm().forward(output.q)[:3, 3] - arm().forward(PARK)[:3, 3] for output in outputs])
        assert np.abs(places[:, 1:]).max() <= 1e-6
        assert_smooth(PARK, outputs)


def test_what_is_aborted_while_it_stops_on_a_line_comes_to_rest_at_once_where_it_was_said_to() -> None:
    gen = puma_generator()
    gen.push(line_to(PARK + np.radians([20.0, 0.0, 0.0, 0.0, 0.0, 0.0])))
    phases, ends = [], []

    def at_tick(tick: int) -> None:
        phases.append(gen.phase)
        if tick in (15, 18):
            {15: lambda: gen.stop(1.0), 18: lambda: gen.abort(7)}[tick]()
            ends.append(gen._sequencer.last_end())

    outputs = list(run(gen, at_tick))
    assert [phase for k, phase in enumerate(phases) if phases[k - 1] is not phase] == [
        Phase.RESTING, Phase.MOVING, Phase.PATH_STOP, Phase.JOINT_STOP,
    ]  # fmt: skip
    assert ended(outputs) == [("line", STOPPED)]
    assert 20 < len(outputs) < 30
    assert outputs[-1].q == pytest.approx(ends[1], abs=1e-9)
    assert_smooth(PARK, outputs)


def test_after_a_stop_on_a_line_the_arm_rests_where_it_was_said_to_and_goes_on_from_there() -> None:
    gen = puma_generator()
    gen.push(line_to(PARK + np.radians([20.0, 0.0, 0.0, 0.0, 0.0, 0.0])))
    for tick in range(1, 15):
        gen.update(tick)
    gen.stop(0.6)
    end = gen._sequencer.last_end()
    gen.push(line_to(PARK, "back"))
    planned = gen.plan().q
    assert np.abs(planned - end).max(axis=1).min() <= 1e-9
    path = [gen.update(14 + k).q for k in range(1, len(planned))]
    assert np.array(path) == pytest.approx(planned[1:], abs=0.0)
    assert path[-1] == pytest.approx(PARK, abs=1e-9)


@pytest.mark.parametrize("slow", [1.0, 0.4])
def test_a_stop_that_was_to_take_long_on_a_line_becomes_a_shorter_one_on_it(slow) -> None:
    begin, end = (PARK + np.radians([waist, 0.0, 0.0, 0.0, 0.0, 0.0]) for waist in (-30.0, 30.0))
    a, b = (arm().forward(q)[:3, 3] for q in (begin, end))
    along = (b - a) / np.linalg.norm(b - a)
    for sample in range(9, 40, 3):
        gen = puma_generator(begin)
        gen.push(line_to(end))
        ends = []

        def at_tick(tick: int, gen=gen, sample=sample, ends=ends) -> None:
            if tick == 6:
                gen.override = slow
            if tick == 8:
                gen.stop(6.0)
            if tick == sample:
                gen.stop()
                ends.append(gen._sequencer.last_end())

        outputs = list(run(gen, at_tick))
        assert ended(outputs) == [("line", STOPPED)]
        assert len(outputs) - sample <= 24
        assert_smooth(begin, outputs)
        places = np.array([arm().forward(output.q)[:3, 3] for output in outputs]) - a
        assert np.abs(places - np.outer(places @ along, along)).max() <= 1e-6
        assert (np.diff(places @ along) >= -1e-9).all()
        assert outputs[-1].q == pytest.approx(ends[0], abs=1e-9)


def test_what_is_ended_while_it_stops_slowly_on_a_line_comes_to_rest_as_soon_as_the_joints_can() -> None:
    begin, end = (PARK + np.radians([waist, 0.0, 0.0, 0.0, 0.0, 0.0]) for waist in (-30.0, 30.0))
    for sample in range(9, 40, 3):
        gen = puma_generator(begin)
        gen.push(line_to(end))
        deeds = {8: lambda gen=gen: gen.stop(6.0), sample: lambda gen=gen: gen.skip(7)}
        outputs = list(run(gen, lambda tick, deeds=deeds: deeds[tick]() if tick in deeds else None))
        assert ended(outputs) == [("line", 7)]
        assert len(outputs) - sample <= 16
        assert_smooth(begin, outputs)


@pytest.mark.parametrize("way", WAYS)
def test_what_is_ended_while_it_stops_slowly_near_a_wall_keeps_the_margin(way) -> None:
    """By a monitor that goes on asking for it: where the joints would come to rest within it, on the line."""
    fences, places, _ = WAYS[way]
    for sample in range(4, 40, 2):
        gen = Generator(LIMITS, PERIOD_S, np.array(PARK), kinematics=kinematics(), fences=fences)
        for k, place in enumerate(places):
            gen.push(MoveRequest(f"{k}", at_park(place).goal(), FAST, mode=MotionMode.CARTESIAN))

        def at_tick(tick: int, gen=gen, sample=sample) -> None:
            if tick == sample:
                gen.stop(4.0)
            if tick > sample + 2:
                gen.skip(7)

        outputs = list(run(gen, at_tick))
        assert min(fences.slack(output.q)[0] for output in outputs) >= 0.0
        assert len(outputs) - sample <= 30
        assert_smooth(PARK, outputs)
