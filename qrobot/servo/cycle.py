"""One servo cycle, from register image to register writes.

    read -> estimate -> watch -> obey -> refer -> law -> guard -> write -> tell

`cycle` is pure: it works on the arrays it is given, with the time as an argument, and every path ends in a list of
register writes that carries either the guarded torque of the law or zero torque. The loops that own a clock
(`servo.loop`, the lock-step rig) and the tests all call this one function.
"""

from __future__ import annotations

import math
from typing import Any, Final

from qrobot.faultcodes import FaultCode
from qrobot.hwif.memory import IMAGE_COUNT, IMAGE_INPUTS, put_write
from qrobot.hwif.registers import (
    DAC,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_HAND_CLOSE,
    DISCRETE_HAND_OPEN,
    DISCRETE_HAND_RELAXED,
    DISCRETE_POWER,
    ENC_COUNT,
    N_DACS,
    STATUS_CALIBRATED,
    STATUS_ESTOP_OK,
    STATUS_INPUTS,
    STATUS_POWER,
)
from qrobot.hwif.registers import STATUS as STATUS_REGISTER
from qrobot.model.dynamics import friction_torque, gravity_torque
from qrobot.model.transmission import (
    TransmissionParams,
    counts_to_joint,
    motor_to_torque,
    signed_word,
    torque_to_dac,
    unwrap_counts,
)
from qrobot.realtime.jit import lean_kernel
from qrobot.realtime.record import float_bits
from qrobot.servo.guard import (
    check_following,
    check_image,
    check_range,
    check_velocity,
    limit_torque,
)
from qrobot.servo.interpolator import reference, shift_extrapolated, stop_profile
from qrobot.servo.law import KP, KV
from qrobot.servo.mailbox import (
    BEAT_ARMED,
    BEAT_DISCRETE,
    BEAT_T_NS,
    COMMAND_HAND,
    FLAG_AT_REST,
    FLAG_CALIBRATED,
    FLAG_ESTOP_OK,
    FLAG_GUARDED,
    FLAG_POWERED,
    GUARD_TAKEOVER,
    STATE_EVENT,
    STATE_FAULT,
    STATE_FLAGS,
    STATE_HAND,
    STATE_INPUTS,
    STATE_JOINT,
    STATE_LATE,
    STATE_MISSED,
    STATE_MODE,
    STATE_SEQ,
    STATE_T_NS,
    STATE_TICK,
    STATE_VECTORS,
    TORQUE_SETPOINT,
    publish_state,
)
from qrobot.servo.modes import Mode, gives_torque, wants_power
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import (
    ADOPT,
    ADOPT_BOARD,
    ADOPT_JUMPED,
    ADOPT_NOTHING,
    BUSY_NS,
    CLIPPED,
    DISCRETE_SENT,
    DISCRETE_WORD,
    DT,
    EVENT,
    FAULT,
    FLAGS,
    GLITCHES,
    IMAGE_OK,
    IMAGE_SEEN,
    JOINT,
    LAST_NOW_NS,
    LATE,
    LAW_FAILED,
    MISSED,
    MISSES,
    MODE,
    NEXT_SEQ,
    PHASE,
    RATE,
    RATE_AT_STOP,
    RATE_SLOPE,
    READ_NS,
    STARTED,
    STATUS,
    STOP_SECONDS,
    STOP_SINCE_NS,
    TICK,
    UNCHANGED,
    ServoState,
)
from qrobot.servo.stream import advance_phase, frame_is_over, take_frame
from qrobot.servo.supervisor import (
    finish_stop,
    guardian_alive,
    hold_here,
    obey_requests,
    raise_code,
    react,
    watch_surroundings,
)

TRACKING: Final = int(Mode.TRACKING)
STOPPING: Final = int(Mode.STOPPING)
UNCALIBRATED: Final = int(Mode.UNCALIBRATED)
ENC_JUMP: Final = int(FaultCode.ENC_JUMP)
LAW_NAN: Final = int(FaultCode.LAW_NAN)
GLITCHES_TO_FAULT: Final = 3


@lean_kernel
def cycle(params: ServoParameters, state: ServoState, mail: Any, now_ns: int, late_ns: int, law: Any) -> int:
    """Run one cycle on `state.image` and leave the register writes in `state.ops`.

    Args:
        params: numbers of robot and servo. state: everything remembered; `state.image` holds the newest image of the
            board, `IMAGE_OK` whether it was whole. mail: servo memory, see `servo.mailbox`. now_ns: planned time of
            this cycle. late_ns: how much later it really runs. law: pointer to the control law, a `servo.law.Law`.

    Returns:
        Number of operations in `state.ops`, to be posted in order; zero when the guardian holds the board.
    """
    tick(params, state, now_ns, late_ns)
    read(params, state)
    estimate(params, state)
    watch_surroundings(params, state, mail, now_ns)
    watch_arm(params, state)
    obey_requests(params, state, mail, now_ns)
    refer(params, state, mail, now_ns)
    react(params, state, mail, now_ns)
    drive(params, state, law)
    react(params, state, mail, now_ns)
    n_ops = write(params, state, mail)
    tell(params, state, mail, now_ns, late_ns)
    return n_ops


@lean_kernel
def tick(params: ServoParameters, state: ServoState, now_ns: int, late_ns: int) -> None:
    """Count the cycle and take its true duration, a whole number of periods."""
    if state.i[STARTED] == 0:
        state.i[LAST_NOW_NS] = now_ns - params.period_ns
    state.f[DT] = (now_ns - state.i[LAST_NOW_NS]) * 1e-9
    state.i[LAST_NOW_NS] = now_ns
    state.i[TICK] += 1
    if late_ns > params.late_ns:
        state.i[LATE] += 1


@lean_kernel
def read(params: ServoParameters, state: ServoState) -> None:
    """Judge the image; unwrap the encoder words, holding back what no joint can have moved."""
    whole = state.i[IMAGE_OK] != 0
    fresh = whole and state.image[IMAGE_COUNT] != state.i[IMAGE_SEEN]
    state.i[UNCHANGED] = 0 if fresh else state.i[UNCHANGED] + 1
    if whole:
        state.i[IMAGE_SEEN] = state.image[IMAGE_COUNT]
        state.i[STATUS] = state.image[IMAGE_INPUTS + STATUS_REGISTER // 2]
    code = check_image(state.i[UNCHANGED], params.unchanged_images, state.i[IMAGE_SEEN], state.i[STATUS])
    state.i[IMAGE_OK] = 1 if code == 0 else 0
    if state.i[IMAGE_OK] == 0 and not wants_power(state.i[MODE]):
        state.i[ADOPT] = ADOPT_BOARD  # it may come back as another one
    if fresh and state.i[IMAGE_OK] != 0:
        read_encoders(params, state)


@lean_kernel
def read_encoders(params: ServoParameters, state: ServoState) -> None:
    """Counts from the encoder words of a good image."""
    first = IMAGE_INPUTS + ENC_COUNT // 2
    words = state.image[first : first + state.raw.size]
    if state.i[ADOPT] != ADOPT_NOTHING:
        adopt(params, state, words)
    periods = max(1, (state.i[LAST_NOW_NS] - state.i[READ_NS] + params.period_ns // 2) // params.period_ns)
    state.i[READ_NS] = state.i[LAST_NOW_NS]
    for j in range(state.raw.size):
        state.jump[j] = params.jump_counts[j] * periods
    joint = unwrap_counts(words, state.raw, state.counts, state.jump)
    if joint < 0:
        state.i[GLITCHES] = 0
        return
    state.i[GLITCHES] += 1
    if state.i[GLITCHES] >= GLITCHES_TO_FAULT:
        raise_code(state, ENC_JUMP, joint)


@lean_kernel
def adopt(params: ServoParameters, state: ServoState, words: Any) -> None:
    """First image of a board: take counters and scratch bits as it kept them, and move nothing.

    Counters that jumped are taken too, but are not calibrated any more.
    """
    for j in range(words.size):
        state.raw[j] = words[j]
        state.counts[j] = signed_word(words[j])
    counts_to_joint(state.counts, params.transmission, state.q_before)
    kept = state.i[STATUS] & params.scratch_bits
    if state.i[ADOPT] == ADOPT_JUMPED:
        kept &= ~STATUS_CALIBRATED
    state.i[DISCRETE_WORD] = kept | DISCRETE_HAND_RELAXED
    state.i[DISCRETE_SENT] = -1
    state.i[GLITCHES] = 0
    state.i[ADOPT] = ADOPT_NOTHING
    state.i[STARTED] = 1


@lean_kernel
def estimate(params: ServoParameters, state: ServoState) -> None:
    """Joint positions from counts; velocity by backward difference and first-order low pass."""
    if state.i[STARTED] == 0:
        return
    counts_to_joint(state.counts, params.transmission, state.q)
    dt = state.f[DT]
    share = 1.0 - math.exp(-params.filter_rad_s * dt)
    for j in range(state.q.size):
        state.v[j] += share * ((state.q[j] - state.q_before[j]) / dt - state.v[j])
        state.q_before[j] = state.q[j]


@lean_kernel
def watch_arm(params: ServoParameters, state: ServoState) -> None:
    """Raise what the measured motion calls for while the motors carry torque."""
    if not gives_torque(state.i[MODE]):
        return
    code, joint = check_velocity(state.v, params.v_max, params.velocity_factor)
    raise_code(state, code, joint)
    code, joint = check_following(state.q_ref, state.q, params.following_error)
    raise_code(state, code, joint)
    if state.i[MODE] != UNCALIBRATED:
        code, joint = check_range(state.q, params.q_min, params.q_max, params.range_margin)
        raise_code(state, code, joint)


@lean_kernel
def refer(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> None:
    """Advance the reference along the setpoints, or along the path of a stop; without torque it is where the arm is."""
    mode = state.i[MODE]
    if not gives_torque(mode):
        hold_here(state)  # without torque the reference is wherever the arm is
    elif mode == TRACKING:
        advance_phase(state)
        while frame_is_over(state):
            code, joint = take_frame(params, state, mail, now_ns)
            raise_code(state, code, joint)
        reference(state.knots, state.f[PHASE], state.f[RATE], 0.0, state.q_ref, state.v_ref, state.a_ref)
        follow_torque_joints(state)
    elif mode == STOPPING:
        left, slope = stop_profile((now_ns - state.i[STOP_SINCE_NS]) * 1e-9, state.f[STOP_SECONDS])
        state.f[RATE] = left * state.f[RATE_AT_STOP]
        state.f[RATE_SLOPE] = slope * state.f[RATE_AT_STOP]
        advance_phase(state)
        while frame_is_over(state):
            shift_extrapolated(state.knots)
        reference(
            state.knots, state.f[PHASE], state.f[RATE], state.f[RATE_SLOPE], state.q_ref, state.v_ref, state.a_ref
        )
        if left == 0.0:
            finish_stop(state)
    elif not gives_torque(mode):
        hold_here(state)


@lean_kernel
def follow_torque_joints(state: ServoState) -> None:
    """The reference of a torque-driven joint is where it is, so its feedback vanishes and only compensation is left."""
    for j in range(state.q.size):
        if state.joint_modes[j] == TORQUE_SETPOINT:
            state.q_ref[j], state.v_ref[j], state.a_ref[j] = state.q[j], state.v[j], 0.0


@lean_kernel
def drive(params: ServoParameters, state: ServoState, law: Any) -> None:
    """Torque of the law, guarded, in modes that give any."""
    state.i[CLIPPED] = 0
    if not gives_torque(state.i[MODE]):
        return
    model_terms(params, state)
    if state.i[LAW_FAILED] != 0:
        built_in_law(params, state)
    else:
        law(  # [:]: the pointer takes plain arrays, not fields of a record
            state.q_ref[:], state.v_ref[:], state.a_ref[:], state.q[:], state.v[:], state.gravity[:],
            state.friction[:], state.sensors[:], params.gains[:], state.memory[:], state.tau[:],
        )  # fmt: skip
    add_torque_setpoints(state)
    code, joint, clipped = limit_torque(state.tau, params.tau_max)
    if code == LAW_NAN:
        state.i[LAW_FAILED] = 1
        raise_code(state, code, joint)
        built_in_law(params, state)
        code, joint, clipped = limit_torque(state.tau, params.tau_max)
    state.i[CLIPPED] = clipped


@lean_kernel
def model_terms(params: ServoParameters, state: ServoState) -> None:
    """Gravity at the measured pose on the compensated joints, friction at the reference velocity."""
    if state.i[MODE] == UNCALIBRATED:  # the pose is not known: no model can help
        for j in range(state.q.size):
            state.gravity[j], state.friction[j] = 0.0, 0.0
        return
    gravity_torque(state.q, params.dynamics, state.gravity)
    for j in range(state.q.size):
        state.gravity[j] *= params.gravity_share[j]
    motor_rates(state.v_ref, params.transmission, state.scratch)
    friction_torque(state.scratch, params.friction, state.tau_motor)
    motor_to_torque(state.tau_motor, params.transmission, state.friction)


@lean_kernel
def motor_rates(v: Any, transmission: TransmissionParams, r_dot: Any) -> None:
    """Motor speeds C v in joint units: friction acts where the motors are, not where the joints are. Shapes (n,)."""
    for i in range(v.size):
        speed = 0.0
        for j in range(v.size):
            speed += transmission.motor_per_joint[i, j] * v[j]
        r_dot[i] = speed


@lean_kernel
def built_in_law(params: ServoParameters, state: ServoState) -> None:
    """What replaces a law that failed: PD with gravity compensation."""
    for j in range(state.tau.size):
        feedback = params.gains[KP, j] * (state.q_ref[j] - state.q[j]) + params.gains[KV, j] * (
            state.v_ref[j] - state.v[j]
        )
        state.tau[j] = feedback + state.gravity[j]


@lean_kernel
def add_torque_setpoints(state: ServoState) -> None:
    """Joints in torque mode: the setpoint comes on top of what carries the arm."""
    for j in range(state.tau.size):
        state.tau[j] += state.torque_setpoint[j]


@lean_kernel
def write(params: ServoParameters, state: ServoState, mail: Any) -> int:
    """Register writes of this cycle: every DAC, and DISCRETE when it changes; none when the guardian has the board."""
    if not gives_torque(state.i[MODE]):  # a fault may have come up after the law had run
        state.tau[:] = 0.0
    torque_to_dac(state.tau, params.transmission, state.tau_motor, state.dac)
    compose_discrete(state, mail[COMMAND_HAND])
    mail[BEAT_ARMED] = 1 if wants_power(state.i[MODE]) else 0
    if state.i[STARTED] == 0:
        return 0
    mail[BEAT_DISCRETE] = state.i[DISCRETE_WORD]
    if mail[GUARD_TAKEOVER] != 0:
        state.i[DISCRETE_SENT] = -1
        return 0
    n = 0
    if state.i[DISCRETE_WORD] != state.i[DISCRETE_SENT] and not wants_power(state.i[MODE]):
        n = put_write(state.ops, n, DISCRETE, state.i[DISCRETE_WORD])  # power goes before the torque does
    for channel in range(N_DACS):
        code = state.dac[channel] if channel < state.dac.size else DAC_ZERO
        n = put_write(state.ops, n, DAC + 2 * channel, code)
    if state.i[DISCRETE_WORD] != state.i[DISCRETE_SENT] and wants_power(state.i[MODE]):
        n = put_write(state.ops, n, DISCRETE, state.i[DISCRETE_WORD])  # power comes after the torque is set
    state.i[DISCRETE_SENT] = state.i[DISCRETE_WORD]
    return n


@lean_kernel
def compose_discrete(state: ServoState, hand: int) -> None:
    """DISCRETE from mode and hand request; scratch bits stay as they are. Hand solenoids are active low."""
    word = state.i[DISCRETE_WORD] & ~(DISCRETE_POWER | DISCRETE_HAND_RELAXED)
    if wants_power(state.i[MODE]):
        word |= DISCRETE_POWER
    if hand == 1:
        word |= DISCRETE_HAND_CLOSE
    elif hand == 2:
        word |= DISCRETE_HAND_OPEN
    else:
        word |= DISCRETE_HAND_RELAXED
    state.i[DISCRETE_WORD] = word


@lean_kernel
def compose_flags(params: ServoParameters, state: ServoState, mail: Any, now_ns: int) -> int:
    """FLAG_* of this tick."""
    status, flags = state.i[STATUS], 0
    if state.i[IMAGE_OK] != 0 and status & STATUS_POWER != 0:
        flags |= FLAG_POWERED
    if status & STATUS_CALIBRATED != 0:
        flags |= FLAG_CALIBRATED
    if status & STATUS_ESTOP_OK != 0:
        flags |= FLAG_ESTOP_OK
    if guardian_alive(params, mail, now_ns):
        flags |= FLAG_GUARDED
    at_rest = True
    for j in range(state.v_ref.size):
        at_rest = at_rest and state.v_ref[j] == 0.0
    return flags | FLAG_AT_REST if at_rest else flags


@lean_kernel
def tell(params: ServoParameters, state: ServoState, mail: Any, now_ns: int, late_ns: int) -> None:
    """Publish heartbeat and state; fill the telemetry row (the loop appends it)."""
    n = state.q.size
    state.i[FLAGS] = compose_flags(params, state, mail, now_ns)
    block = state.block
    block[STATE_T_NS], block[STATE_TICK] = now_ns, state.i[TICK]
    block[STATE_MODE], block[STATE_FAULT] = state.i[MODE], state.i[FAULT]
    block[STATE_EVENT], block[STATE_JOINT] = state.i[EVENT], state.i[JOINT]
    block[STATE_FLAGS], block[STATE_SEQ] = state.i[FLAGS], state.i[NEXT_SEQ] - 1
    block[STATE_MISSED], block[STATE_LATE] = state.i[MISSED], state.i[LATE]
    block[STATE_INPUTS], block[STATE_HAND] = state.i[STATUS] & STATUS_INPUTS, mail[COMMAND_HAND]
    for j in range(n):
        block[STATE_VECTORS + j] = float_bits(state.q[j])
        block[STATE_VECTORS + n + j] = float_bits(state.v[j])
        block[STATE_VECTORS + 2 * n + j] = float_bits(state.tau[j])
        block[STATE_VECTORS + 3 * n + j] = float_bits(state.q_ref[j])
    publish_state(mail, n, block)
    mail[BEAT_T_NS] = now_ns
    fill_row(state, now_ns, late_ns)


@lean_kernel
def fill_row(state: ServoState, now_ns: int, late_ns: int) -> None:
    """The telemetry row, in the order of `servo.telemetry`."""
    row, n = state.row, state.q.size
    row[0], row[1], row[2], row[3] = state.i[TICK], now_ns, late_ns, state.i[BUSY_NS]
    row[4], row[5] = state.i[MODE], state.i[EVENT]
    row[6], row[7] = state.i[NEXT_SEQ] - 1, state.i[FLAGS] | state.i[CLIPPED] << 8 | state.i[MISSES] << 16
    for j in range(n):
        row[8 + j] = float_bits(state.q_ref[j])
        row[8 + n + j] = float_bits(state.v_ref[j])
        row[8 + 2 * n + j] = float_bits(state.a_ref[j])
        row[8 + 3 * n + j] = float_bits(state.q[j])
        row[8 + 4 * n + j] = float_bits(state.v[j])
        row[8 + 5 * n + j] = float_bits(state.tau[j])
        row[8 + 6 * n + j] = state.counts[j]
        row[8 + 7 * n + j] = state.dac[j]
