"""What is added to the push on a motor that stands."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from qrobot.model.dynamics import FrictionParams, friction_torque
from qrobot.model.stiction_compensation import PUSH_SHARE, REST_SHARE, added_at_rest, lead, push_for
from tests.support.thorough import examples

COULOMB_POS, COULOMB_NEG, WITHIN = 20.0, 10.0, 0.02
P = FrictionParams(
    viscous=np.zeros(1), coulomb_pos=np.array([COULOMB_POS]), coulomb_neg=np.array([COULOMB_NEG]),
    velocity=np.array([WITHIN]),
)  # fmt: skip
SPEEDS = st.floats(-0.1, 0.1)
PUSHES = st.floats(-60.0, 60.0)


def added(v: float, push: float) -> float:
    """Friction torque that is made up for on a motor at `v` with `push` on it."""
    speed, tau = np.array([v]), np.empty(1)
    lead(speed, np.array([push]), P)
    friction_torque(speed, P, tau)
    return float(tau[0])


def rubs(v: float) -> float:
    return added(v, 0.0)


@given(v=SPEEDS)
@settings(max_examples=examples(30))
def test_without_a_push_friction_is_that_of_the_velocity_alone(v: float) -> None:
    tau = np.empty(1)
    friction_torque(np.array([v]), P, tau)
    assert rubs(v) == tau[0]


@given(v=SPEEDS, push=PUSHES)
@settings(max_examples=examples(60))
def test_never_more_is_added_than_coulomb_friction_and_at_rest_four_fifths_of_it(v: float, push: float) -> None:
    most = min(1.0, REST_SHARE + (1.0 - REST_SHARE) * abs(v) / WITHIN)
    assert -most * COULOMB_NEG - 1e-9 <= added(v, push) <= most * COULOMB_POS + 1e-9


@given(v=SPEEDS.filter(lambda v: abs(v) >= WITHIN), push=PUSHES)
@settings(max_examples=examples(30))
def test_on_a_motor_that_moves_the_push_adds_nothing(v: float, push: float) -> None:
    assert added(v, push) == rubs(v)


def test_at_rest_a_tenth_of_coulomb_friction_calls_for_four_fifths_of_it_each_way() -> None:
    assert added(0.0, PUSH_SHARE * COULOMB_POS) == pytest.approx(REST_SHARE * COULOMB_POS)
    assert added(0.0, -60.0) == pytest.approx(-REST_SHARE * COULOMB_NEG)
    assert added(0.0, 0.5 * PUSH_SHARE * COULOMB_POS) == pytest.approx(0.5 * REST_SHARE * COULOMB_POS)
    assert added(0.0, 0.0) == 0.0


def test_a_push_against_the_motion_lets_friction_brake() -> None:
    assert added(0.25 * WITHIN, -60.0) < 0.0 < rubs(0.25 * WITHIN)


@given(push=PUSHES)
@settings(max_examples=examples(30))
def test_a_motor_that_rubs_a_tenth_less_than_its_model_is_not_moved_by_less_than_a_tenth_of_its_friction(push) -> None:
    real = 0.9 * (COULOMB_POS if push > 0.0 else COULOMB_NEG)
    if abs(push) < PUSH_SHARE * real:
        assert abs(push + added(0.0, push)) < real


@given(total=PUSHES)
@settings(max_examples=examples(60))
def test_the_push_for_a_torque_amounts_to_it_with_what_is_added(total: float) -> None:
    push = push_for(np.array([total]), P)
    assert push + added_at_rest(push, P) == pytest.approx(total, abs=1e-9)
    assert added(0.0, float(push[0])) == pytest.approx(float(added_at_rest(push, P)[0]), abs=1e-9)


def test_a_motor_without_friction_gets_its_push_and_no_more() -> None:
    smooth = P._replace(coulomb_pos=np.zeros(1), coulomb_neg=np.zeros(1))
    assert push_for(np.array([3.0]), smooth) == pytest.approx(3.0)
    assert added_at_rest(np.array([3.0]), smooth) == 0.0
