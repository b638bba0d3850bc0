"""One servo cycle, from register image to register writes.

    read, estimate -> check_inputs -> handle_requests -> update_reference -> check_reference -> drive -> write, publish

`cycle` is pure: it works on the arrays it is given, with the time as an argument, and every path ends in a list of
register writes that carries either the guarded torque of the law or zero torque. The loops that own a clock
(`servo.process.loop`, the lock-step rig) and the tests all call this one function.
"""

from __future__ import annotations

from typing import Any, Final

from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel, part_kernel
from qrobot.servo.calibration.procedure import IDLE, calibrate, leave_calibration
from qrobot.servo.checks.fault_monitors import watch_timing
from qrobot.servo.event import report_fault
from qrobot.servo.hold import hold_position
from qrobot.servo.kernels.interpolator import reference, stop_profile, stop_way
from qrobot.servo.memory.setpoint_queue import TORQUE_SETPOINT
from qrobot.servo.modes import gives_torque
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.protection import check_inputs, check_reference
from qrobot.servo.stages.analog_outputs import settle_analog
from qrobot.servo.stages.binary_outputs import asked_outputs, settle_outputs, stop_stands
from qrobot.servo.stages.collision_stop import complies, give_way, take_collision
from qrobot.servo.stages.dropout_hold import hold_through_dropout
from qrobot.servo.stages.guiding import lead_by_hand, note_unled
from qrobot.servo.stages.inputs import estimate, read
from qrobot.servo.stages.mode_machine import apply_faults, finish_stop, handle_requests
from qrobot.servo.stages.override import take_override
from qrobot.servo.stages.payload import carry_payload
from qrobot.servo.stages.publish import publish
from qrobot.servo.stages.setpoint_stream import (
    advance_phase,
    frame_is_over,
    go_on_straight,
    take_frame,
    take_path_time,
)
from qrobot.servo.stages.torque_output import drive, write
from qrobot.servo.state import (
    ServoState,
)

CALIBRATING: Final = int(Mode.CALIBRATING)
TRACKING: Final = int(Mode.TRACKING)
STOPPING: Final = int(Mode.STOPPING)


@lean_kernel
def cycle(params: ServoParameters, state: ServoState, mail: Any, now_ns: int, late_ns: int) -> int:
    """Run one cycle on `state.image` and leave the register writes in `state.ops`.

    Args:
        params: numbers of robot and servo. state: everything remembered; `state.image` holds the newest image of the
            board, `state.image_ok` whether it was whole. mail: servo memory, see `ServoMemory`.
        now_ns: point of the time grid that this cycle is for. late_ns: how much later it really runs, below a period.

    Returns:
        Number of operations in `state.ops`, to be posted in order; zero when the guardian holds the board.
    """
    tick(params, state, now_ns, late_ns)
    read(params, state)
    estimate(params, state)
    check_inputs(params, state, mail, now_ns)
    handle_requests(params, state, mail, now_ns)
    take_override(state, mail)
    take_collision(state, mail)
    carry_payload(params, state, mail)
    update_reference(params, state, mail, now_ns)
    hold_through_dropout(state)
    check_reference(params, state, mail)
    apply_faults(params, state, mail, now_ns)
    drive(params, state)  # the law, and the check of its torque
    apply_faults(params, state, mail, now_ns)
    asked = asked_outputs(params, state, mail)
    stopped = stop_stands(params, state, mail, now_ns)
    settle_outputs(params, state, mail, asked, stopped)
    settle_analog(params, state, mail, stopped)
    n_ops = write(params, state, mail)
    publish(params, state, mail, now_ns, late_ns)
    return n_ops


@lean_kernel
def tick(params: ServoParameters, state: ServoState, now_ns: int, late_ns: int) -> None:
    """Count the cycle and take its true duration, a whole number of periods."""
    if state.started == 0:
        state.t_ns = now_ns - params.period_ns
    dt_ns = now_ns - state.t_ns
    late = late_ns + state.skipped_ns > params.late_ns
    state.dt = dt_ns * 1e-9
    state.t_ns = now_ns
    state.began_ns = now_ns + late_ns
    state.tick += 1
    if late:
        state.late_cycles += 1
    watch_timing(params, state, dt_ns, late)


@part_kernel
def update_reference(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Advance the reference along the setpoints, or along the path of a stop; without torque it is where the arm is."""
    mode = state.mode
    note_unled(state)
    state.guided = 0
    if mode != CALIBRATING and state.cal.stage != IDLE:
        leave_calibration(state)
    if mode == CALIBRATING:
        calibrate(params, state)
    elif not gives_torque(mode):
        hold_position(state)  # without torque the reference is wherever the arm is
    elif mode == TRACKING:
        advance_phase(state, take_path_time(params, state))
        while frame_is_over(state):
            code, joint = take_frame(params, state, mail, now_ns)
            report_fault(state, code, joint)
        follow_path(params, state, 0.0)
        follow_torque_joints(state)
        lead_by_hand(params, state, mail)
    elif mode == STOPPING:
        dt = take_path_time(params, state)
        elapsed = (now_ns - state.stop_since_ns) * 1e-9
        left, slope = stop_profile(elapsed, state.stop_seconds)
        state.rate = left * state.rate_at_stop
        state.rate_slope = slope * state.rate_at_stop
        state.phase += state.rate_at_stop * stop_way(elapsed, dt, state.stop_seconds)
        while frame_is_over(state):
            go_on_straight(params, state)
        follow_path(params, state, state.rate_slope)
        give_way(params, state, left)
        if left == 0.0 and not complies(state, now_ns):
            finish_stop(state)


@lean_kernel
def follow_path(params: ServoParameters, state: ServoState, rate_slope: float) -> None:
    """Take the reference from the path, at the phase and the rate at hand."""
    reference(
        params.form, state.knots, state.rounding, state.phase, state.rate, rate_slope,
        state.q_ref, state.v_ref, state.a_ref,
    )  # fmt: skip


@lean_kernel
def follow_torque_joints(state: ServoState) -> None:
    """The reference of a torque-driven joint is where it is, so its feedback vanishes and only compensation is left."""
    unseen_s = state.dt if state.unseen != 0 else 0.0
    for j in range(state.q.size):
        if state.joint_modes[j] == TORQUE_SETPOINT:
            state.q_ref[j], state.v_ref[j], state.a_ref[j] = state.q[j] + unseen_s * state.v[j], state.v[j], 0.0
