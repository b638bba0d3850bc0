"""Corners of the path are rounded where the reference would be too fast, as little as that takes, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from qrobot.servo.kernels.interpolation_polynomials import FORMS, Form
from qrobot.servo.kernels.interpolator import reference, rest_at, shift_extrapolated, shift_in
from qrobot.servo.kernels.rounding import SLOW, round_corner

SAMPLED = 0.01  # of the limit: how much faster it may be between the instants that are looked at
V_MAX = np.array([1.4])
PHASES = np.linspace(0.0, 1.0, 51)
SMOOTH_FORMS = [FORMS["quintic"], FORMS["cubic"]]
# acceleration in each frame, as a share of the most there is: the extremes, and anything between
accelerations = st.lists(st.sampled_from([-1.0, 0.0, 1.0]) | st.floats(-1.0, 1.0), min_size=1, max_size=25)
periods = st.floats(0.007, 0.1)
limits = st.floats(5.0, 60.0)  # rad/s^2


def legal_steps(shares: list[float], a_max: float, period: float, v_max: float = V_MAX[0]) -> list[float]:
    """Steps of one joint from rest to rest, within v_max and a_max."""
    velocities, change = [0.0], a_max * period
    for share in shares:
        velocities.append(float(np.clip(velocities[-1] + share * change, -v_max, v_max)))
    while velocities[-1] != 0.0:
        velocities.append(velocities[-1] - float(np.clip(velocities[-1], -change, change)))
    return [velocity * period for velocity in [*velocities, 0.0, 0.0, 0.0]]


class Path:
    """What becomes of the setpoints of one joint, frame by frame."""

    def __init__(self, form: Form, period: float) -> None:
        self.form, self.period = form, period
        self.knots, self.rounding = np.zeros((4, 1)), np.zeros((2, 1))
        rest_at(self.knots, self.rounding, np.zeros(1))

    def take(self, setpoint: float | None) -> None:
        """The next one, or None for one that is missing."""
        if setpoint is None:
            shift_extrapolated(self.knots)
        else:
            shift_in(self.knots, np.array([setpoint]))
        round_corner(self.form.table, self.knots, self.rounding, V_MAX, self.period)

    def speed(self) -> float:
        """The largest of the frame."""
        return max(abs(self.at(phase)[1]) for phase in PHASES)

    def at(self, phase: float) -> tuple[float, float, float]:
        q, v, a = np.zeros(1), np.zeros(1), np.zeros(1)
        reference(self.form.table, self.knots, self.rounding, phase, 1.0 / self.period, 0.0, q, v, a)
        return float(q[0]), float(v[0]), float(a[0])


@pytest.mark.parametrize("form", SMOOTH_FORMS, ids=lambda form: form.name)
@given(accelerations, limits, periods, st.sets(st.integers(1, 25)))
def test_the_reference_of_a_legal_stream_is_as_fast_as_the_joint_may_be_at_most_with_frames_lost_or_not(
    form: Form, shares: list[float], a_max: float, period: float, lost: set[int]
) -> None:
    path, place = Path(form, period), 0.0
    for i, step in enumerate(legal_steps(shares, a_max, period)):
        place += step
        missing = i in lost and i - 1 not in lost
        if not missing and i - 1 in lost:  # led back: a step no longer than the joint can make
            place = path.knots[3, 0] + float(np.clip(place - path.knots[3, 0], -V_MAX[0] * period, V_MAX[0] * period))
        path.take(None if missing else place)
        assert path.speed() <= (1.0 + SAMPLED) * V_MAX[0]


@pytest.mark.parametrize("form", SMOOTH_FORMS, ids=lambda form: form.name)
@given(accelerations, limits, periods)
def test_it_passes_every_setpoint_within_a_sixth_of_the_bend_there_and_comes_to_rest_on_the_last(
    form: Form, shares: list[float], a_max: float, period: float
) -> None:
    path = Path(form, period)
    for place in np.cumsum(legal_steps(shares, a_max, period)):
        path.take(float(place))
        bend = float(path.knots[3, 0] - 2.0 * path.knots[2, 0] + path.knots[1, 0])
        beside = path.at(1.0)[0] - float(path.knots[2, 0])
        assert -1e-12 <= beside * np.sign(bend) <= abs(bend) / 6.0 + 1e-12
    assert path.at(0.0)[0] == pytest.approx(path.knots[3, 0], abs=1e-12)


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
@given(accelerations, limits, periods)
def test_at_up_to_half_the_speed_no_corner_is_rounded(
    form: Form, shares: list[float], a_max: float, period: float
) -> None:
    path = Path(form, period)
    for place in np.cumsum(legal_steps(shares, a_max, period, SLOW * V_MAX[0])):
        path.take(float(place))
        assert not path.rounding.any()


@pytest.mark.parametrize("name", ["linear", "b-spline"])
def test_forms_that_are_never_faster_than_their_steps_need_no_rounding(name: str) -> None:
    path = Path(FORMS[name], 0.1)
    for place in np.cumsum([0.14, -0.14, 0.14, 0.14, 0.14, -0.14]):
        path.take(float(place))
        assert not path.rounding.any()


def test_a_start_to_full_speed_within_one_frame_is_rounded_to_the_limit_and_no_further() -> None:
    fastest = []
    path = Path(FORMS["quintic"], 0.1)
    for place in np.cumsum([0.0, 0.0, 0.0, 0.14, 0.14, 0.14, 0.14]):
        path.take(float(place))
        fastest.append(path.speed())
    assert max(fastest) == pytest.approx(V_MAX[0], rel=SAMPLED)


@given(st.floats(1.0, 2.0))
def test_a_stream_beyond_the_limit_is_no_faster_than_its_steps(excess: float) -> None:
    path = Path(FORMS["quintic"], 0.1)
    for place in np.cumsum([0.0, *[0.14 * excess] * 6]):
        path.take(float(place))
        assert path.speed() <= excess * (1.0 + SAMPLED) * V_MAX[0]
