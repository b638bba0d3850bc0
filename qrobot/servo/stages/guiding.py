"""An arm that is led by a hand: joints driven by torque, in a stream that moves only while a key is held.

Their reference goes with them, so that no feedback holds them; gravity is carried on all of them, and most of their
friction. What is left of the law is damping, a limit of speed, and a wall before each end of the range:

    v_ref = (1 - DAMPING) v, less of it beyond GUIDE_SPEED of the tool's tip, and within GUIDE_SHARE of a joint's speed
    q_ref = q, but no farther than WALL before the ends, or than where the joint stood when it was let go

so whatever law is in force brakes the difference with its own gains. Without its key the arm is stopped on its way and
held (`servo.checks.hold_to_run`).
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import NO_JOINT
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.checks.tip_speed import check_tip_speed, tip_speed
from qrobot.servo.event import report_fault
from qrobot.servo.memory.setpoint_queue import TORQUE_SETPOINT
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

GUIDE_SPEED: Final = 0.25  # m/s of the tip: reduced speed of ISO 10218-1
GUIDE_SHARE: Final = 0.25  # of the greatest speed of a joint [A]
DAMPING: Final = 0.1  # of the law's damping, at any speed [A]
FRICTION_SHARE: Final = 0.7  # of the model's friction: with more, a model that is a third too large drives the arm [A]
WALL: Final = 0.05  # rad (m) before the end of a range, [A]
WALL_SHARE: Final = 0.25  # but no more than this share of the range [A]
BRAKING: Final = 0.6  # of the law's damping, on what the tip is too fast; the gains bear twice their size [A]
TOO_FAST: Final = 1.6  # times the speed of the tip: braking is not enough, and the arm is stopped [A]


@lean_kernel
def lead_by_hand(params: ServoParameters, state: ServoState, mail: Any) -> None:
    """Take the reference of joints that a hand leads: within their range, and slower than they are.

    A stream that has none, as of a jog, is left as it is.
    """
    if mail.command.held_stream != state.stream + 1:
        return
    for j in range(state.q.size):
        if state.joint_modes[j] == TORQUE_SETPOINT:
            state.guided = 1
    if state.guided == 0:
        return
    share = slowing(params, state)
    for j in range(state.q.size):
        if state.joint_modes[j] == TORQUE_SETPOINT:
            most = GUIDE_SHARE * params.v_max[j]
            low, high = walls(state, j)
            v = min(max(share * state.v[j], -most), most)
            if state.q_ref[j] < low:
                state.q_ref[j], v = low, max(v, 0.0)
            elif state.q_ref[j] > high:
                state.q_ref[j], v = high, min(v, 0.0)
            state.v_ref[j] = v


@lean_kernel
def note_unled(state: ServoState) -> None:
    """Remember where each joint stands that no hand leads yet: its walls will not be farther in, and move nothing."""
    for j in range(state.q.size):
        if not led(state, j):
            state.led_from[j] = state.q[j]


@lean_kernel
def walls(state: ServoState, j: int) -> tuple[float, float]:
    """Places at which the walls of joint `j` begin, rad or m; the lower one is never beyond the upper one."""
    low, high = state.range_min[j], state.range_max[j]
    wall = min(WALL, WALL_SHARE * (high - low))
    return min(low + wall, state.led_from[j]), max(high - wall, state.led_from[j])


@lean_kernel
def slowing(params: ServoParameters, state: ServoState) -> float:
    """Share of the joints' speeds that is their reference; a tip that is far beyond its limit is a fault."""
    limit = GUIDE_SPEED if params.tool_speed <= 0.0 else min(GUIDE_SPEED, params.tool_speed)
    tip = (params.tip[0], params.tip[1], params.tip[2])
    speed = tip_speed(state.q, state.v, params.dynamics.chain, tip)
    report_fault(state, check_tip_speed(speed, TOO_FAST * limit), NO_JOINT, speed, TOO_FAST * limit)
    kept = min(1.0, limit / max(speed, 1e-9))
    return float((1.0 - DAMPING) * kept - BRAKING * (1.0 - kept))


@lean_kernel
def led(state: ServoState, j: int) -> bool:
    """A hand leads joint `j`."""
    return bool(state.guided != 0 and state.joint_modes[j] == TORQUE_SETPOINT)
