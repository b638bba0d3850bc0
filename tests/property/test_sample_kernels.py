"""The kernels of a generator's sample, from what they stand for."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.model.transform import inverse, so3_exp, transform
from qrobot.motion import Blend, MotionLimits, Termination
from qrobot.motion.path.blend import PEAK
from qrobot.motion.path.setpoint_history import motion_of
from qrobot.motion.planning.joint_stop import BULGE, SHORTEST_STOP_S, joint_stop_s
from qrobot.motion.planning.setpoint_check import joint_at_limit, judge_next, judge_row
from qrobot.motion.world.product import multiply_chain
from tests.support.motion import LIMITS
from tests.support.thorough import examples

numbers = st.floats(-3.0, 3.0)
vectors = st.lists(numbers, min_size=3, max_size=3)
poses = st.tuples(vectors, vectors).map(lambda parts: transform(so3_exp(parts[0]), parts[1]))
factors = st.lists(st.tuples(poses, st.booleans()), max_size=6)
PERIOD_S = 0.01


@given(factors)
@settings(max_examples=examples(50))
def test_a_chain_is_the_product_of_its_factors_and_inverses(chain) -> None:
    expected, out = np.eye(4), np.full((4, 4), np.nan)
    for pose, inverted in chain:
        expected = expected @ (inverse(pose) if inverted else pose)
    parts = np.array([pose for pose, _ in chain]).reshape(len(chain), 4, 4)
    multiply_chain(parts, np.array([inverted for _, inverted in chain], dtype=np.bool_), out)
    np.testing.assert_allclose(out, expected, atol=1e-12)


@given(st.lists(numbers, min_size=3, max_size=3), st.integers(1, 5), st.integers(1, 5))
@settings(max_examples=examples(50))
def test_the_motion_at_the_end_of_three_samples_is_that_of_the_parabola_through_them(coefficients, far, near) -> None:
    position, velocity, bend = coefficients
    ticks = [0, far, far + near]
    t = [tick * PERIOD_S for tick in ticks]
    points = [
        (tick, np.array([position + velocity * s + 0.5 * bend * s * s])) for tick, s in zip(ticks, t, strict=True)
    ]
    state = motion_of(points, PERIOD_S)
    np.testing.assert_allclose(state[:, 0], [points[2][1][0], velocity + bend * t[2], bend], atol=1e-9)


def test_what_was_seen_once_stands_and_what_was_seen_twice_does_not_accelerate() -> None:
    a, b = (3, np.array([1.0])), (5, np.array([1.5]))
    assert motion_of([a], PERIOD_S)[:, 0].tolist() == [1.0, 0.0, 0.0]
    assert motion_of([a, b], PERIOD_S)[:, 0] == pytest.approx([1.5, 0.5 / 0.02, 0.0])


@given(st.lists(st.lists(st.floats(-0.05, 0.05), min_size=6, max_size=6), min_size=3, max_size=9))
@settings(max_examples=examples(50))
def test_a_row_of_setpoints_is_right_when_each_is_beside_the_two_before(steps: list[list[float]]) -> None:
    joints = np.cumsum(np.cumsum(steps, axis=0), axis=0) * 0.3
    threes = [[(k, joints[k]) for k in range(begin, begin + 3)] for begin in range(len(joints) - 2)]
    codes = [judge_next(three, PERIOD_S, LIMITS, Blend.QUARTIC) for three in threes]
    found = judge_row(joints, PERIOD_S, LIMITS, Blend.QUARTIC)
    assert found is next((code for code in reversed(codes) if code is not Termination.NONE), Termination.NONE)


def judged(q: np.ndarray, v: np.ndarray, a: np.ndarray, limits: MotionLimits = LIMITS) -> Termination:
    """Of a setpoint `q` that moves with `v` and accelerates with `a`."""
    points = [(tick, q + v * s + 0.5 * a * s * s) for tick, s in ((7, -2 * PERIOD_S), (8, -PERIOD_S), (9, 0.0))]
    return judge_next(points, PERIOD_S, limits, Blend.QUARTIC)


MIDDLE, NOTHING = np.array([0.5, 0.0]), np.zeros(2)


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_speed_and_acceleration_are_judged_joint_by_joint_at_their_limits(joint, sign) -> None:
    v, a = np.zeros(2), np.zeros(2)
    v[joint], a[joint] = sign * LIMITS.v_max[joint], sign * LIMITS.a_max[joint]
    for share, code in ((0.999, Termination.NONE), (1.001, Termination.TOO_FAST)):
        assert judged(MIDDLE, share * v, NOTHING) is code
        assert judged(MIDDLE, NOTHING, share * a) is code


@pytest.mark.parametrize("joint", [0, 1])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_what_still_gathers_speed_is_told_while_that_can_fade_out_below_the_limit(joint, sign) -> None:
    """In the time of the shortest halt, as a share of what the joint accelerates at most."""
    v, a = np.zeros(2), np.zeros(2)
    a[joint] = 0.8 * sign * LIMITS.a_max[joint]
    reserve = BULGE * SHORTEST_STOP_S * 0.8 * abs(a[joint])
    for spare, code in ((1.001, Termination.NONE), (0.999, Termination.TOO_FAST)):
        v[joint] = sign * (LIMITS.v_max[joint] - spare * reserve)
        assert judged(MIDDLE, v, a) is code
        assert judged(MIDDLE, v, -a) is Termination.NONE


@pytest.mark.parametrize(("side", "joint"), [("q_min", 0), ("q_max", 0), ("q_min", 1), ("q_max", 1)])
def test_a_joint_is_at_its_limit_while_it_can_still_stop_before_it(side, joint) -> None:
    """It needs half the time of its halt, which lasts PEAK v / a_stop and at least a tenth of a second."""
    limit, v = getattr(LIMITS, side)[joint], np.zeros(2)
    v[joint] = np.sign(limit) * 0.9 * LIMITS.v_max[joint]
    halt = max(SHORTEST_STOP_S, PEAK[Blend.QUARTIC] * abs(v[joint]) / LIMITS.a_stop[joint])
    assert joint_stop_s(np.vstack((MIDDLE, v, NOTHING)), LIMITS, Blend.QUARTIC)[0] == pytest.approx(halt)
    for share, code in ((1.001, Termination.NONE), (0.999, Termination.JOINT_LIMIT)):
        q = MIDDLE.copy()
        q[joint] = limit - share * 0.5 * halt * v[joint]
        assert judged(q, v, NOTHING) is code
    for other in (0.0, 0.6, -0.6):  # in the middle, or beyond its range, where it began
        q[1 - joint] = MIDDLE[1 - joint] + other * (LIMITS.q_max - LIMITS.q_min)[1 - joint]
        points = [(tick, q + (tick - 3) * PERIOD_S * v) for tick in (1, 2, 3)]
        assert joint_at_limit(points, PERIOD_S, LIMITS, Blend.QUARTIC) == joint


@pytest.mark.parametrize(("side", "joint"), [("q_min", 0), ("q_max", 0), ("q_min", 1), ("q_max", 1)])
def test_a_joint_beyond_its_limit_may_stand_there_and_come_back_and_goes_no_farther(side, joint) -> None:
    """A wrist without power falls, and a goal that moves is judged from where it has fallen to."""
    out, q = np.sign(getattr(LIMITS, side)[joint]), MIDDLE.copy()
    q[joint] = getattr(LIMITS, side)[joint] + 0.01 * out
    inwards, outwards = np.zeros(2), np.zeros(2)
    inwards[joint], outwards[joint] = -0.1 * out, 0.1 * out
    assert judged(q, NOTHING, NOTHING) is Termination.NONE
    assert judged(q, inwards, NOTHING) is Termination.NONE
    assert judged(q, 1e-3 * outwards, NOTHING) is Termination.JOINT_LIMIT
    assert judged(q, outwards, NOTHING) is Termination.JOINT_LIMIT


def test_a_turn_of_more_than_half_a_circle_between_samples_is_a_joint_at_its_limit() -> None:
    points = [(1, np.array([-1.6, 0.0])), (2, np.array([1.6, 0.0]))]
    assert judge_next(points, PERIOD_S, LIMITS, Blend.QUARTIC) is Termination.JOINT_LIMIT
    assert joint_at_limit(points, PERIOD_S, LIMITS, Blend.QUARTIC) == 0


def test_what_is_no_number_never_passes() -> None:
    assert judged(np.array([np.nan, 0.0]), NOTHING, NOTHING) is not Termination.NONE
