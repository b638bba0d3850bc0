"""Positions of the joints while no image shows them: on along their reference, at the velocity last seen.

    lag = q_ref - q        lag' = v_ref - v            as they were when the joints were last seen
    lag += lag' dt         q = q_ref - lag        v = v_ref - lag'        in every cycle without a sample

So q goes on with v, and v changes as the reference's does: the feedback of a law stays what it was. Positions that
stood still while the reference goes on would wind it up, for nothing that the arm does. A good image ends it, or
BOARD_GONE, or ENC_JUMP. Counts stay what was counted, and the estimators of velocity go by them alone.
"""

from __future__ import annotations

from qrobot.realtime.jit import lean_kernel
from qrobot.servo.hold import note_lag
from qrobot.servo.modes import gives_torque
from qrobot.servo.state import ServoState


@lean_kernel
def lose_sight(state: ServoState) -> None:
    """A cycle without a sample: from now on the joints are carried on."""
    if state.unseen == 0:
        for j in range(state.v.size):
            state.v_seen[j] = state.v[j]
    state.unseen = 1


@lean_kernel
def see_again(state: ServoState) -> None:
    """Go by what was seen again; the caller takes the positions from the counts."""
    if state.unseen != 0:
        for j in range(state.v.size):
            state.v[j] = state.v_seen[j]
    state.unseen = 0


@lean_kernel
def hold_through_dropout(state: ServoState) -> None:
    """Note the lag of joints that are seen, once the reference of this cycle is known, and carry on those that are
    not."""
    if not gives_torque(state.mode):
        return
    if state.unseen == 0:
        note_lag(state)
        return
    for j in range(state.q.size):
        state.lag[j] += state.lag_rate[j] * state.dt
        state.q[j], state.v[j] = state.q_ref[j] - state.lag[j], state.v_ref[j] - state.lag_rate[j]
