"""Monitors of timing, motors, brakes, modules: they gather what `timing_checks` and `motor_fault_diagnosis` judge."""

from __future__ import annotations

import math
from typing import Final

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.hwif.registers import STATUS_POWER
from qrobot.modecodes import Mode
from qrobot.model.dynamics import inverse_dynamics
from qrobot.model.transmission import motor_rates, torque_to_motor
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.checks.dead_encoder import WRONG_INERTIA, lasting
from qrobot.servo.checks.encoder_monitor import SCALE_SHARE, forget_encoder, held_by, watch_encoder
from qrobot.servo.checks.momentum_observer import STALE, observe_push
from qrobot.servo.checks.motor_fault_diagnosis import (
    check_parked,
    check_push,
    check_saturation,
    counts_along,
    power_given,
    recent_work,
    stopped_dead,
)
from qrobot.servo.checks.potentiometer_monitor import joint_stands, pot_is_watching
from qrobot.servo.checks.timing_checks import check_overrun, check_slowness, grown_row, skipped_points
from qrobot.servo.event import report_event, report_fault, report_warning
from qrobot.servo.kernels.velocity import Estimator
from qrobot.servo.memory.stop_record import note_incident
from qrobot.servo.modes import gives_torque, gives_way, wants_power
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import (
    ServoState,
)

DIFFERENCE: Final = int(Estimator.DIFFERENCE)
HOLDING: Final = int(Mode.HOLDING)
TRACKING: Final = int(Mode.TRACKING)
STOPPING: Final = int(Mode.STOPPING)
ENC_STUCK: Final = int(FaultCode.ENC_STUCK)
COLLISION: Final = int(FaultCode.COLLISION)
IO_LOST: Final = int(FaultCode.IO_LOST)
RUNAWAY: Final = int(FaultCode.RUNAWAY)

COUPLING_SHARE: Final = 1.0  # C [A]; 2.5 kg in a PUMA's hand bring M_23 from 0.2 of the bound to 0.7
OVERTAXED_SHARE: Final = 0.7  # of its following error that a joint with all its torque may fall behind [A]
OVERTAXED_S: Final = 0.005  # with all its torque, as far behind [A]
COMPLIANT_PUSH: Final = 0.7  # of tau_max [A], as where a robot file has no threshold of its own
COMPLIANT_SPEED: Final = 8.0  # times the margin of a runaway: an arm that gives way may be pushed that fast [A]
VERY_LATE_S: Final = 0.02  # a cycle: below it no push has been named wrongly in the campaign `held_up` [A]
SETTLE_S: Final = 0.25  # seen without power: brakes close, the arm comes to rest
NEVER_S: Final = -math.inf  # it has been told of, and is not looked for again before power is wanted anew


@lean_kernel
def watch_timing(params: ServoParameters, state: ServoState, dt_ns: int, late: bool) -> None:
    """Count this cycle's lateness and the last one's length; raise what goes too far while the motors carry torque."""
    watch, limits = state.watch, params.watch
    if not gives_torque(state.mode):  # neither starting up nor waiting has deadlines
        watch.late_row, watch.points, watch.misses_seen = 0, 0, 0
        watch.slow_row, watch.heavy_row = 0, 0
        return
    skipped = skipped_points(dt_ns, params.period_ns)
    missed = skipped + (1 if late else 0)
    in_a_row = 2 if late and state.skipped_ns > 0 else 1  # the late one, and those it was too late for
    watch.late_row = watch.late_row + in_a_row if missed > 0 else 0
    watch.points += 1 + skipped
    watch.misses_seen += missed
    code = check_overrun(watch.late_row, limits.misses_in_a_row, watch.misses_seen, limits.misses_allowed)
    report_fault(state, code, NO_JOINT, watch.misses_seen, limits.misses_allowed)
    if watch.points >= limits.window_points:
        watch.points, watch.misses_seen = 0, 0
    _watch_length(params, state)


@lean_kernel
def _watch_length(params: ServoParameters, state: ServoState) -> None:
    """A cycle that takes longer than its period goes on with the built-in law, and stops the arm."""
    watch, busy_ns = state.watch, state.busy_ns
    watch.slow_row = grown_row(watch.slow_row, busy_ns, params.period_ns)
    watch.heavy_row = grown_row(watch.heavy_row, busy_ns, params.period_ns // 2)
    code = check_slowness(watch.slow_row)
    if code != 0:
        state.law_failed = 1
        report_fault(state, code, NO_JOINT, busy_ns * 1e-9, params.period_ns * 1e-9)
        return
    code = check_slowness(watch.heavy_row)
    if code != 0:
        report_warning(state, code)
        watch.heavy_row = 0


@lean_kernel
def watch_modules(state: ServoState) -> None:
    """A remote module that is lost while the arm is held or moves is told of: what hangs on its inputs may matter."""
    watch, losses = state.watch, state.module_losses
    if losses > watch.losses_told and state.mode in (HOLDING, TRACKING, STOPPING):
        report_warning(state, IO_LOST)
        if state.event != IO_LOST:
            return  # it is told when what stands there now has gone
    watch.losses_told = losses


@lean_kernel
def unseen_s(params: ServoParameters, state: ServoState) -> float:
    """Time for which nothing was seen of the joints: the board is silent, or was until now, or the loop was."""
    images = state.unchanged
    silent = images * params.period_ns * 1e-9 if images > 0 else state.watch.sample_s
    return float(max(silent, state.dt))


@lean_kernel
def watch_motors(params: ServoParameters, state: ServoState) -> None:
    """Follow the torque nobody commanded, and raise what it shows while the pose is known and the motors are driven."""
    mode = state.mode
    if mode not in (HOLDING, TRACKING, STOPPING):
        for j in range(state.q.size):
            _forget_motor(params, state, j)
            _forget_plans(state, j)
            forget_encoder(state, j)
            if not gives_torque(mode):
                state.watch.counts_on[j] = state.counts[j]
            state.watch.along[j] = 0
        state.watch.work = 0.0
        return
    stale = unseen_s(params, state) * params.watch.pace > STALE
    set_thresholds(params, state)
    motor_demand(params, state)
    inertial_torques(params, state)
    planned_torques(params, state)
    observe_motors(params, state, stale)
    if stale:
        return
    for j in range(state.q.size):
        _watch_motor(params, state, j)
        watch_encoder(params, state, j)


@lean_kernel
def set_thresholds(params: ServoParameters, state: ServoState) -> None:
    """Bound of the torque that nobody commanded: the robot file's, less if asked, more for an arm that gives way."""
    compliant = gives_way(state)
    for j in range(state.q.size):
        usual, asked = params.watch.unexplained[j], state.watch.asked[j]
        if compliant:
            usual = max(usual, COMPLIANT_PUSH * params.tau_max[j])
        elif asked > 0.0 and params.position_drives == 0:
            usual = min(usual, asked)
        state.watch.threshold[j] = usual


@lean_kernel
def observe_motors(params: ServoParameters, state: ServoState, stale: bool) -> None:
    """The torque on every joint that nobody commanded, and what all of them together have done to the arm of late."""
    watch, power = state.watch, 0.0
    share = 1.0 - math.exp(-params.filter_rad_s * state.dt) if params.estimator == DIFFERENCE else 1.0
    for j in range(state.q.size):
        drive = state.tau[j] - watch.load[j] - state.friction[j]
        watch.drive[j] += share * (drive - watch.drive[j])  # as late as the velocity it is compared with
        if stale:
            _forget_motor(params, state, j)
        else:
            _observe_motor(params, state, j)
        power += power_given(watch.push[j], state.v[j], watch.threshold[j])
    watch.work = recent_work(watch.work, power, state.dt)


@lean_kernel
def motor_demand(params: ServoParameters, state: ServoState) -> None:
    """Compute what moves the motors: torque beyond the load into `tau_motor`, speed of the reference into `scratch`."""
    for j in range(state.q.size):
        state.scratch[j] = state.tau[j] - state.watch.load[j]
    torque_to_motor(state.scratch, params.transmission, state.tau_motor)
    motor_rates(state.v_ref, params.transmission, state.scratch)


@lean_kernel
def inertial_torques(params: ServoParameters, state: ServoState) -> None:
    """Compute how far the references have gone, how hard they bend, and what the joints may put on each other by it."""
    watch, roots, dt, total, jolts = state.watch, params.watch.root_inertia, state.dt, 0.0, 0.0
    for j in range(state.q.size):
        jolt = unplanned_bend(params, state, j)
        watch.jolt[j] = lasting(watch.jolt[j], jolt, dt)
        late = max(jolt, catching_up(params, state, j, params.period_ns * 1e-9), slowing_down(params, state, j))
        watch.late[j] = lasting(watch.late[j], late, dt)
        watch.bend[j] = lasting(watch.bend[j], max(abs(state.a_ref[j]), late), dt)
        total, jolts = total + roots[j] * watch.bend[j], jolts + roots[j] * watch.jolt[j]
        watch.swept += dt * abs(state.v_ref[j])
        watch.v_ref_before[j] = state.v_ref[j]
    for j in range(state.q.size):
        root, own = roots[j], roots[j] * watch.jolt[j]
        watch.inertial[j] = COUPLING_SHARE * root * (total - root * watch.bend[j])
        watch.allowed[j] = root * ((WRONG_INERTIA - 1.0) * own + COUPLING_SHARE * (jolts - own))


@lean_kernel
def planned_torques(params: ServoParameters, state: ServoState) -> None:
    """Allow for what a program's accelerations make of an unknown load in the hand and of torques that are off scale.

    The load is the heaviest that the arm may carry, at the flange; what it weighs at rest is in the threshold.
    """
    watch, dt = state.watch, state.dt
    inverse_dynamics(state.q, state.v_ref, state.a_ref, params.watch.heaviest, state.work, watch.carried)
    for j in range(state.q.size):
        own = SCALE_SHARE * params.inertia[j] * abs(state.a_ref[j])
        planned = abs(watch.carried[j]) + own if state.mode == TRACKING else 0.0
        watch.planned[j] = lasting(watch.planned[j], planned, dt)


@lean_kernel
def unplanned_bend(params: ServoParameters, state: ServoState, j: int) -> float:
    """Acceleration that no program plans: of a stop, and what a step or jump of the reference asks for.

    The threshold of unexplained torque lies above what a wrong model and an unknown load make of the transitions of
    programs. A stop brakes harder. In a cycle that comes very late the reference has gone on without its joint, which
    the torque makes up for with Kp; where the velocity jumps at setpoints the torque follows with Kv.
    """
    limits, planned = params.watch, state.a_ref[j]
    jolt = catching_up(params, state, j, VERY_LATE_S)
    if state.mode == STOPPING:
        jolt = max(jolt, abs(planned))
    if limits.jumps == 0:
        return jolt
    jump = abs(state.v_ref[j] - state.watch.v_ref_before[j] - state.dt * planned)
    return float(max(jolt, min(limits.jolt_per_jump[j] * jump, limits.jolt_max[j])))


@lean_kernel
def catching_up(params: ServoParameters, state: ServoState, j: int, usual_s: float) -> float:
    """Acceleration by which the law makes up for a cycle that took longer than `usual_s`."""
    limits, step = params.watch, abs(state.v_ref[j]) * max(0.0, state.dt - usual_s)
    return float(min(limits.jolt_per_step[j] * step, limits.jolt_max[j]))


@lean_kernel
def slowing_down(params: ServoParameters, state: ServoState, j: int) -> float:
    """Acceleration by which the law takes back, with Kv, the speed that a torque gave, held over a very late cycle."""
    limits, held_s = params.watch, state.dt if state.dt > VERY_LATE_S else 0.0
    gained = abs(state.tau[j] - state.watch.load[j]) * held_s / params.inertia[j]
    return float(min(limits.jolt_per_jump[j] * gained, limits.jolt_max[j]))


@lean_kernel
def momentum(params: ServoParameters, state: ServoState, j: int) -> float:
    """Momentum of joint `j`, N m s (N s): of M0, and of the rotors that other joints turn with it."""
    total = params.inertia[j] * state.v[j]
    for k in range(state.q.size):
        if k != j:
            total += params.dynamics.armature[j, k] * state.v[k]
    return float(total)


@lean_kernel
def _forget_motor(params: ServoParameters, state: ServoState, j: int) -> None:
    """Expect of a joint what it has."""
    watch = state.watch
    watch.expected[j], watch.push[j] = momentum(params, state, j), 0.0
    watch.over_s[j], watch.clipped_s[j] = 0.0, 0.0


@lean_kernel
def _forget_plans(state: ServoState, j: int) -> None:
    """Allow nothing for what the reference has asked of a joint."""
    watch = state.watch
    watch.v_ref_before[j], watch.drive[j] = 0.0, 0.0
    watch.jolt[j], watch.late[j], watch.bend[j], watch.planned[j] = 0.0, 0.0, 0.0, 0.0


@lean_kernel
def _observe_motor(params: ServoParameters, state: ServoState, j: int) -> None:
    """Whether the motor goes along its torque, and what else drives the joint."""
    watch = state.watch
    if state.unseen == 0:
        watch.along[j] = counts_along(watch.along[j], watch.step[j], state.tau_motor[j], params.watch.proof[j])
    watch.expected[j], watch.push[j] = observe_push(
        momentum(params, state, j), watch.drive[j],
        state.dt, params.watch.pace, watch.expected[j], watch.push[j],
    )  # fmt: skip


@lean_kernel
def explained_push(params: ServoParameters, state: ServoState, j: int) -> float:
    """Push of joint `j` that needs no reason, N m (N): a lower threshold that is asked for takes no unknown load in."""
    watch = state.watch
    most = watch.threshold[j] + watch.allowed[j]
    return float(most + watch.planned[j] if watch.threshold[j] >= params.watch.unexplained[j] else most)


@lean_kernel
def _watch_motor(params: ServoParameters, state: ServoState, j: int) -> None:
    watch, limits, dt = state.watch, params.watch, state.dt
    if abs(watch.push[j]) <= explained_push(params, state, j):
        watch.over_s[j] = 0.0
    else:
        watch.over_s[j] += dt
        _name_push(params, state, j)
    still_s, v_moving, unit = watch.still_s[j], watch.v_moving[j], limits.unit_per_count[j]
    if stopped_dead(still_s, v_moving, unit, params.inertia[j], limits.impossible[j], watch.over_s[j]):
        report_fault(state, ENC_STUCK, j, params.inertia[j] * abs(v_moving) / still_s, limits.impossible[j])
    watch.clipped_s[j] = watch.clipped_s[j] + dt if abs(state.tau[j]) >= params.tau_max[j] else 0.0
    longest_s = OVERTAXED_S if is_overtaxed(params, state, j) else limits.saturation_s
    report_fault(state, check_saturation(watch.clipped_s[j], longest_s), j, watch.clipped_s[j], longest_s)


@lean_kernel
def is_overtaxed(params: ServoParameters, state: ServoState, j: int) -> bool:
    """A program's motion asks for more torque than joint `j` has: it falls behind, and nothing but a load need push it.

    It is to be stopped while it can be held; at its following error its power would be cut.
    """
    if state.mode != TRACKING or state.watch.over_s[j] > 0.0 or gives_way(state):
        return False
    return bool(abs(state.q_ref[j] - state.q[j]) > OVERTAXED_SHARE * params.following_error[j])


@lean_kernel
def _name_push(params: ServoParameters, state: ServoState, j: int) -> None:
    watch, limits = state.watch, params.watch
    push, still_s = watch.push[j], watch.still_s[j]
    share = COMPLIANT_SPEED if gives_way(state) else 1.0
    margin = share * limits.runaway_speed[j] + thrown_speed(state, j)
    most = explained_push(params, state, j)
    code = check_push(
        push, most, watch.over_s[j], watch.drive[j],
        state.v[j], state.v_ref[j], margin,
        still_s, still_s * abs(watch.v_moving[j]) / limits.unit_per_count[j], limits.impossible[j],
        watch.work < 0.0, watch.along[j] >= limits.proof[j],
    )  # fmt: skip
    if code != 0 and abs(push) <= limits.unexplained[j] + watch.allowed[j] + watch.planned[j]:
        code = COLLISION  # only a lower threshold was asked for: nothing more is known to be wrong
    if code == ENC_STUCK and pot_is_watching(state, j):
        if not joint_stands(state, j) or held_by(params, state, j) != 0:
            return  # a matter of the potentiometer, see `watch_encoder`
        code = COLLISION  # something holds it
    if code == RUNAWAY:
        report_fault(state, code, j, abs(state.v[j]), abs(state.v_ref[j]) + margin)
    else:
        report_fault(state, code, j, abs(push), most)


@lean_kernel
def watch_brakes(params: ServoParameters, state: ServoState, now_ns: int) -> None:
    """Tell once of an arm without power that does not stay where its brakes caught it.

    The brakes close once the board shows that power is off, and have caught the arm when it has been seen without for
    `SETTLE_S`: what a servo sleeps through is not seen, and an arm that sags meanwhile has not slipped.
    """
    watch = state.watch
    power_shown = state.image_ok != 0 and state.status & STATUS_POWER != 0
    if wants_power(state.mode) or state.started == 0 or power_shown:
        watch.unpowered_s = 0.0
        return
    if watch.unpowered_s <= SETTLE_S:
        if state.image_ok != 0:
            watch.unpowered_s += min(state.dt, params.period_ns * 1e-9)
        for j in range(state.q.size):
            watch.q_parked[j] = state.q[j]
        return
    code, joint = check_parked(state.q, watch.q_parked, params.watch.braked, params.watch.brake_slip)
    if code == 0:
        return
    report_event(state, code, joint)
    moved = abs(state.q[joint] - watch.q_parked[joint])
    mode = state.mode
    note_incident(
        watch.incident, now_ns, state.tick, code, joint, moved, params.watch.brake_slip[joint],
        mode, mode, state.next_seq - 1,
    )  # fmt: skip
    watch.unpowered_s = NEVER_S


@lean_kernel
def thrown_speed(state: ServoState, j: int) -> float:
    """Speed at which a joint that has given way may be thrown back, rad/s (m/s): that of its path, had it gone on.

    What throws it back faster has more than the arm brought along; what drives it on is no obstacle at all.
    """
    gave_way = state.watch.gave_way[j]
    if state.mode != STOPPING or state.watch.yields == 0 or state.v[j] * gave_way >= 0.0:
        return 0.0
    return float(abs(gave_way) * state.rate / state.rate_at_stop)
