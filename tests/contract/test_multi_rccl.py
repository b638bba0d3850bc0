"""Multi-RCCL on ideal arms: object frames, arms that hold one object, and what one arm's end means to the other."""

from __future__ import annotations

import runpy
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from qrobot import rci
from qrobot.arrays import Floats
from qrobot.errors import ConfigError, LinkError, LinkLost, MotionError
from qrobot.model.transform import inverse, so3_log
from qrobot.multi_rccl import (
    EQ,
    TL,
    TRANS,
    Manip,
    RobotManip,
    cancel,
    comply,
    distance,
    grasp,
    jposition,
    limit,
    maintain,
    make_position,
    move,
    pose,
    rccl_control,
    rccl_open,
    rccl_release,
    setconf,
    setime,
    setjvel,
    setmode,
    setvel,
    stop,
    tracking_mode,
    wait_as,
    wait_for,
)
from qrobot.multi_rccl.program import _program
from qrobot.rccl import Position, Transform, gentr_rot, gentr_rpy, gentr_trsl, newtrans, trsl, xunit, zunit
from qrobot.rccl.offline import OfflineLink
from qrobot.rccl.program import ending
from qrobot.wire import Command, Hello, State

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PERIOD_MS = 28.0
tool = gentr_trsl("TOOL", 0, 0, 150)
world_in_left = gentr_trsl("COORD1", 0, 0, 0)
world_in_right = gentr_rpy("COORD2", 1000, 0, 0, 180, 0, 0)  # two arms face to face, a metre apart
on_left, on_right = gentr_trsl("DISP1", 0, 100, 0), gentr_trsl("DISP2", 0, -100, 0)
here = gentr_rpy("HERE", 500, 0, 0, 0, 180, 0)
there = gentr_rpy("THERE", 460, 40, 120, 15, 170, 5)


class Ways:
    """Links to two ideal arms, which may break."""

    def __init__(self) -> None:
        self.breaks_at: dict[str, int] = {}  # sample of each arm
        self.sent: dict[str, list[tuple[int, Floats]]] = {"left": [], "right": []}

    def link(self, name: str) -> Callable[[Hello], OfflineLink]:
        """Opener of the way to one."""
        ways = self

        class Breaking(OfflineLink):
            def exchange(self, command: Command | None) -> State:
                state = super().exchange(command)
                if state.seq >= ways.breaks_at.get(name, 1 << 60):
                    raise LinkLost(f"the bridge of {name} has gone")
                ways.sent[name].append((self.now_ns(), np.array(state.robot.q_setpoint)))
                return state

        return Breaking


@pytest.fixture
def ways() -> Iterator[Ways]:
    ways = Ways()
    token = _program.set(None)
    with rci.use({name: ways.link(name) for name in ("left", "right", "OTHER")}), ending():
        yield ways
    _program.reset(token)


def arms() -> tuple[RobotManip, RobotManip]:
    """Two arms under control."""
    opened = []
    for name in ("left", "right"):
        arm = rccl_open(name)
        rccl_control(arm)
        assert isinstance(arm, RobotManip)
        opened.append(arm)
    return opened[0], opened[1]


def frame(at: Transform = here, name: str = "OBJECT_FRAME") -> Manip:
    """An object's frame at `at`."""
    obj = rccl_open(name)
    rccl_control(obj)
    maintain(obj, make_position(TRANS, EQ, at, TL, TRANS))
    return obj


def take_hold(obj: Manip, left: Manip, right: Manip) -> None:
    """Both hands at their places on the object, which they follow."""
    for arm, coord, grip in ((left, world_in_left, on_left), (right, world_in_right, on_right)):
        tracking_mode(arm)
        move(arm, make_position(TRANS, tool, EQ, coord, obj.trans, grip, TL, tool))
    wait_for(left.completed)
    wait_for(right.completed)


def apart(left: Manip, right: Manip) -> Floats:
    """The right hand in the left one, as both are sent."""
    in_left = inverse(world_in_left.value) @ left.trans.value @ tool.value
    in_right = inverse(world_in_right.value) @ right.trans.value @ tool.value
    return np.asarray(inverse(in_left) @ in_right)


# ------------------------------------------------------------------------------------------------- coordinated


def test_two_arms_carry_an_object_along_one_path_at_constant_offsets(ways) -> None:
    obj = frame()
    left, right = arms()
    take_hold(obj, left, right)
    held, seen = apart(left, right), []
    setvel(obj, 150, 60)
    for goal in (there, here, there):
        move(obj, make_position(TRANS, EQ, goal, TL, TRANS))

    def look() -> int:
        seen.append((obj.trans.value.copy(), np.abs(apart(left, right) - held).max()))
        return obj.completed.count

    wait_as(look)
    assert max(error for _, error in seen) < 1e-9
    assert np.allclose(obj.trans.value, there.value, atol=1e-12)
    assert np.allclose(held[:3, 3], (0.0, -0.2, 0.0), atol=1e-12)
    steps = np.diff([pose[:3, 3] for pose, _ in seen], axis=0)
    assert np.linalg.norm(steps, axis=1).max() <= 0.150 * PERIOD_MS * 1e-3 * 1.01


def test_an_objects_pose_is_one_for_all_arms_of_a_sample_and_known_before_them(ways) -> None:
    obj = frame()
    left, right = arms()
    take_hold(obj, left, right)
    move(obj, make_position(TRANS, EQ, there, TL, TRANS))
    behind = []

    def look() -> int:
        on_object = inverse(obj.trans.value) @ inverse(world_in_left.value) @ left.trans.value @ tool.value
        behind.append(np.abs(on_object - on_left.value).max())
        return obj.completed.count

    wait_as(look)
    assert max(behind) < 1e-9  # of the same sample, not of the one before


def test_a_camera_tracks_an_object_and_both_arms_go_to_it_and_with_it_s08(ways) -> None:
    samples = [0]

    def track(t: Transform) -> None:
        samples[0] += 1
        trsl(t, 500 + 40 * np.sin(0.04 * samples[0]), 30 * np.sin(0.06 * samples[0]), 50)

    camera, turned = gentr_trsl("CAM", 0, 0, 0), gentr_rpy("TURNED", 0, 0, 0, 0, 180, 0)
    loc = newtrans("LOC", track)
    obj = rccl_open("OBJECT_FRAME")
    rccl_control(obj)
    maintain(obj, make_position(camera, TRANS, EQ, loc, turned, TL, TRANS))
    left, right = arms()
    take_hold(obj, left, right)
    begun = samples[0]
    held, worst = apart(left, right), [0.0]

    def look() -> bool:
        worst[0] = max(worst[0], np.abs(apart(left, right) - held).max())
        return samples[0] > begun + 200

    wait_as(look)
    assert worst[0] < 1e-9
    assert samples[0] <= left._group.tick  # once for each sample, however many arms look
    move(obj, make_position(TRANS, EQ, here, TL, TRANS))  # it is left without a jump: the arms would be stopped
    wait_for(obj.completed)
    wait_as(lambda: worst.append(np.abs(apart(left, right) - held).max()) or len(worst) > 20)
    assert max(worst) < 1e-9


def test_without_tracking_mode_an_arm_keeps_the_last_value_of_its_goal(ways) -> None:
    obj = frame()
    left, right = arms()
    tracking_mode(left)
    move(left, make_position(TRANS, tool, EQ, world_in_left, obj.trans, on_left, TL, tool))
    move(right, make_position(TRANS, tool, EQ, world_in_right, obj.trans, on_right, TL, tool))
    wait_for(left.completed)
    wait_for(right.completed)
    stood, followed = right.j6, left.j6
    move(obj, make_position(TRANS, EQ, there, TL, TRANS))
    wait_for(obj.completed)
    assert np.array_equal(right.j6, stood)
    assert np.abs(left.j6 - followed).max() > 5.0


def test_an_arm_is_maintained_where_it_is_only(ways) -> None:
    obj = frame()
    left, _ = arms()
    goal = make_position(TRANS, tool, EQ, world_in_left, obj.trans, on_left, TL, tool)
    with pytest.raises(MotionError, match=r"maintain: left is .* mm .* move there first"):
        maintain(left, goal)
    move(left, goal)
    wait_for(left.completed)
    maintain(left, goal)
    move(obj, make_position(TRANS, EQ, there, TL, TRANS))
    wait_for(obj.completed)
    at = inverse(world_in_left.value) @ left.trans.value @ tool.value
    assert np.allclose(at, obj.trans.value @ on_left.value, atol=1e-9)


# ------------------------------------------------------------------------------------ one arm's end, and the other


@pytest.mark.parametrize("after", [3, 41, 77, 150])
def test_when_one_arms_link_dies_the_other_rests_with_the_object_and_tears_nothing(ways, after: int) -> None:
    obj = frame()
    left, right = arms()
    take_hold(obj, left, right)
    held = apart(left, right)
    setvel(obj, 100, 60)
    for goal in (there, here, there, here):
        move(obj, make_position(TRANS, EQ, goal, TL, TRANS))
    lost_at = len(ways.sent["right"]) + after
    ways.breaks_at["right"] = lost_at
    with pytest.raises(LinkLost, match="bridge of right has gone"):
        wait_for(obj.completed)
    before = obj.trans.value.copy()
    rccl_release(left)
    path = np.array([q for _, q in ways.sent["left"][-200:]])
    assert np.abs(np.diff(path, axis=0))[-1].max() == 0.0  # it rests
    went = np.linalg.norm((inverse(before) @ obj.trans.value)[:3, 3])
    assert went <= 0.1**2 / (2 * 5.0) + 0.1 * 2 * PERIOD_MS * 1e-3 + 1e-3  # its stop, begun within two frames
    on_object = inverse(obj.trans.value) @ inverse(world_in_left.value) @ left.trans.value @ tool.value
    assert np.allclose(on_object, on_left.value, atol=1e-9)  # the other hand stays where it holds
    assert np.linalg.norm(so3_log(held[:3, :3])) < 1e-9


def test_an_arm_on_its_own_path_stops_there_when_its_partner_is_lost(ways) -> None:
    left, _ = arms()
    begin = left.j6
    goal = begin + np.array([40.0, -20.0, 15.0, 10.0, -10.0, 30.0])
    move(left, jposition(left, "FAR", goal.tolist()))
    ways.breaks_at["right"] = len(ways.sent["right"]) + 30
    with pytest.raises(LinkLost):
        wait_for(left.completed)
    rccl_release(left)
    share = (left.j6 - begin) / (goal - begin)
    assert np.ptp(share) < 1e-9  # on the straight line of the joints
    assert 0.0 < share[0] < 1.0


@pytest.mark.parametrize("fails", [True, False])
def test_a_sensor_that_fails_or_jumps_brings_frame_and_arms_to_rest_and_the_program_is_told_once(ways, fails) -> None:
    samples = [0]

    def track(t: Transform) -> None:
        samples[0] += 1
        if samples[0] > 400 and fails:
            raise ValueError("the camera is blind")
        trsl(t, 500, 0.05 * samples[0] if samples[0] <= 400 else 120.0, 0)

    place = make_position(TRANS, EQ, newtrans("LOC", track), gentr_rpy("TURNED", 0, 0, 0, 0, 180, 0), TL, TRANS)
    obj = rccl_open("OBJECT_FRAME")
    rccl_control(obj)
    maintain(obj, place)
    left, right = arms()
    take_hold(obj, left, right)
    error, words = (ValueError, "blind") if fails else (MotionError, r"cannot follow P\d+ any more \(too fast\)")
    with pytest.raises(error, match=words):
        wait_as(lambda: False)
    begun = left._group.tick
    wait_as(lambda: left._group.tick > begun + 40)  # it was told once, and time goes on
    stood = left.j6
    wait_as(lambda: left._group.tick > begun + 45)
    assert np.array_equal(left.j6, stood)
    if not fails:
        assert place.code not in (0, -1)
    maintain(obj, make_position(TRANS, EQ, here, TL, TRANS))  # and there is a way on
    with pytest.raises(MotionError, match=r"cannot stay at the place .* all arms and objects come to rest"):
        wait_as(lambda: left._group.tick > begun + 60)  # for the frame, which may be put; no arm can
    begun = left._group.tick
    wait_as(lambda: left._group.tick > begun + 5)
    assert np.array_equal(obj.trans.value, here.value)


def goes_on() -> Position:
    """A place that goes on by a tenth of a millimetre at each look."""
    looks = [0]

    def track(t: Transform) -> None:
        looks[0] += 1
        trsl(t, 500, 0.1 * looks[0], 0)

    return make_position(TRANS, EQ, newtrans("SEEN", track), gentr_rpy("TURNED", 0, 0, 0, 0, 180, 0), TL, TRANS)


@pytest.mark.parametrize("before", [lambda _: None, lambda obj: maintain(obj, goes_on())], ids=["rests", "follows"])
@pytest.mark.parametrize(
    "call",
    [
        lambda obj: maintain(obj, goes_on()),
        lambda obj: maintain(obj, make_position(TRANS, EQ, there, TL, TRANS)),
        lambda obj: move(obj, make_position(TRANS, EQ, there, TL, TRANS)),
        lambda obj: (tracking_mode(obj), move(obj, goes_on())),
        lambda obj: stop(obj, make_position(TRANS, EQ, there, TL, TRANS), 500),
    ],
    ids=["maintain what moves", "maintain", "move", "track", "stop"],
)
def test_a_frame_comes_to_rest_from_whatever_it_was_told_last(ways, before, call) -> None:
    obj = frame()
    left, _ = arms()
    group = left._group
    before(obj)
    begun = group.tick
    wait_as(lambda: group.tick > begun + 10)
    call(obj)
    group.come_to_rest()
    begun = group.tick
    wait_as(lambda: group.tick > begun + 20)
    stood = obj.trans.value.copy()
    wait_as(lambda: group.tick > begun + 25)
    assert group.rests
    assert np.array_equal(obj.trans.value, stood)


@pytest.mark.parametrize("turned", [90, 330, 345, 360, 480])
def test_a_frame_that_has_turned_round_leaves_that_place_about_any_axis(ways, turned: int) -> None:
    obj = rccl_open("OBJECT_FRAME")
    rccl_control(obj)
    arms()
    setvel(obj, 100, 60)
    for degrees in (*range(90, turned, 90), turned):
        move(obj, make_position(TRANS, EQ, gentr_rot("ROUND", 0, 0, 0, zunit, degrees), TL, TRANS))
        wait_for(obj.completed)
    seen = [obj.trans.value.copy()]
    tilt = gentr_rot("TILT", 0, 0, 0, xunit, 30)
    goal = make_position(TRANS, EQ, gentr_rot("ROUND", 0, 0, 0, zunit, turned), tilt, TL, TRANS)
    move(obj, goal)

    def look() -> int:
        seen.append(obj.trans.value.copy())
        return obj.completed.count

    wait_as(look)
    assert np.allclose(seen[-1], seen[0] @ tilt.value, atol=1e-12)
    turns = [np.linalg.norm(so3_log(before[:3, :3].T @ after[:3, :3])) for before, after in pairwise(seen)]
    assert max(turns) <= np.radians(60.0) * PERIOD_MS * 1e-3 * 1.01
    assert sum(turns) == pytest.approx(np.radians(30.0))  # and no other way


def test_an_arm_that_follows_no_frame_is_let_go_of_and_the_frame_goes_on(ways) -> None:
    obj = frame()
    _, right = arms()
    move(obj, make_position(TRANS, EQ, there, TL, TRANS))
    rccl_release(right)
    wait_for(obj.completed)
    assert np.allclose(obj.trans.value, there.value, atol=1e-12)
    with pytest.raises(LinkError, match="right is not under control; call rccl_control first"):
        move(right, make_position(TRANS, EQ, there, TL, TRANS))


# ------------------------------------------------------------------------------ motions, stops, and steps by events


def test_motions_pass_through_their_positions_and_stops_stand_there(ways) -> None:
    left, _ = arms()
    corner = make_position(TRANS, tool, EQ, world_in_left, here, on_left, TL, tool)
    other = make_position(TRANS, tool, EQ, world_in_left, there, on_left, TL, tool)
    move(left, corner)
    wait_for(left.completed)
    setvel(left, 200, 90)
    for passing in (True, False):
        first = len(ways.sent["left"])
        if passing:
            move(left, other)
        else:
            stop(left, other, 300)
        move(left, corner)
        wait_for(left.completed)
        steps = np.abs(np.diff([q for _, q in ways.sent["left"][first:]], axis=0)).max(axis=1)
        moving = np.flatnonzero(steps > 1e-12)
        still = (steps[moving[0] : moving[-1]] < 1e-12).sum() * PERIOD_MS
        assert still == 0 if passing else 300 <= still <= 300 + 6 * PERIOD_MS


def test_a_stop_without_a_position_is_queued_behind_the_motions_before_it(ways) -> None:
    left, _ = arms()
    end, park = pose(left, "end"), pose(left, "park")
    move(left, end)
    stop(left)
    move(left, park)
    wait_for(end.end)
    assert np.allclose(np.radians(left.j6), end.q, atol=1e-9)
    wait_for(left.completed)
    assert np.allclose(np.radians(left.j6), park.q, atol=1e-9)


def test_arms_work_in_step_by_events_and_by_themselves(ways) -> None:
    left, right = arms()
    ends = {arm.name: [pose(arm, "end"), pose(arm, "park")] for arm in (left, right)}
    order = []
    for turn in range(2):
        for arm in (left, right):
            goal = ends[arm.name][turn]
            move(arm, goal)
            wait_for(goal.end)
            order.append(arm.name)
    assert order == ["left", "right"] * 2
    move(left, ends["left"][0])  # and both at once
    move(right, ends["right"][0])
    wait_for(left.completed)
    wait_for(right.completed)
    assert np.allclose(left.j6, right.j6)
    assert len({len(sent) for sent in ways.sent.values()}) <= 2  # neither was left behind


def test_four_corners_of_an_arm_and_of_a_frame_end_as_often_as_they_were_asked_for_s09(ways) -> None:
    obj = frame()
    left, _ = arms()
    p = gentr_trsl("P", 0, 0, 0, "hold")
    goals = {
        left.name: make_position(TRANS, tool, EQ, world_in_left, here, p, TL, tool),
        obj.name: make_position(TRANS, EQ, here, p, TL, TRANS),
    }
    for manip in (left, obj):
        for x, y in ((-40, 0), (-40, 40), (0, 40), (0, 0)):
            trsl(p, x, y, 0)
            move(manip, goals[manip.name])
        wait_for(manip.completed)
        assert goals[manip.name].end.count == 4
        assert goals[manip.name].code == -1


def test_motion_parameters_are_each_manipulators_own(ways) -> None:
    left, right = arms()
    for arm in (left, right):
        move(arm, make_position(TRANS, tool, EQ, world_in_left, here, TL, tool))
    wait_for(left.completed)
    wait_for(right.completed)
    setmode(left, "cartesian")
    setvel(left, 50, 20)
    goal, paths = make_position(TRANS, tool, EQ, world_in_left, there, TL, tool), {"left": [], "right": []}
    other = make_position(TRANS, tool, EQ, world_in_left, there, TL, tool)
    limit(left, "fx", 1e6)  # for the next motion of this arm alone; nothing pushes here
    move(left, goal)
    move(right, other)

    def look() -> bool:
        for arm in (left, right):
            paths[arm.name].append((arm.trans.value @ tool.value)[:3, 3].copy())
        return bool(left.completed.count and right.completed.count)

    wait_as(look)
    begin, line = here.value[:3, 3], (there.value - here.value)[:3, 3]
    off_line = {
        name: max(np.linalg.norm(np.cross(place - begin, line)) / np.linalg.norm(line) for place in path)
        for name, path in paths.items()
    }
    assert off_line["left"] < 1e-9
    assert off_line["right"] > 1e-3
    steps = {name: np.linalg.norm(np.diff(path, axis=0), axis=1).max() for name, path in paths.items()}
    assert steps["left"] <= 0.050 * PERIOD_MS * 1e-3 * 1.001 < steps["right"]


def test_a_position_may_be_solved_for_one_manipulator_alone(ways) -> None:
    left, right = arms()
    mine = make_position(left.trans, tool, EQ, world_in_left, here, TL, tool, unknown=left.trans, name="MINE")
    move(left, mine)
    wait_for(left.completed)
    assert np.allclose(left.trans.value @ tool.value, here.value, atol=1e-9)
    with pytest.raises(MotionError, match=r"MINE is solved for left\.trans: it is no goal of right"):
        move(right, mine)
    hand = gentr_trsl("HAND", 0, 0, 150)
    beside = make_position(TRANS, hand, EQ, world_in_right, left.trans, tool, on_right, TL, hand)
    move(right, beside)  # another arm's own transform is a term like any other
    wait_for(right.completed)


# ---------------------------------------------------------------------------------------------------- bad input


CALLS = [move, maintain, stop, cancel, tracking_mode, rccl_control, rccl_release, grasp, pose, setvel]


@pytest.mark.parametrize("given", [None, "left", 3, float("nan"), []])
def test_what_is_no_manipulator_is_named_by_every_call(ways, given) -> None:
    arms()
    for call in CALLS:
        more = () if call in (cancel, tracking_mode, rccl_control, rccl_release, grasp) else (None,)
        with pytest.raises(MotionError, match=rf"{call.__name__}: a manipulator is needed, from rccl_open"):
            call(given, *more)
    with pytest.raises(MotionError, match="rccl_open"):
        rccl_open(given)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("",), "a name is a word"),
        (("THIRD", "puma560", None), "a bridge is a word, not None"),
        (("THIRD", "puma560", "host:port"), "host:port is needed"),
        (("THIRD", "no such robot"), "no such robot"),
        (("THIRD", "puma560", "127.0.0.1:7000"), r"OTHER is at 127\.0\.0\.1:7000 already"),
        (("object_frame",), "in capitals"),
        (("OBJECT_FRAME", "puma560"), "neither robot nor bridge"),
    ],
)
def test_what_cannot_be_opened_is_refused_at_once(ways, arguments, words: str) -> None:
    rccl_open("OTHER", "puma560", "127.0.0.1:7000")
    with pytest.raises((MotionError, ConfigError), match=words):
        rccl_open(*arguments)


def wrong_position() -> Position:
    return make_position(tool, EQ, here, TL, tool)


@pytest.mark.parametrize(
    ("deed", "words"),
    [
        (lambda obj, _arm: setmode(obj, "joint"), "no joints"),
        (lambda obj, _arm: comply(obj, "fx", 1.0), "exerts no forces"),
        (lambda obj, _arm: limit(obj, "fx", 1.0), "feels no forces"),
        (lambda obj, arm: move(obj, pose(arm, "park")), "given by joints"),
        (lambda _obj, _arm: wrong_position(), "TRANS must stand exactly once"),
        (lambda _obj, _arm: make_position(TRANS, 3, EQ, here, TL, TRANS), "3 is no transform"),
        (lambda _obj, _arm: make_position(TRANS, EQ, here), "TL, the term of the tool"),
        (lambda _obj, _arm: rccl_open("left"), "left is open already"),
        (lambda obj, _arm: rccl_control(obj), "under control already"),
        (lambda _obj, arm: rccl_control(arm), "under control already"),
        (lambda _obj, arm: stop(arm, None, -1), "no negative time"),
        (lambda _obj, arm: wait_for(arm), "an event is needed"),
        (lambda _obj, arm: wait_for(pose(arm, "end").end), "no motion is left"),
        (lambda obj, _arm: grasp(obj), "is an object frame; an arm is needed"),
        (lambda obj, _arm: setjvel(obj, share=0.5), "setjvel: an object frame has no joints"),
        (lambda obj, _arm: setconf(obj, "lun"), "setconf: an object frame has no joints"),
        (lambda _obj, arm: jposition(arm, "X", None), "6 numbers are needed, not None"),
        (lambda _obj, arm: trsl(arm.trans, 1, 2, 3), r"left\.trans is where left is: move it"),
        (lambda _obj, arm: move(arm, "there"), "move: a position is needed, from make_position"),
        (
            lambda _obj, arm: move(arm, make_position(TRANS, EQ, arm.trans, on_left, TL, TRANS)),
            "moves with left itself",
        ),
        (lambda _obj, arm: wait_as(lambda: wait_for(arm.completed)), "a function of wait_as must not wait"),
        (
            lambda obj, _arm: maintain(obj, make_position(TRANS, EQ, obj.trans, TL, TRANS)),
            "moves with OBJECT_FRAME itself",
        ),
        (lambda obj, _arm: (distance(obj, "dz", 1.0), setime(obj, 0, -1)), "setime"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_moves(ways, deed, words: str) -> None:
    obj = frame()
    left, _ = arms()
    stood = left.j6
    with pytest.raises(MotionError, match=words):
        deed(obj, left)
    assert np.array_equal(left.j6, stood)


def test_what_was_not_opened_or_turned_on_moves_nowhere(ways) -> None:
    arm, obj = rccl_open("left"), rccl_open("OBJECT_FRAME")
    goal = make_position(TRANS, EQ, here, TL, TRANS)
    for manip in (arm, obj):
        with pytest.raises(LinkError, match="not under control; call rccl_control first"):
            move(manip, goal)
        with pytest.raises(LinkError, match=r"not under control|no arm"):
            cancel(manip)
    rccl_control(obj)
    move(obj, goal)
    with pytest.raises(LinkError, match="time passes for object frames only beside an arm"):
        wait_for(obj.completed)


def test_frames_that_depend_on_each_other_are_an_error_of_the_program(ways) -> None:
    one, other = frame(), frame(there, "OBJECT_FRAME2")
    arms()
    move(one, make_position(TRANS, EQ, other.trans, on_left, TL, TRANS))
    wait_for(one.completed)
    tracking_mode(other)
    tracking_mode(one)
    move(one, make_position(TRANS, EQ, other.trans, on_left, TL, TRANS))
    move(other, make_position(TRANS, EQ, one.trans, on_left, TL, TRANS))
    with pytest.raises(MotionError, match="its own transform stands in its equation, by way of another frame"):
        wait_as(lambda: False)


def test_a_frame_that_is_not_under_control_is_nowhere(ways) -> None:
    left, _ = arms()
    obj = rccl_open("OBJECT_FRAME")
    with pytest.raises(MotionError, match="OBJECT_FRAME is not under control; call rccl_control first"):
        move(left, make_position(TRANS, tool, EQ, world_in_left, obj.trans, TL, tool))


def test_arms_of_different_sample_periods_do_not_move_together(ways) -> None:
    left, right = rccl_open("left"), rccl_open("right")
    rccl_control(left)
    with pytest.raises(MotionError, match="one sample period, not 28 ms and 14 ms"):
        rccl_control(right, period_ms=14)


def test_the_example_grasps_what_a_camera_tracks_and_carries_it_c22(ways, capsys) -> None:
    runpy.run_path(str(EXAMPLES / "22_two_hands.py"), run_name="__main__")
    assert "the hands came 0.00 mm closer or farther apart" in capsys.readouterr().out
