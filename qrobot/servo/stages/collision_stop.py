"""A stop after a collision does not press on: joints that are held back stop where they are.

A controlled stop goes on along its path, for a tenth of a second and some centimetres of a fast tool; into what the arm
has met. So once a torque nobody commanded works against the reference of a joint, its reference stands where the joint
is: its velocity is damped, it is held with the stiffness of the law, and nothing drives it on. The other joints stop on
their path, as in every stop, and in their turn give way if they are held back. A stop for want of torque gives way like
that too: what holds a joint back is its load then.

That is the reaction `STOP`. With `COMPLY` every joint that has given way, or has come to rest, is a soft spring for
`COMPLY_NS` from the beginning of the stop, `SOFT` of the law's stiffness: what is clamped can be freed. Then the arm is
held where it is. A stop for want of torque is never soft: the load would sink.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import FaultCode
from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.checks.motor_fault_diagnosis import FELT_SHARE
from qrobot.servo.kernels.interpolator import line_through
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

HOLDING: Final = int(Mode.HOLDING)
SATURATED: Final = int(FaultCode.SATURATED)
STOP, COMPLY = range(2)
COMPLY_NS: Final = 2_000_000_000  # [A] long enough to pull a hand out
SOFT: Final = 0.1  # of the law's stiffness [A]


@lean_kernel
def take_collision(state: ServoState, mail: Any) -> None:
    """Take thresholds and reaction that somebody asks for; a threshold that is no number is none."""
    command, watch = mail.command, state.watch
    for j in range(state.q.size):
        asked = command.collision_thresholds[j]
        watch.asked[j] = asked if asked > 0.0 else 0.0
    if watch.yields == 0:
        watch.reaction = COMPLY if command.collision_reaction == COMPLY else STOP


@lean_kernel
def begin_yielding(state: ServoState, code: int) -> None:
    """Let the stop that `code` begins give way: softly, if that is the reaction, after a collision alone."""
    if code == SATURATED and state.watch.yields == 0:
        state.watch.reaction = STOP
    state.watch.yields = 1


@lean_kernel
def give_way(params: ServoParameters, state: ServoState, left: float) -> None:
    """Let the reference of each joint that is held back after a collision stand where the joint is.

    `left` is the share of the stop's speed that is left.
    """
    if state.watch.yields == 0:
        return
    for j in range(state.q.size):
        felt = FELT_SHARE * state.watch.threshold[j]
        if is_held_back(state.watch.push[j], state.v_ref[j], felt):
            state.watch.gave_way[j] = state.v_ref[j]
            stand_at(params, state, j, state.q[j])
            soften(state, j)
        elif left == 0.0:
            soften(state, j)
        if state.watch.soft[j] != 0:
            met = state.watch.met[j]
            stand_at(params, state, j, met + (1.0 - SOFT) * (state.q[j] - met))


@lean_kernel
def stand_at(params: ServoParameters, state: ServoState, j: int, q: float) -> None:
    """Let the reference of joint `j` be at `q`, at rest."""
    line_through(state.knots, state.rounding, params.first_knot, j, state.phase, q, 0.0)
    state.q_ref[j], state.v_ref[j], state.a_ref[j] = q, 0.0, 0.0


@lean_kernel
def soften(state: ServoState, j: int) -> None:
    """Make joint `j` a soft spring about where its reference is, if that is the reaction."""
    if state.watch.reaction == COMPLY and state.watch.soft[j] == 0:
        state.watch.soft[j], state.watch.met[j] = 1, state.q_ref[j]


@lean_kernel
def complies(state: ServoState, now_ns: int) -> bool:
    """The arm still gives way to what it has met."""
    soft = state.watch.yields != 0 and state.watch.reaction == COMPLY and state.after_stop == HOLDING
    return bool(soft and now_ns - state.stop_since_ns < COMPLY_NS)


@lean_kernel
def is_held_back(push: float, v_ref: float, felt: float) -> bool:
    """A push beyond `felt` acts against the reference."""
    return abs(push) > felt and push * v_ref < 0.0


@lean_kernel
def forget_yielding(state: ServoState) -> None:
    """The next stop is an ordinary one."""
    state.watch.yields = 0
    for j in range(state.q.size):
        state.watch.gave_way[j], state.watch.soft[j] = 0.0, 0
