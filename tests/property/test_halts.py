"""However a motion to a moving goal is ended, and whenever: its setpoints never ask more of a joint than it may do."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from qrobot.motion.path.blend import Blend
from qrobot.motion.path.path_piece import BlendSettings, piece_from_state
from qrobot.motion.planning.joint_stop import can_stop, joint_stop_s
from tests.support.halts import halted
from tests.support.motion import LIMITS
from tests.support.thorough import examples

BATCHES = 8
PROGRAMS = 10  # in each: 1600 were tried when this was written, see decision 51
ROUNDING = 1e-9
SHARE = st.floats(-1.0, 1.0)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("batch", range(BATCHES))
def test_motions_to_moving_goals_keep_the_limits_however_they_end(batch) -> None:
    """Differences of the setpoints, at sample periods of 1, 7 and 28 ms, whatever is done to the motion."""
    for seed in range(batch * PROGRAMS, (batch + 1) * PROGRAMS):
        run = halted(seed)
        assert run.speed <= 1.0 + ROUNDING, seed
        assert run.acceleration <= 1.0 + ROUNDING, seed


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seeds", [range(2000, 2015), range(2015, 2030), (2074, 2111)])
def test_no_program_that_moves_to_goals_at_rest_is_ended_by_the_watch(seeds) -> None:
    """What was planned, up to the joints' own speed, is never too fast when its setpoints are looked at.

    In 2074 a turn would lead out of reach, where the straight ways do not; in 2111 a short way is gone at full speed.
    """
    for seed in seeds:
        run = halted(seed, 6.0, fixed_share=1.0, deeds=("nothing",))
        assert all(code == -1 for _, code in run.codes), seed
        assert max(run.speed, run.acceleration) <= 1.0 + ROUNDING, seed


@given(st.tuples(SHARE, SHARE), st.tuples(SHARE, SHARE), st.sampled_from(Blend))
@settings(max_examples=examples(200))
def test_a_halt_keeps_the_limits_from_every_state_that_may_be_halted(speeds, accelerations, blend) -> None:
    v, a = np.array(speeds) * LIMITS.v_max, np.array(accelerations) * LIMITS.a_max
    for joint in range(2):
        assume(can_stop(v[joint], a[joint], LIMITS.v_max[joint], LIMITS.a_max[joint]))
    state = np.vstack((np.zeros(2), v, a))
    length_s, fading_s = joint_stop_s(state, LIMITS, blend)
    piece = piece_from_state(state, np.zeros(2), 0.0, length_s, fading_s / length_s)
    states = np.array([piece.state(t, BlendSettings(1.0, blend)) for t in np.linspace(0.0, length_s, 400)])
    assert (np.abs(states[:, 1]) <= LIMITS.v_max * (1.0 + 1e-6)).all()
    assert (np.abs(states[:, 2]) <= LIMITS.a_max * (1.0 + 1e-6)).all()
    assert not states[-1, 1:].round(9).any()


def test_what_is_no_number_cannot_be_halted() -> None:
    for v, a in ((np.nan, 0.0), (0.0, np.nan)):
        assert not can_stop(v, a, 1.0, 10.0)
