"""Motions and fences: no sample is nearer than the margin, what touches no fence keeps every bit, and a refusal moves
nothing."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext, suppress
from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from qrobot.arrays import Floats
from qrobot.config import load_robot
from qrobot.config.fences import Fence
from qrobot.errors import FenceCrossed, MotionError
from qrobot.fences.fence_set import RESOLUTION_M, FenceSet
from qrobot.model.arm import Arm
from qrobot.motion import (
    HERE,
    T6,
    Duration,
    Equation,
    EventKind,
    Generator,
    Goal,
    JointSpeed,
    MotionMode,
    MoveRequest,
    Termination,
    ToolSpeed,
    TransformKind,
    Trsf,
    kinematics_of,
    motion_limits,
)
from qrobot.rci.fenced_setpoints import check_setpoints
from tests.support import fences as slowly
from tests.support.thorough import examples

ROBOT = load_robot("puma560")
ARM = Arm(ROBOT)
LIMITS = motion_limits(ROBOT)
PARK = ROBOT.poses["park"]
SLACK = RESOLUTION_M + 1e-3  # of places between those that were looked at, and of the slow oracle

far = st.floats(0.0, 1.0)
goals = st.lists(st.tuples(far, far, far, far, far, far), min_size=1, max_size=3)


def near_park(shares: tuple[float, ...]) -> Floats:
    """A pose within some 60 degrees of park, inside the range."""
    step = (np.array(shares) - 0.5) * np.radians([150.0, 90.0, 90.0, 90.0, 90.0, 90.0])
    return np.clip(PARK + step, ROBOT.limits.q_min + 0.05, ROBOT.limits.q_max - 0.05)


@st.composite
def fence_near_the_hand(draw: st.DrawFn) -> Fence:
    """A box, a cylinder or a plane to keep out of, or a box to stay in; where the hand gets to from park."""
    x, y, z = (draw(st.floats(-0.5, 0.5)) for _ in range(3))
    kind = draw(st.sampled_from(["box", "cylinder", "plane", "room"]))
    hand = ARM.flange(PARK)[:3, 3]
    if kind == "room":
        size = tuple(0.6 + abs(value) for value in (x, y, z))
        return Fence(name="room", shape="box", keep="in", bodies="tool", position_m=tuple(hand), size_m=size)
    if kind == "plane":
        place = (hand[0] + 0.08 + 0.3 * abs(x), 0.0, 0.0)
        return Fence(name="plane", shape="plane", bodies="tool", position_m=place, rpy_deg=(0.0, -90.0, 0.0))
    sizes = {"box": {"size_m": (0.2, 0.2, 0.2)}, "cylinder": {"radius_m": 0.1, "length_m": 0.3}}[kind]
    place = (hand[0] + x, hand[1] + y, hand[2] + z)
    return Fence(name=kind, shape=kind, position_m=place, rpy_deg=(90 * x, 0.0, 90 * y), bodies="all", **sizes)


@cache
def kinematics() -> object:
    """Of the arm, once."""
    return kinematics_of(ARM)


def generator(fences: FenceSet | None, q: Floats = PARK) -> Generator:
    """A generator at rest."""
    return Generator(LIMITS, 0.028, np.array(q), kinematics=kinematics(), fences=fences)


def distances_by_hand(fence: Fence, q: Floats) -> float:
    """Distance of the arm from a fence with few points of each capsule."""
    wanted = {"all": (True, False), "tool": (True,), "links": (False,)}[fence.bodies]
    found = []
    for capsule in ROBOT.shape.capsules:
        if capsule.link > 0 and (capsule.link == ROBOT.n) in wanted:
            away = slowly.outside(fence, slowly.axis_points(ROBOT, capsule, q, 100))
            found.append((-away.max() if fence.keep == "in" else away.min()) - capsule.radius_m)
    return float(min(found))


def perform(motion: Generator, asked: list[Floats], interrupt_at: int) -> tuple[list[Floats], int]:
    """Samples of a motion through all goals that are not refused, skipped at one sample; and how many were refused."""
    refused = 0
    for number, goal in enumerate(asked):
        try:
            motion.push(MoveRequest(f"goal {number}", goal, JointSpeed(1.0)))
        except FenceCrossed:
            refused += 1
        except MotionError:
            pass
    samples, tick = [], 0
    while motion.busy or motion.has_events:
        tick += 1
        samples.append(motion.update(tick).q)
        if tick == interrupt_at:
            motion.skip(7)
    return samples, refused


@settings(max_examples=examples(15))
@given(fence_near_the_hand(), goals, st.integers(1, 60))
def test_no_sample_of_any_motion_is_nearer_to_a_fence_than_its_margin(
    fence: Fence, shares: list[tuple[float, ...]], interrupt_at: int
) -> None:
    assume(distances_by_hand(fence, PARK) > fence.margin_m + 0.001)
    asked = [near_park(each) for each in shares]
    samples, refused = perform(generator(FenceSet(ROBOT, [fence])), asked, interrupt_at)
    nearest = min([distances_by_hand(fence, q) for q in samples], default=1.0)
    assert nearest >= fence.margin_m - SLACK
    if all(distances_by_hand(fence, PARK + s * (asked[0] - PARK)) < fence.margin_m - SLACK for s in (1.0,)):
        assert refused > 0


@settings(max_examples=6)
@given(goals, st.integers(1, 60))
def test_a_fence_that_is_not_touched_changes_no_bit(shares: list[tuple[float, ...]], interrupt_at: int) -> None:
    asked = [near_park(each) for each in shares]
    far_away = FenceSet(ROBOT, [Fence(name="far", shape="box", size_m=(0.1, 0.1, 0.1), position_m=(5.0, 0.0, 0.0))])
    free, _ = perform(generator(None), asked, interrupt_at)
    fenced, refused = perform(generator(far_away), asked, interrupt_at)
    assert refused == 0
    assert np.array(free).tobytes() == np.array(fenced).tobytes()


def wall_ahead(distance_m: float, margin_m: float = 0.02) -> FenceSet:
    """A plane across x, so far ahead of the flange at park."""
    _, start, end, radius = FenceSet(ROBOT, [], self_collision=True).capsules_at(PARK)[-1]
    place = (max(start[0], end[0]) + radius + distance_m, 0.0, 0.0)
    fence = Fence(name="window", shape="plane", position_m=place, rpy_deg=(0.0, -90.0, 0.0), margin_m=margin_m,
                  bodies="tool")  # fmt: skip
    return FenceSet(ROBOT, [fence])


def test_a_refusal_names_fence_body_depth_and_place_and_moves_nothing() -> None:
    fences = wall_ahead(0.2)
    motion = generator(fences)
    goal = PARK + np.radians([0.0, 30.0, -60.0, 0.0, 0.0, 0.0])
    sentence = r"move to reach: flange would be .* fence 'window' after \d+ % of the way"
    with pytest.raises(FenceCrossed, match=sentence) as told:
        motion.push(MoveRequest("reach", goal, JointSpeed(1.0)))
    error = told.value
    assert (error.fence, error.body) == ("window", "flange")
    assert 0.0 < error.depth_m < 0.01
    there = fences.slack(PARK + error.share * (goal - PARK))[0]
    assert there == pytest.approx(-error.depth_m, abs=1e-9)
    assert not motion.busy
    assert not motion.update(1).moving
    assert (motion.update(2).q == PARK).all()


def test_a_fence_in_which_the_base_stands_is_one_for_all_that_moves() -> None:
    ground = Fence(name="ground", shape="plane", position_m=(0.0, 0.0, -0.4))
    fences = FenceSet(ROBOT, [ground])
    assert slowly.distance(ROBOT, ROBOT.shape.capsules[0], ground, PARK) < -0.2
    down = PARK + np.radians([0.0, 45.0, 0.0, 0.0, 0.0, 0.0])
    assert -0.2 < distances_by_hand(ground, down) < 0.0 < distances_by_hand(ground, PARK)
    with pytest.raises(FenceCrossed, match="fence 'ground'"):
        generator(fences).push(MoveRequest("down", down, JointSpeed(1.0)))


def test_a_part_that_is_inside_a_fence_lets_no_other_part_in() -> None:
    """Against an oracle with points on each capsule; `whole` is what an arm judged as a whole would be allowed."""
    hand = ARM.flange(PARK)[:3, 3]
    box = Fence(
        name="box", shape="box", size_m=(0.3, 0.3, 0.3), position_m=(hand[0] + 0.1, hand[1], hand[2]), bodies="all"
    )
    fences, rng, whole = FenceSet(ROBOT, [box]), np.random.default_rng(3), 0
    moving = [capsule for capsule in ROBOT.shape.capsules if capsule.link > 0]
    first = np.array([slowly.distance(ROBOT, capsule, box, PARK) for capsule in moving])
    assert first.min() < -0.02
    assert first.max() > box.margin_m
    floor, kept = fences.floor(PARK), np.minimum(first, box.margin_m)
    for _ in range(150):
        q = PARK + rng.uniform(-0.6, 0.6, PARK.size)
        above = np.array([slowly.distance(ROBOT, capsule, box, q) for capsule in moving]) - kept
        if above.min() < -0.003:
            whole += bool((above + kept).min() >= first.min())
            with pytest.raises(FenceCrossed, match="fence 'box'") as crossed:
                fences.check(q, floor, "motion", 0.5)
            assert crossed.value.body == moving[int(above.argmin())].name
            with pytest.raises(FenceCrossed, match="fence 'box'"):  # nor from one sample of a task to the next
                check_setpoints(fences, "task", PARK, q, LIMITS.a_stop, 3.0)
        elif above.min() > 0.003:
            assert fences.check(q, floor, "motion", 0.5) >= 0.0
    assert whole > 3


def test_an_arm_that_stands_too_near_may_leave_and_come_no_nearer() -> None:
    motion = generator(wall_ahead(0.0))  # on its surface, 20 mm inside the margin
    turn = np.radians([0.0, 10.0, -20.0, 0.0, 0.0, 0.0])
    with pytest.raises(FenceCrossed):
        motion.push(MoveRequest("further", PARK + turn, JointSpeed(1.0)))
    motion.push(MoveRequest("back", PARK - turn, JointSpeed(1.0)))
    tick, codes = 0, []
    while motion.busy or motion.has_events:
        tick += 1
        codes += [event.code for event in motion.update(tick).events if event.request is not None]
    assert codes[-1] == Termination.COMPLETED


# ------------------------------------------------------------------ starts that nobody knew when a motion was asked for

SPEED = JointSpeed(0.8)
TURN = np.radians([60.0, 25.0, 25.0, 40.0, 30.0, 40.0])
Interfering = Callable[[Generator, MoveRequest], object]


def goal_at(q: Floats, kind: TransformKind = TransformKind.CONST) -> Goal:
    """Where the last frame is at `q` (n,)."""
    return Equation("C", (T6,), (Trsf("P", kind, ARM.forward(q)),), T6).goal()


class Triangle(NamedTuple):
    """Ways A-B and B-C that keep off a box, in which A is park; that from `leaves`, on A-B, to C does not."""

    fences: FenceSet
    b: Floats
    c: Floats
    leaves: Floats


@cache
def triangles() -> list[Triangle]:
    """Twenty of them."""
    rng, found = np.random.default_rng(20), []
    while len(found) < 20:
        b, c = (PARK + TURN * rng.uniform(-1.0, 1.0, 6) for _ in range(2))
        leaves = PARK + rng.uniform(0.25, 0.75) * (b - PARK)
        hand = ARM.flange(leaves + rng.uniform(0.3, 0.7) * (c - leaves))[:3, 3]
        box = Fence(name="box", shape="box", size_m=(0.08, 0.08, 0.08), position_m=tuple(hand), margin_m=0.03)
        fences = FenceSet(ROBOT, [box])
        clear = all(fences.slack(q)[0] > 0.0 for q in (PARK, b, c))  # soon known, and seldom so: asked first
        share = fences.clear_share
        if clear and share(leaves, c) < 1.0 == share(PARK, b) == share(b, c):
            found.append(Triangle(fences, b, c, leaves))
    return found


def codes_of(
    motion: Generator, at_sample: Callable[[Floats], object] = lambda _: None, tick: int = 0
) -> list[tuple[str, int]]:
    """Codes of all motions, to the end; fails where a sample is nearer to the box than its margin less 2 mm."""
    assert motion._fences is not None
    codes: list[tuple[str, int]] = []
    while motion.busy or motion.has_events:
        tick += 1
        output = motion.update(tick)
        assert motion._fences.fences.slack(output.q)[0] >= -RESOLUTION_M
        codes += [(event.request.name, event.code) for event in output.events
                  if event.request is not None and event.kind is EventKind.ENDED]  # fmt: skip
        at_sample(output.q)
    return codes


def interfered(motion: Generator, at: Triangle, interfere: Interfering) -> list[tuple[str, int]]:
    """Codes of the motions to B and, asked for by `interfere` where the arm leaves A-B, to C."""
    way, waiting = at.b - PARK, [MoveRequest("C", at.c, SPEED)]

    def at_sample(q: Floats) -> None:
        if waiting and (q - at.leaves) @ way >= 0.0:
            interfere(motion, waiting.pop())

    motion.push(MoveRequest("B", at.b, SPEED))
    return codes_of(motion, at_sample)


def push_if_clear(motion: Generator, last: MoveRequest) -> None:
    """Ask for a motion from where the stop under way will end: refused now, or not at all."""
    end = motion._sequencer.last_end()
    clear = motion._fences.fences.clear_share(end, last.target) == 1.0
    with nullcontext() if clear else pytest.raises(FenceCrossed, match="move to C: "):
        motion.push(last)


def skip(motion: Generator, last: MoveRequest) -> None:
    """C waits behind B, and B is skipped."""
    motion.push(last)
    motion.skip(7)


def skip_twice(motion: Generator, last: MoveRequest) -> None:
    """B is skipped, and so is HERE behind it, before C."""
    motion.push(MoveRequest("here", HERE, SPEED))
    motion.push(last)
    motion.skip(7)


def skip_into_a_line(motion: Generator, last: MoveRequest) -> None:
    """B is skipped, and the tool is to move on a straight line to C, where there is one."""
    assert isinstance(last.target, np.ndarray)
    with suppress(MotionError):
        motion.push(MoveRequest("C", goal_at(last.target), ToolSpeed(0.5, 2.0), mode=MotionMode.CARTESIAN))
        motion.skip(7)


def abort(motion: Generator, last: MoveRequest) -> None:
    """The joints are brought to rest, and C is asked for at once."""
    motion.abort(7)
    push_if_clear(motion, last)


def stop(motion: Generator, last: MoveRequest) -> None:
    """The arm is brought to rest on its path, and C is asked for at once."""
    motion.stop()
    push_if_clear(motion, last)


@pytest.mark.parametrize(
    ("interfere", "told"),
    [(skip, None), (skip_twice, None), (skip_into_a_line, None), (stop, Termination.STOPPED), (abort, 7)],
)
def test_a_motion_that_begins_elsewhere_than_was_thought_does_not_cut_through_a_fence(
    interfere: Interfering, told: int | None
) -> None:
    refused = 0
    for at in triangles():
        codes = interfered(generator(at.fences), at, interfere)
        refused += codes[-1] in {("C", Termination.FENCE), ("B", told)}
        assert codes[-1][1] in {Termination.COMPLETED, Termination.FENCE, told}
    assert refused > 10  # some stops end beyond the box, and some places no straight line leads to


def test_a_motion_from_a_goal_that_was_followed_is_looked_at_where_the_arm_has_come_to_rest() -> None:
    for at in triangles():
        motion = generator(at.fences, at.leaves)
        motion.follow(goal_at(at.leaves, TransformKind.VARB))
        motion.push(MoveRequest("C", at.c, SPEED))
        assert codes_of(motion) == [("C", Termination.FENCE)]
        assert motion.newest == pytest.approx(at.leaves, abs=1e-6)


def test_a_motion_is_looked_at_from_where_joints_are_that_follow_no_setpoints() -> None:
    for at in triangles():
        motion = generator(at.fences, at.b)
        motion.push(MoveRequest("C", at.c, SPEED))
        event = motion.update(1, at.leaves).events[0]
        assert (event.kind, event.code) == (EventKind.ENDED, Termination.FENCE)
        assert "move to C: " in event.why
        assert not motion.busy


@pytest.mark.parametrize("early", range(1, 9))
def test_a_turn_that_goes_out_and_comes_back_is_looked_at_where_it_is_farthest(early: int) -> None:
    """Where the arm is at speed it is asked to come back to: it would go on towards a plane 30 mm behind B."""
    fences, turn = wall_ahead(0.03), np.radians([0.0, 20.0, -40.0, 0.0, 0.0, 0.0])
    motion = generator(fences, PARK - turn)
    motion.push(MoveRequest("B", PARK, JointSpeed(1.0), transition_s=0.1))
    waiting = ["C"]

    def come_back(q: Floats) -> None:
        if waiting and motion.remaining <= early:
            motion.push(MoveRequest(waiting.pop(), q, JointSpeed(1.0), transition_s=0.3))
            motion.skip(7)

    assert codes_of(motion, come_back) == [("B", 7), ("C", Termination.COMPLETED)]


def test_a_way_that_was_looked_at_when_it_was_asked_for_is_not_looked_at_twice(monkeypatch) -> None:
    at, looked, check_path = triangles()[0], [], FenceSet.check_path

    def counted(fences: FenceSet, joints_at, start: Floats, what: str, *bends) -> None:
        looked.append(what)
        check_path(fences, joints_at, start, what, *bends)

    monkeypatch.setattr(FenceSet, "check_path", counted)
    motion = generator(at.fences)
    for name, q in (("B", at.b), ("C", at.c)):
        motion.push(MoveRequest(name, q, SPEED))
        codes_of(motion, tick=motion._trajectory.tick)
    assert looked == ["move to B", "move to C"]


def turned(waist_deg: float, flange_deg: float) -> Floats:
    """Park, turned about the vertical by the waist less the flange."""
    return PARK + np.radians([waist_deg, 0.0, 0.0, 0.0, 0.0, flange_deg])


def ground_near(q: Floats) -> FenceSet:
    """A plane 0.1 m below the arm at `q` (n,)."""
    parts = FenceSet(ROBOT, [], self_collision=True).capsules_at(q)[1:]
    low = min(min(one[2], other[2]) - radius for _, one, other, radius in parts)
    return FenceSet(ROBOT, [Fence(name="ground", shape="plane", position_m=(0.0, 0.0, low - 0.1), margin_m=0.01)])


def test_a_line_on_which_a_joint_turns_by_more_than_half_a_turn_is_looked_at_as_the_arm_goes_along_it() -> None:
    """The tool turns by 150 degrees and joint 6, against the waist, by 195: also from a via point, past which it is
    looked at once more."""
    before, begin, end = turned(-25.0, -45.0), turned(-22.5, -45.0), turned(22.5, 150.0)
    paths = []
    for fences in (None, ground_near(end)):
        motion, path = generator(fences, before), []
        for name, q, seconds in (("begin", begin, 1.0), ("end", end, 3.0)):
            motion.push(MoveRequest(name, goal_at(q), Duration(seconds), mode=MotionMode.CARTESIAN))
        while motion.busy:
            path.append(motion.update(len(path) + 1).q)
        assert path[-1] == pytest.approx(end, abs=1e-9)
        paths.append(np.array(path).tobytes())
    assert paths[0] == paths[1]


def test_a_way_on_which_the_joints_jump_is_refused() -> None:
    begin = turned(0.0, -170.0)
    end = begin + np.radians([0.0, 0.0, 0.0, 0.0, 0.0, 360.0])
    with pytest.raises(MotionError, match="move to C: the joints would jump after 75 % of the way"):
        ground_near(end).check_path(lambda share, _: begin if share < 0.75 else end, begin, "move to C")


def test_a_copy_of_a_generator_works_on_numbers_of_its_own() -> None:
    """It may be followed by another thread."""
    motion = generator(FenceSet(ROBOT, [], self_collision=True))
    twin = motion.copy()
    assert motion._fences is not None
    assert twin._fences is twin._planner._fences is not motion._fences
    ours, theirs = motion._fences.fences, twin._fences.fences
    assert theirs.words is ours.words
    for name in ("_work", "_rows", "_nearest"):
        assert not np.shares_memory(getattr(ours, name), getattr(theirs, name))
