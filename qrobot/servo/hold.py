"""Holding the arm: its reference, and its range, while nothing moves it."""

from __future__ import annotations

from qrobot.realtime.jit import lean_kernel
from qrobot.servo.kernels.interpolator import rest_at
from qrobot.servo.memory.setpoint_queue import POSITION_SETPOINT
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState


@lean_kernel
def hold_position(state: ServoState) -> None:
    """Make the measured position the reference, at rest."""
    for j in range(state.q.size):
        state.q_ref[j], state.v_ref[j], state.a_ref[j] = state.q[j], 0.0, 0.0
        state.joint_modes[j] = POSITION_SETPOINT
        state.torque_setpoint[j] = 0.0
    rest_at(state.knots, state.rounding, state.q_ref)
    note_lag(state)


@lean_kernel
def hold_reference(state: ServoState) -> None:
    """Stay at the reference, at rest."""
    for j in range(state.q.size):
        state.v_ref[j], state.a_ref[j] = 0.0, 0.0
        state.joint_modes[j] = POSITION_SETPOINT
        state.torque_setpoint[j] = 0.0
    rest_at(state.knots, state.rounding, state.q_ref)


@lean_kernel
def note_lag(state: ServoState) -> None:
    """Remember how far the joints lag behind their reference, and how fast that grows."""
    for j in range(state.q.size):
        state.lag[j], state.lag_rate[j] = state.q_ref[j] - state.q[j], state.v_ref[j] - state.v[j]


@lean_kernel
def allow_range(params: ServoParameters, state: ServoState) -> None:
    """Allow the robot's range at power-up, and the way back of an arm that stands outside it."""
    for j in range(state.q.size):
        q, margin = state.q[j], params.range_margin[j]
        state.range_min[j] = params.q_min[j] if q >= params.q_min[j] else q - margin
        state.range_max[j] = params.q_max[j] if q <= params.q_max[j] else q + margin


@lean_kernel
def narrow_range(params: ServoParameters, state: ServoState) -> None:
    """An arm on its way back into its range does not leave it any further again."""
    for j in range(state.q.size):
        q, margin = state.q[j], params.range_margin[j]
        state.range_min[j] = max(state.range_min[j], min(params.q_min[j], q - margin))
        state.range_max[j] = min(state.range_max[j], max(params.q_max[j], q + margin))
