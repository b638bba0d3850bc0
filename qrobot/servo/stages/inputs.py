"""Read and judge the board's image: positions and velocities that can be trusted, or the code that says why not."""

from __future__ import annotations

from typing import Any, Final

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.hwif.image import IMAGE_COUNT, IMAGE_ENC_COUNT, IMAGE_STATUS, IMAGE_T_NS
from qrobot.hwif.registers import (
    DISCRETE_CALIBRATED,
    DISCRETE_HAND_RELAXED,
    DISCRETE_INDEX,
    SCRATCH_BITS,
    STATUS_CALIBRATED,
    STATUS_POWER,
)
from qrobot.modecodes import Mode
from qrobot.model.transmission import (
    counts_to_joint,
    joint_to_counts,
    signed_word,
    unwrap_counts,
)
from qrobot.realtime.jit import lean_kernel, part_kernel
from qrobot.servo.calibration.potentiometers import forget_pots, gather_pot, has_table, watch_pots
from qrobot.servo.calibration.procedure import see_load
from qrobot.servo.calibration.state import Stage
from qrobot.servo.checks.board_clock import clock_is_fast, follow_clock, forget_clock
from qrobot.servo.checks.encoder_monitor import follow_counts
from qrobot.servo.checks.limit_checks import (
    RUNAWAY,
    VELOCITY_CATEGORY_0,
    check_following,
    check_image,
    check_range,
    check_velocity,
)
from qrobot.servo.checks.lost_counts import check_indexes, stop_watching
from qrobot.servo.checks.potentiometer_monitor import follow_pots, hear_pots
from qrobot.servo.event import report_fault
from qrobot.servo.hold import narrow_range
from qrobot.servo.kernels.converter import collect_sample
from qrobot.servo.kernels.velocity import Estimator, difference, observe, start_observer
from qrobot.servo.kernels.wrench import measure_wrench
from qrobot.servo.modes import gives_torque, gives_way, wants_power
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.stages.dropout_hold import lose_sight, see_again
from qrobot.servo.state import (
    ADOPT_BOARD,
    ADOPT_JUMPED,
    ADOPT_NOTHING,
    ServoState,
)

OBSERVER: Final = int(Estimator.OBSERVER)
UNCALIBRATED: Final = int(Mode.UNCALIBRATED)
CALIBRATING: Final = int(Mode.CALIBRATING)
LOADING: Final = int(Stage.LOADING)
NONE: Final = int(FaultCode.NONE)
ENC_JUMP: Final = int(FaultCode.ENC_JUMP)
BOARD_CLOCK: Final = int(FaultCode.BOARD_CLOCK)
GLITCHES_TO_FAULT: Final = 3
TOO_FAST_CYCLES: Final = 2  # in a row: one alone can be the noise of a velocity out of counts [A]
COMPLIANT_REACH: Final = 5.0  # times the following error, for an arm that gives way: it may be pushed so far [A]


@lean_kernel
def note_losses(state: ServoState, losses: int, now_ns: int) -> None:
    """Follow how often the board was lost, as its side says: what is found again has its lines off, the hand relaxed.

    With torque arm power tells of that. Without, a loss shorter than a board may be silent counts as well: as none of
    the present, until an image comes that was asked for after it.
    """
    if losses != state.board_losses:
        if state.board_losses >= 0 and not gives_torque(state.mode):
            state.lost_ns, state.board_away = now_ns, 1
        state.board_losses = losses
    elif state.image_taken_ns > state.lost_ns:
        state.board_away = 0


@lean_kernel
def is_new(params: ServoParameters, state: ServoState) -> bool:
    """True of an image that is new by its count, of the present by our clock, and later by the board's.

    A board that is being adopted may have any clock but one that stands.
    """
    t_ns = state.image[IMAGE_T_NS]
    later = t_ns > state.read_ns or (state.adopt != ADOPT_NOTHING and t_ns != state.read_ns)
    return bool(later and state.image[IMAGE_COUNT] != state.image_seen and state.image_age_ns <= params.image_age_ns)


@part_kernel
def read(params: ServoParameters, state: ServoState) -> None:
    """Judge the image; unwrap the encoder words, holding back what no joint can have moved.

    An image that is new by its count but as old as a board may be silent is none of the present: it counts as missing.
    So does one that is no later than the image before by the board's clock: no time would have passed for its encoders.
    """
    whole = state.image_ok != 0
    fresh = whole and is_new(params, state)
    state.unchanged = 0 if fresh else state.unchanged + 1
    if whole:
        state.image_seen = state.image[IMAGE_COUNT]
        state.status = state.image[IMAGE_STATUS]
    code = check_image(state.unchanged, params.unchanged_images, state.image_seen, state.status)
    state.image_ok = 1 if code == 0 and state.board_away == 0 else 0
    if state.image_ok == 0 and not wants_power(state.mode):
        jumped = state.glitches >= GLITCHES_TO_FAULT or state.adopt == ADOPT_JUMPED
        state.adopt = ADOPT_JUMPED if jumped else ADOPT_BOARD  # it may come back as another one
    if fresh and state.image_ok != 0:
        read_encoders(params, state)
    read_converter(params, state, whole)


@part_kernel
def read_converter(params: ServoParameters, state: ServoState, whole: bool) -> None:
    """Take what the image holds of the converter: sensors, the wrench they tell, and potentiometers."""
    taken_ns, patience = state.image_taken_ns, params.adc_patience
    channel = -1
    if whole:
        channel = collect_sample(state.adc, state.sensors, state.image, taken_ns, state.revision, patience)
    seen = state.image_ok != 0
    measure_wrench(params.wrench.matrix, state.force_zero, state.sensors, state.adc.done, seen, state.force)
    if state.started != 0:
        watch_pots(params, state, channel)
        hear_pots(params, state, channel)
        gather_pot(params, state, channel)
        follow_pots(params, state, channel)


@lean_kernel
def read_encoders(params: ServoParameters, state: ServoState) -> None:
    """Counts from the encoder words of a good image."""
    first = IMAGE_ENC_COUNT
    words = state.image[first : first + state.raw.size]
    if state.adopt != ADOPT_NOTHING:
        adopt(params, state, words)
    if state.cal.stage == LOADING and see_load(params, state, words):
        return
    since_ns = state.image[IMAGE_T_NS] - state.read_ns
    periods = max(1, (since_ns + params.period_ns // 2) // params.period_ns)
    state.read_ns = state.image[IMAGE_T_NS]
    state.sample_dt += since_ns * 1e-9
    follow_clock(state, since_ns)
    if clock_is_fast(state) and gives_torque(state.mode):
        report_fault(state, BOARD_CLOCK)
    expect_counts(params, state)
    for j in range(state.raw.size):
        state.jump[j] = params.jump_counts[j] * periods
    joint = unwrap_counts(words, state.raw, state.counts, state.jump, state.ahead)
    if joint == NO_JOINT:
        state.glitches = 0
        return
    state.glitches += 1
    if state.glitches >= GLITCHES_TO_FAULT:
        report_fault(state, ENC_JUMP, joint)


@lean_kernel
def expect_counts(params: ServoParameters, state: ServoState) -> None:
    """Tell how far ahead of its last good reading each motor is expected: by what its joint was carried on since it was
    held back, else not at all."""
    if state.glitches == 0 or state.unseen == 0:
        for j in range(state.ahead.size):
            state.ahead[j] = 0
        return
    joint_to_counts(state.q, params.transmission, state.ahead)
    for j in range(state.ahead.size):
        state.ahead[j] -= state.counts[j]


@lean_kernel
def adopt(params: ServoParameters, state: ServoState, words: Any) -> None:
    """First image of a board: take counters and scratch bits as it kept them, and move nothing.

    Counters that jumped are taken too, but are not calibrated any more.
    """
    for j in range(words.size):
        state.raw[j] = words[j]
        state.counts[j] = signed_word(words[j])
    counts_to_joint(state.counts, params.transmission, state.q_before)
    start_observer(state.q_before, state.observed, state.v, state.unmodelled)
    kept = state.status & SCRATCH_BITS
    if state.adopt == ADOPT_JUMPED:
        kept &= ~STATUS_CALIBRATED
    state.discrete_word = kept | DISCRETE_HAND_RELAXED
    state.discrete_sent = -1
    state.glitches = 0
    state.read_ns = state.image[IMAGE_T_NS] - params.period_ns
    forget_clock(state)
    state.adopt = ADOPT_NOTHING
    state.watch.unpowered_s = 0.0  # where the arm is parked has to be seen anew
    state.started = 1
    state.adc.busy = 0  # what was asked of the board before may be lost: no answer of this one is to it
    forget_pots(params, state)


@lean_kernel
def estimate(params: ServoParameters, state: ServoState) -> None:
    """Joint positions from counts, and velocities by the estimator chosen.

    The time between two samples is the board's: a board or a servo that stalled and caught up shows no false speed.
    Without a new sample, or with a joint held back, that time goes on counting, and joints under torque are carried on.
    """
    if state.started == 0:
        return
    sampled = state.glitches == 0 and state.sample_dt > 0.0
    if not sampled and gives_torque(state.mode):
        lose_sight(state)
        return
    see_again(state)
    counts_to_joint(state.counts, params.transmission, state.q)
    if not sampled:
        return
    dt, state.sample_dt = state.sample_dt, 0.0
    if params.estimator == OBSERVER:
        model_push(params, state)
        observe(
            state.q, state.q_before, state.scratch, dt, params.observer_rad_s,
            state.observed, state.v, state.unmodelled,
        )  # fmt: skip
    else:
        difference(state.q, state.q_before, dt, params.filter_rad_s, state.v)
    for j in range(state.q.size):
        state.q_before[j] = state.q[j]
    follow_counts(params, state, dt)


@lean_kernel
def model_push(params: ServoParameters, state: ServoState) -> None:
    """Acceleration, into `scratch`, that the last cycle's torque gives each joint beyond its load by the model.

    Off the diagonal of the mass matrix nothing is modelled, and nothing of drives that close their own loop: the
    observer finds it.
    """
    driven = gives_torque(state.mode) and params.position_drives == 0
    for j in range(state.q.size):
        excess = state.tau[j] - state.gravity[j] - state.friction[j]
        state.scratch[j] = excess / params.inertia[j] if driven else 0.0


@lean_kernel
def watch_arm(params: ServoParameters, state: ServoState) -> None:
    """Raise what the measured motion calls for while the motors carry torque."""
    mode = state.mode
    if state.index_watch.armed != 0 and (not gives_torque(mode) or mode in (UNCALIBRATED, CALIBRATING)):
        stop_watching(state)
        state.discrete_word &= ~DISCRETE_INDEX
    if not gives_torque(mode):
        return
    _watch_speed(params, state)
    if state.mode not in (UNCALIBRATED, CALIBRATING):
        narrow_range(params, state)
        code, joint = check_range(state.q, state.range_min, state.range_max, params.range_margin)
        if code != NONE:
            end = state.range_min[joint] if state.q[joint] < state.range_min[joint] else state.range_max[joint]
            report_fault(state, code, joint, state.q[joint], end)
        watch_indexes(params, state)


@lean_kernel
def _watch_speed(params: ServoParameters, state: ServoState) -> None:
    code, joint = check_velocity(state.v, params.v_max, params.velocity_factor)
    state.too_fast = state.too_fast + 1 if code != NONE else 0
    if code == RUNAWAY or state.too_fast >= TOO_FAST_CYCLES:
        factor = VELOCITY_CATEGORY_0 if code == RUNAWAY else params.velocity_factor
        report_fault(state, code, joint, abs(state.v[joint]), factor * params.v_max[joint])


@lean_kernel
def watch_following(params: ServoParameters, state: ServoState) -> None:
    """Raise what is too far from its reference, both of this cycle: after a long one the arm has gone on meanwhile."""
    if not gives_torque(state.mode):
        return
    reach = COMPLIANT_REACH if gives_way(state) else 1.0
    code, joint = check_following(state.q_ref, state.q, params.following_error, reach)
    if code != NONE:
        report_fault(
            state, code, joint, abs(state.q_ref[joint] - state.q[joint]), reach * params.following_error[joint]
        )


@lean_kernel
def watch_indexes(params: ServoParameters, state: ServoState) -> None:
    """Look for lost counts; counters that have some are not calibrated any more.

    Whoever takes power away, as a gateway that has found its board again, closes the masks: no bit tells a pulse then.
    """
    if not has_table(params) or state.image_ok == 0 or state.status & STATUS_POWER == 0:
        return
    state.discrete_word |= DISCRETE_INDEX
    code, joint = check_indexes(params.transmission, params.index_phase, state, state.status)
    report_fault(state, code, joint)
    if code != 0:
        state.discrete_word &= ~DISCRETE_CALIBRATED
