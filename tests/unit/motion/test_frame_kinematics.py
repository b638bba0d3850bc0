"""A frame that no arm carries: any pose, and on and on about one axis."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.errors import MotionError
from qrobot.model.branch import Branch
from qrobot.model.transform import rpy, so3_exp, transform
from qrobot.motion import T6, Equation, EventKind, Generator, MotionMode, MoveRequest, ToolSpeed, TransformKind, Trsf
from qrobot.motion.world.frame_kinematics import FrameKinematics, frame_limits

PERIOD_S = 0.028
K = FrameKinematics()
coordinate = st.floats(-3.0, 3.0)


@given(st.lists(coordinate, min_size=6, max_size=6), st.lists(coordinate, min_size=6, max_size=6))
def test_the_inverse_leads_to_the_pose_by_the_nearest_whole_turns(q: list[float], near: list[float]) -> None:
    pose = K.forward(np.array(q))
    found = K.inverse(pose, Branch.RUN, np.array(near))
    assert np.allclose(K.forward(found), pose, atol=1e-9)
    around = np.linalg.norm(found[3:])
    if around > 1e-6:
        axis = found[3:] / around
        assert abs(axis @ (np.array(near)[3:] - found[3:])) <= np.pi + 1e-6


def test_a_frame_that_turns_on_and_on_has_no_jump() -> None:
    axis, q = np.array([0.6, 0.0, 0.8]), np.zeros(6)
    for turn in np.arange(0.0, 20.0, 0.05):
        before, q = q, K.inverse(transform(so3_exp(turn * axis)), Branch.RUN, q)
        assert np.abs(q - before).max() < 0.0501
    assert np.allclose(q[3:], 19.95 * axis)


def goal(name: str, term: Trsf) -> MoveRequest:
    equation = Equation(name, [T6], [term], T6)
    return MoveRequest(name, equation.goal(), ToolSpeed(0.2, 2.0), mode=MotionMode.CARTESIAN)


def test_the_generator_moves_a_frame_on_straight_lines_and_into_any_orientation() -> None:
    generator, tick = Generator(frame_limits(), PERIOD_S, np.zeros(6), kinematics=K), 0
    there = Trsf("THERE", TransformKind.CONST, transform(rpy(3.0, 0.4, -2.0), [0.4, -0.2, 0.3]))
    generator.push(goal("THERE", there))
    places = []
    while (output := generator.update(tick := tick + 1)).moving:
        places.append(K.forward(output.q)[:3, 3])
    assert np.allclose(K.forward(output.q), there.value, atol=1e-12)
    line = there.value[:3, 3] / np.linalg.norm(there.value[:3, 3])
    assert max(np.linalg.norm(place - (place @ line) * line) for place in places) < 1e-12


def test_a_frame_follows_a_moving_goal_from_the_first_sample_and_leaves_it_without_a_jump() -> None:
    sample = [0]

    def drift(t: Trsf) -> None:
        t.value = transform(so3_exp([0.0, 0.0, 0.02 * sample[0]]), [0.003 * sample[0], 0.0, 0.2])

    moving = Equation("MOVING", [T6], [Trsf("DRIFT", TransformKind.FUNCTION, function=drift)], T6).goal()
    q = K.inverse(moving.pose(0), Branch.RUN, np.zeros(6))
    generator = Generator(frame_limits(), PERIOD_S, q, kinematics=K)
    generator.follow(moving)
    for sample[0] in range(1, 100):
        q = generator.update(sample[0]).q
        assert np.allclose(K.forward(q), moving.pose(sample[0]), atol=1e-12)
    place = Trsf("PLACE", TransformKind.CONST, transform(rpy(0.3, 0.0, 0.0), [0.5, 0.1, 0.2]))
    generator.push(goal("PLACE", place))
    points, events = [q], []
    for sample[0] in range(100, 400):
        output = generator.update(sample[0])
        points.append(output.q)
        events += [event.kind for event in output.events]
    assert events == [EventKind.BEGUN, EventKind.ENDED, EventKind.IDLE]
    speeds = np.diff(points, axis=0) / PERIOD_S
    assert np.abs(np.diff(speeds, axis=0)).max() / PERIOD_S < 25.0
    assert np.allclose(K.forward(points[-1]), place.value, atol=1e-12)


def test_who_has_no_kinematics_follows_nothing() -> None:
    still = Equation("STILL", [T6], [Trsf("A", TransformKind.CONST)], T6).goal()
    with pytest.raises(MotionError, match="kinematics"):
        Generator(frame_limits(), PERIOD_S, np.zeros(6)).follow(still)
