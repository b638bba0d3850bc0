"""A stop after a collision does not press on: joints that are held back stop where they are.

A controlled stop goes on along its path, for a tenth of a second and some centimetres of a fast tool; into what the arm
has met. So once a torque nobody commanded works against the reference of a joint, its reference stands where the joint
is: its velocity is damped, it is held with the stiffness of the law, and nothing drives it on. The other joints stop on
their path, as in every stop, and in their turn give way if they are held back.
"""

from __future__ import annotations

from typing import Final

from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.kernels.interpolator import line_through
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

STOPPING: Final = int(Mode.STOPPING)
FELT_SHARE: Final = 0.5  # of the unexplained torque: smaller pushes may be the model's [A]


@lean_kernel
def give_way(params: ServoParameters, state: ServoState) -> None:
    """Let the reference of each joint that is held back after a collision stand where the joint is."""
    if state.watch.yields == 0:
        return
    for j in range(state.q.size):
        felt = FELT_SHARE * state.watch.threshold[j]
        if is_held_back(state.watch.push[j], state.v_ref[j], felt):
            state.watch.gave_way[j] = state.v_ref[j]
            line_through(state.knots, params.first_knot, j, state.phase, state.q[j], 0.0)
            state.q_ref[j], state.v_ref[j], state.a_ref[j] = state.q[j], 0.0, 0.0


@lean_kernel
def is_held_back(push: float, v_ref: float, felt: float) -> bool:
    """A push beyond `felt` acts against the reference."""
    return abs(push) > felt and push * v_ref < 0.0


@lean_kernel
def forget_yielding(state: ServoState) -> None:
    """The next stop is an ordinary one."""
    state.watch.yields = 0
    for j in range(state.q.size):
        state.watch.gave_way[j] = 0.0
