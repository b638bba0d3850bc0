"""How DRIVE turns: about one axis, as the interpolation of quaternions does, and in the two angles of Paul 1981."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot import rccl
from qrobot.errors import MotionError
from qrobot.model.transform import inverse, rot_z, rpy, so3_exp, so3_log, transform
from qrobot.motion import MotionMode, MoveRequest, OrientationInterpolation, Termination, ToolSpeed
from qrobot.motion.world.drive_transform import drive, drive_parameters
from qrobot.rccl.offline import OfflineLink
from tests.support.puma import PARK, TOOL, Conveyor, arm, at_park, const, puma_generator
from tests.support.thorough import examples
from tests.unit.motion.test_generator import ended, run

ANGLE = st.floats(-3.1, 3.1)
POSES = st.builds(lambda r, p, y, x: transform(rpy(r, p, y), [x, 0.1, -0.2]), ANGLE, ANGLE, ANGLE, st.floats(-0.5, 0.5))
TURNS = st.sampled_from(OrientationInterpolation)
SMALL = st.builds(
    lambda r, p, y, x: const("AWAY", x, 0.04, -0.03, rpy(r, p, y)), *[st.floats(-0.5, 0.5)] * 3, st.floats(-0.08, 0.08)
)
PACE = ToolSpeed(0.2, 0.8)


@given(POSES, TURNS)
@settings(max_examples=examples(60))
def test_parameters_of_any_drive_make_it_again(D, turn) -> None:
    x = drive_parameters(D, turn=turn)
    assert drive(x, turn) == pytest.approx(D, abs=1e-9)
    assert np.linalg.norm(x[3:5]) <= np.pi + 1e-9
    assert abs(x[5]) <= np.pi + 1e-9


@pytest.mark.parametrize("turn", OrientationInterpolation)
@pytest.mark.parametrize("R", [np.eye(3), np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), rot_z(np.pi)])
def test_half_turns_have_parameters_too(R, turn) -> None:
    D = transform(R, [0.1, 0.2, 0.3])
    assert drive(drive_parameters(D, turn=turn), turn) == pytest.approx(D, abs=1e-9)


def quaternion(R: np.ndarray) -> np.ndarray:
    """Scalar first, of either sign."""
    w = so3_log(R)
    angle = float(np.linalg.norm(w))
    return np.array([np.cos(angle / 2), *(np.sinc(angle / 2 / np.pi) * w / 2)])


def slerp(a: np.ndarray, b: np.ndarray, s: float) -> np.ndarray:
    """Shoemake 1985, on the shorter of the two arcs."""
    b = -b if a @ b < 0.0 else b
    angle = np.arccos(min(a @ b, 1.0))
    return a if angle < 1e-9 else (np.sin((1 - s) * angle) * a + np.sin(s * angle) * b) / np.sin(angle)


@given(POSES, POSES, st.floats(0.0, 1.0))
@settings(max_examples=examples(60))
def test_a_turn_about_one_axis_is_the_interpolation_of_quaternions_on_the_shorter_arc(start, goal, s) -> None:
    x = drive_parameters(inverse(goal) @ start)
    there = (goal @ drive((1.0 - s) * x))[:3, :3]
    wanted = slerp(quaternion(start[:3, :3]), quaternion(goal[:3, :3]), s)
    assert abs(quaternion(there) @ wanted) == pytest.approx(1.0, abs=1e-9)
    assert np.linalg.norm(so3_log(goal[:3, :3].T @ start[:3, :3])) == pytest.approx(np.linalg.norm(x[3:]))


def pauls_drive(one: np.ndarray, two: np.ndarray, r: float) -> np.ndarray:
    """D(r), from frame one to frame two: the printed formulas of Paul 1981."""
    n1, o1, a1, p1 = one[:3].T
    n2, o2, a2, p2 = two[:3].T
    psi = np.arctan2(o1 @ a2, n1 @ a2)
    theta = np.arctan2(np.hypot(n1 @ a2, o1 @ a2), a1 @ a2)
    S, C, V = np.sin(psi), np.cos(psi), 1.0 - np.cos(theta)
    row = -S * C * V, C * C * V + np.cos(theta), -S * np.sin(theta)
    sine, cosine = (row[0] * (n1 @ v) + row[1] * (o1 @ v) + row[2] * (a1 @ v) for v in (n2, o2))
    R = so3_exp(r * theta * np.array([-S, C, 0.0])) @ rot_z(r * np.arctan2(sine, cosine))
    return transform(R, r * np.array([n1 @ (p2 - p1), o1 @ (p2 - p1), a1 @ (p2 - p1)]))


@given(POSES, POSES, st.floats(0.0, 1.0))
@settings(max_examples=examples(60))
def test_two_angles_turn_as_pauls_drive_does(start, goal, r) -> None:
    x = drive_parameters(inverse(goal) @ start, turn=OrientationInterpolation.TWO_ANGLES)
    there = goal[:3, :3] @ drive((1.0 - r) * x, OrientationInterpolation.TWO_ANGLES)[:3, :3]
    assert there == pytest.approx((start @ pauls_drive(start, goal, r))[:3, :3], abs=1e-7)


@given(POSES, TURNS, st.floats(0.05, 0.95))
def test_the_frame_turns_at_the_same_speed_all_the_way(D, turn, s) -> None:
    x, step = drive_parameters(D, turn=turn), 1e-5
    before, after = (drive((1.0 - place) * x, turn)[:3, :3] for place in (s - step, s + step))
    speed = np.linalg.norm(so3_log(before.T @ after)) / (2 * step)
    assert speed == pytest.approx(np.linalg.norm(x[3:]), abs=1e-4)


@given(POSES, st.tuples(*[st.floats(-1.0, 1.0)] * 3), TURNS)
@settings(max_examples=examples(50))
def test_parameters_read_one_after_the_other_do_not_jump(D, direction, turn) -> None:
    """A frame turns on and on, past half a circle; near π between two axes nothing could be continuous."""
    w, near = np.array(direction), None
    for place in np.linspace(0.0, 1.0, 60):
        x = drive_parameters(D @ transform(so3_exp(place * w)), near, turn)
        if near is not None and np.linalg.norm(near[3:5]) < 2.8:
            assert np.linalg.norm(x - near) < 0.5
        near = x


@given(SMALL, SMALL)
@settings(max_examples=examples(10))
def test_a_motion_in_two_angles_keeps_the_approach_vector_in_a_plane_and_ends_at_its_goal(first, second) -> None:
    gen = puma_generator()
    for away in (first, second):
        gen.push(
            MoveRequest(
                "m", at_park(away).goal(), PACE, mode=MotionMode.CARTESIAN, turn=OrientationInterpolation.TWO_ANGLES
            )
        )
    normal = np.cross((arm().forward(PARK) @ TOOL.value)[:3, 2], at_park(first).goal().pose(0)[:3, 2])
    outputs, tilted = list(run(gen)), 0
    for output in outputs:
        if ended([output]):
            break
        tilted += abs(normal @ arm().forward(output.q)[:3, 2]) < 1e-9
    assert tilted > 0.6 * outputs.index(output)  # the rest is the transition to the second motion
    assert [code for _, code in ended(outputs)] == [Termination.COMPLETED] * 2
    assert arm().forward(outputs[-1].q) == pytest.approx(at_park(second).goal().pose(0), abs=1e-9)


@pytest.mark.parametrize("turn", OrientationInterpolation)
def test_the_goal_is_met_exactly_while_its_frame_turns(turn) -> None:
    belt = Conveyor(lambda t: (0.02 * t, 0.0, 0.0, 0.2 * np.sin(t)))
    tilt = const("TILT", rotation=rpy(0.3, -0.2, 0.4))
    gen = puma_generator()
    gen.push(MoveRequest("m", at_park(belt.trsf, tilt).goal(), PACE, mode=MotionMode.CARTESIAN, turn=turn))
    for tick in range(1, 200):
        belt.tick = tick
        output = gen.update(tick)
        if ended([output]):
            break
    assert ended([output]) == [("m", Termination.COMPLETED)]
    goal = arm().forward(PARK) @ TOOL.value @ belt.pose(tick) @ tilt.value
    assert arm().forward(output.q) @ TOOL.value == pytest.approx(goal, abs=1e-9)


def test_a_program_chooses_how_to_turn() -> None:
    with rccl.use(OfflineLink), rccl.control("puma560") as channel:
        channel.setmode("cartesian", turn="angles")
        channel.setmode("c")
        with pytest.raises(MotionError, match="turn 'quaternion' is neither 'axis' nor 'angles'"):
            channel.setmode("cartesian", turn="quaternion")
