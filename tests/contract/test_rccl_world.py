"""Programs with transforms and equations, in lock-step against a robot that follows perfectly."""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pytest

from qrobot import rccl
from qrobot.errors import JointLimit, MotionError, Unreachable
from qrobot.motion import Termination
from qrobot.rccl import gentr_trsl, hold, newtrans, rot, trsl, varb, xunit
from qrobot.rci import VirtualLink
from qrobot.wire import Mode
from tests.support.fake_robot import FakeRobot
from tests.support.puma import LIMITS, PARK, PERIOD_S, arm
from tests.support.rccl_table import TABLE, TIP, on_table, programmed, turning_from_park

DONE = Termination.COMPLETED


@pytest.fixture
def robot() -> Iterator[FakeRobot]:
    with programmed() as fake:
        yield fake


def tip(robot: FakeRobot) -> np.ndarray:
    """The tip of the tool in the table's frame, mm. Shape (3,)."""
    return 1000.0 * (np.linalg.inv(TABLE.value) @ arm().forward(np.array(robot.q)) @ TIP)[:3, 3]


def rest(robot: FakeRobot) -> np.ndarray:
    """The tip when everything is done and the robot has taken the last setpoint."""
    rccl.waitfor(rccl.completed)
    sample()
    return tip(robot)


def sample(count: int = 2) -> None:
    begin = rccl.how.t_ns
    rccl.waitas(lambda: rccl.how.t_ns >= begin + count * PERIOD_S * 1e9)


def test_a_move_makes_the_equation_true(robot) -> None:
    p = on_table("P", gentr_trsl("PIN", 10, 20, 30))
    rccl.move(p)
    assert rest(robot) == pytest.approx([10.0, 20.0, 30.0], abs=1e-6)
    assert (p.code, p.scal, p.end.count) == (DONE, 1.0, 1)


def test_the_block_stacking_task_needs_six_equations_and_no_frames_s07(robot) -> None:
    """Hayward & Paul 1986, section 2.2.2: ARM = FINAL_PLACE TOP1 GRASP2 follows from the layout alone."""
    block1, block2 = gentr_trsl("BLOCK1", 0, 0, -20), gentr_trsl("BLOCK2", 0, 100, -20)
    place, top1, grasp = gentr_trsl("FINAL_PLACE", -80, 60, -20), gentr_trsl("TOP1", 0, 0, -40), newtrans("GRASP")
    task = [
        on_table("get_block1", block1, grasp),
        on_table("place_block1", place, grasp),
        on_table("get_block2", block2, grasp),
        on_table("stack_block2", place, top1, grasp),
    ]
    hands = []
    for position, hand in zip(task, [rccl.CLOSE, rccl.OPEN] * 2, strict=True):
        rccl.move(position)
        hands.append((position.name, *rest(robot).round(6).tolist()))
        hand()
    assert hands == [
        ("get_block1", 0.0, 0.0, -20.0),
        ("place_block1", -80.0, 60.0, -20.0),
        ("get_block2", 0.0, 100.0, -20.0),
        ("stack_block2", -80.0, 60.0, -60.0),
    ]
    rccl.move(rccl.park)
    rccl.waitfor(rccl.completed)


def test_one_shot_parameters_are_used_up_by_one_motion_and_sticky_ones_are_not(robot) -> None:
    p = on_table("P", gentr_trsl("PIN", 0, 0, 0))
    rccl.distance("dz rz", -10, 30)
    rccl.move(p)
    assert rest(robot) == pytest.approx([0.0, 0.0, -10.0], abs=1e-6)
    rccl.move(p)
    begin = rccl.how.t_ns
    assert rest(robot) == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    turned = (rccl.how.t_ns - begin) * 1e-9  # 30 degrees at the 90 degrees/s that still hold, and a transition
    assert turned == pytest.approx(30 / 90 + 0.4, abs=0.2)


def test_a_monitor_stops_a_guarded_move_and_update_corrects_the_world_s05(robot) -> None:
    """The approach of Hayward & Paul 1986, section 3.4.1, to a surface 12 mm above where it was thought to be."""
    surface = gentr_trsl("SURFACE", 0, 0, 0)
    p = on_table("P", surface)
    rccl.setvel(20, 90)
    rccl.distance("dz", -40)
    rccl.move(p)
    rccl.distance("dz", 10)  # overshoot
    rccl.evalfn(lambda: 7 if tip(robot)[2] > -12.0 else 0)
    rccl.update(surface, p)
    rccl.move(p)
    rccl.waitfor(rccl.completed)
    assert p.code == 7
    assert surface.p.z == pytest.approx(-12.0, abs=2.0)  # where it was interrupted
    assert (surface.p.x, surface.p.y) == pytest.approx((0.0, 0.0), abs=0.01)
    rccl.move(p)
    assert rest(robot) == pytest.approx([*surface.p], abs=1e-6)


def test_path_correction_by_a_sensor_follows_a_surface_s05(robot) -> None:
    """S-05: the functional transform integrates (sensor - OFFSET) gain along z while the tool moves along y."""
    wavy = lambda y: 5.0 * np.sin(y / 20.0)  # noqa: E731 (the height of the surface, mm)

    def sensfn(t: rccl.Transform) -> None:
        _, y, z = tip(robot)
        t.p.z += np.clip(wavy(y) - 20.0 - z, -2.0, 2.0) * 0.2  # no sensor sees further

    sens = newtrans("SENS", sensfn)
    begin = on_table("BEGIN", trsl(newtrans("OVER"), 0, 0, -20), sens)
    end = on_table("END", trsl(newtrans("DISP"), 0, 100, -20), sens)
    rccl.setvel(25, 90)
    rccl.move(begin)
    rccl.waitas(lambda: abs(tip(robot)[2] + 20.0 - wavy(tip(robot)[1])) < 0.1 and begin.end.count)
    rccl.move(end)
    errors = []
    rccl.waitas(lambda: errors.append(tip(robot)[2] - wavy(tip(robot)[1]) + 20.0) or end.scal > 0.95)
    assert np.abs(errors).max() < 2.5
    assert np.ptp(errors) > 0.05  # the surface does move


def test_a_function_is_called_while_its_motion_is_the_next_one_and_what_goes_by_scal_begins_with_it(robot) -> None:
    calls: list[float] = []

    def sensfn(t: rccl.Transform) -> None:
        calls.append(end.scal)
        if end.scal > 0.0:
            t.p.z -= 0.1

    sens = newtrans("SENS", sensfn)
    begin, end = on_table("BEGIN", gentr_trsl("A", 0, 0, -20)), on_table("END", gentr_trsl("B", 0, 60, -20), sens)
    rccl.setime(200, 2800)
    rccl.move(begin)
    rccl.move(end)
    rccl.override(50)
    sample(20)
    rccl.pause()
    sample(40)
    rccl.resume()
    rccl.override(100)
    rccl.waitas(lambda: begin.end.count > 0)
    before = sum(scal == 0.0 for scal in calls)
    assert before > 2800 / 28
    assert sens.p.z == pytest.approx(-0.1 * (len(calls) - before))
    assert len(calls) - before < 0.2 / PERIOD_S + 2  # it has begun half a transition ago
    rccl.waitfor(end.end)
    rccl.move(rccl.there)


def test_functions_of_scal_draw_a_circle_that_begins_and_ends_gently_s06(robot) -> None:
    """The motion of the crank of Hayward & Paul 1986, section 3.4.2, without its forces: two opposite rotations."""
    turns, radius = 2, 40.0
    turn: list[rccl.Position] = []
    rotpx = newtrans("ROTPX", lambda t: rot(t, xunit, turn[0].scal * 360 * turns))
    rotnx = newtrans("ROTNX", lambda t: rot(t, xunit, -turn[0].scal * 360 * turns))
    shaft, handle = gentr_trsl("SHAFT", 0, 50, -100), gentr_trsl("HANDLE", 0, radius, 0)
    turn.append(on_table("TURN", shaft, rotpx, handle, rotnx))
    rccl.move(on_table("GET", shaft, handle))
    rest(robot)
    rccl.setime(200, 4000 * turns)
    rccl.move(turn[0])
    places = []
    rccl.waitas(lambda: places.append(tip(robot)) or turn[0].end.count > 0)
    around = np.array(places) - [0.0, 50.0, -100.0]
    assert np.hypot(around[:, 1], around[:, 2]) == pytest.approx(radius, abs=1e-6)
    angle = np.unwrap(np.arctan2(around[:, 2], around[:, 1]))
    assert angle[-1] - angle[0] == pytest.approx(2 * np.pi * turns, abs=0.02)
    assert turn[0].code == DONE


def test_the_four_kinds_of_transforms_serve_one_equation(robot) -> None:
    varying, held = newtrans("V", varb), newtrans("H", hold)
    function = newtrans("F", lambda t: trsl(t, 0, 0, -10))
    p = on_table("P", gentr_trsl("C", 5, 0, 0), varying, held, function)
    for y in (10, 40):
        trsl(held, 0, y, 0)
        rccl.move(p)
    trsl(held, 900, 900, 900)
    rccl.waitfor(p.end)
    assert rest(robot) == pytest.approx([5.0, 40.0, -10.0], abs=1e-6)
    varying.p.x = 0.5
    sample()
    assert tip(robot) == pytest.approx([5.5, 40.0, -10.0], abs=1e-6)


def test_a_move_to_there_is_an_absolute_stop(robot) -> None:
    def drift(t: rccl.Transform) -> None:
        t.p.y += 1.0

    p = on_table("P", newtrans("DRIFT", drift))
    rccl.move(p)
    rccl.waitfor(rccl.completed)
    before = tip(robot)
    sample(10)
    assert tip(robot)[1] > before[1] + 5.0
    rccl.move(rccl.there)
    still = rest(robot)
    sample(10)
    assert (tip(robot) == still).all()
    assert rccl.there.code == DONE


def test_an_arm_that_follows_a_frame_is_brought_to_rest_before_it_is_released(robot) -> None:
    def drift(t: rccl.Transform) -> None:
        t.p.y += 2.0

    rccl.move(on_table("P", newtrans("DRIFT", drift)))
    rccl.waitfor(rccl.completed)
    sample(20)
    rccl.release()
    steps = np.diff(np.array(robot.path), axis=0)
    assert np.abs(steps).max() > 1e-3
    assert np.abs(steps[-1]).max() < 2e-4
    braking = np.diff(steps[-25:], axis=0) / PERIOD_S**2
    assert (np.abs(braking) <= 1.06 * LIMITS.a_max).all()


def test_a_goal_that_turns_a_joint_to_its_limit_is_lost_and_the_position_names_that_joint(robot) -> None:
    p = rccl.makeposition("P", rccl.t6, rccl.EQ, *turning_from_park(), rccl.TL, rccl.t6)
    rccl.move(p)
    rccl.waitas(lambda: p.code < DONE)
    assert p.code == Termination.JOINT_LIMIT
    assert re.fullmatch(r"joint \d \(\w+\) at \S+ deg could not stop within its range, \S+ deg to \S+ deg", p.why)
    rccl.release()


def test_a_position_that_was_dropped_does_not_hear_what_became_of_the_one_that_the_arm_stayed_with(robot) -> None:
    p = rccl.makeposition("P", rccl.t6, rccl.EQ, *turning_from_park(), rccl.TL, rccl.t6)
    q = on_table("Q")
    rccl.move(p)
    rccl.waitas(lambda: p.code == DONE)
    rccl.move(q)
    rccl.nextmove(7)
    rccl.waitas(lambda: p.code < DONE or q.code < DONE)
    assert (p.code, q.code) == (Termination.JOINT_LIMIT, 7)
    assert "could not stop within its range" in p.why
    assert not q.why
    rccl.release()


def test_a_frame_that_carries_the_arm_out_of_reach_ends_in_a_stop_with_its_code(robot) -> None:
    def flee(t: rccl.Transform) -> None:
        t.p.x -= 4.0  # away from the base

    p = on_table("P", newtrans("AWAY", flee))
    rccl.move(p)
    rccl.waitas(lambda: p.code < DONE)
    assert p.code in (Termination.UNREACHABLE, Termination.SINGULAR, Termination.JOINT_LIMIT)
    sample(20)
    still = tip(robot)
    sample(5)
    assert (tip(robot) == still).all()
    assert robot.mode is Mode.TRACKING


@pytest.mark.parametrize("where", ["transform", "monitor"])
def test_a_fault_in_a_background_function_is_an_error_in_the_program_and_the_arm_stops(where) -> None:
    """B-48: never a crash, never a silent death."""
    fake = FakeRobot(tuple(PARK))

    def fail(*_: object) -> None:
        raise ZeroDivisionError("my own mistake")

    with rccl.use(lambda hello: VirtualLink(hello, fake.transfer)):
        rccl.control()
        rccl.setmode("c")
        p = on_table("P", *([newtrans("BAD", fail)] if where == "transform" else []))
        if where == "monitor":
            rccl.evalfn(fail)
        rccl.move(p)
        with pytest.raises(ZeroDivisionError, match="my own mistake"):
            rccl.waitfor(p.end)
        assert fake.goodbyes
        with pytest.raises(ZeroDivisionError):
            rccl.move(p)
        rccl.release()


@pytest.mark.parametrize("result", [-1, -3, 0.4, 7.5, float("nan"), float("inf"), "x", [1]])
def test_what_a_monitor_returns_that_is_no_code_is_an_error_of_the_program_and_the_arm_stops(result) -> None:
    fake = FakeRobot(tuple(PARK))
    with rccl.use(lambda hello: VirtualLink(hello, fake.transfer)):
        rccl.control()
        p = on_table("P")
        rccl.evalfn(lambda: result)
        rccl.move(p)
        with pytest.raises(MotionError, match=f"motion to P: its monitor .* returned {re.escape(repr(result))}"):
            rccl.waitfor(p.end)
        assert (p.code, fake.goodbyes) == (0, 1)
        rccl.release()


@pytest.mark.parametrize(("result", "code"), [(True, 1), (np.bool_(True), 1), (np.int64(7), 7), (7.0, 7)])
def test_what_a_monitor_returns_may_be_a_comparison_or_any_kind_of_whole_number(robot, result, code) -> None:
    p = on_table("P")
    rccl.evalfn(lambda: result)
    rccl.move(p)
    rccl.waitfor(rccl.completed)
    assert p.code == code


@pytest.mark.parametrize(
    ("deed", "error", "words"),
    [
        (lambda: rccl.move(on_table("P", gentr_trsl("FAR", -2000, 0, 0))), Unreachable, "move to P: .*out of the arm"),
        (lambda: (rccl.distance("dz", 1.0), rccl.move(rccl.park)), MotionError, "distance modifies positions that"),
        (lambda: (rccl.setconf("ruf"), rccl.move(on_table("P"))), MotionError, "no straight line changes"),
        (
            lambda: (rccl.setmode("j"), rccl.setconf("run"), rccl.move(on_table("P"))),
            JointLimit,
            "move to P: configuration 'run'",
        ),
    ],
)
def test_what_cannot_be_is_refused_with_the_reason_and_the_program_goes_on(robot, deed, error, words) -> None:
    with pytest.raises(error, match=words):
        deed()
    rccl.setconf("")
    rccl.move(on_table("NEXT", gentr_trsl("PIN", 0, 0, -10)))
    assert rest(robot) == pytest.approx([0.0, 0.0, -10.0], abs=1e-6)
