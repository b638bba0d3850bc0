"""Turn the reference into register writes: model, law, limit checks, and the order in which torque and power go out."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from qrobot.faultcodes import FaultCode
from qrobot.hwif.operations import REFERENCE_PER_COUNT, put_reference, put_write
from qrobot.hwif.registers import (
    DAC,
    DISCRETE,
    DISCRETE_ADC,
    DISCRETE_HAND_CLOSE,
    DISCRETE_HAND_OPEN,
    DISCRETE_HAND_RELAXED,
    DISCRETE_POWER,
    N_DACS,
)
from qrobot.modecodes import Mode
from qrobot.model.dynamics import friction_torque, gravity_torque
from qrobot.model.stiction_compensation import lead
from qrobot.model.transmission import (
    joint_to_motor,
    motor_rates,
    motor_to_torque,
    torque_to_dac,
    torque_to_motor,
)
from qrobot.realtime.jit import lean_kernel, part_kernel
from qrobot.servo.calibration.potentiometers import has_table
from qrobot.servo.calibration.procedure import post_latches
from qrobot.servo.checks.guardian_arming import guardian_holds, keep_armed, say_again
from qrobot.servo.checks.limit_checks import limit_torque
from qrobot.servo.checks.lost_counts import post_index_watch
from qrobot.servo.checks.potentiometer_monitor import wanted_channels
from qrobot.servo.event import report_fault
from qrobot.servo.hold import hold_position
from qrobot.servo.kernels.converter import start_sample
from qrobot.servo.laws.guarded_copies import broken_words, copy_vector
from qrobot.servo.laws.law import KP, KV
from qrobot.servo.laws.law_swap import (
    NOT_NOW,
    OUT_OF_BOUNDS,
    SWAPPED,
    answer_swap,
    fade_bias,
    forget_bias,
    install,
    install_after_trial,
    law_at,
    swap_asked,
    take_settings,
)
from qrobot.servo.memory.setpoint_queue import TORQUE_SETPOINT
from qrobot.servo.modes import gives_torque, wants_power
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.stages.analog_outputs import analog_on, free_dac, post_analog
from qrobot.servo.stages.binary_outputs import post_outputs
from qrobot.servo.stages.guiding import FRICTION_SHARE, led
from qrobot.servo.state import (
    ServoState,
)
from qrobot.wire.vocabulary import Hand

OPEN, CLOSED = int(Hand.OPEN), int(Hand.CLOSED)
OFF: Final = int(Mode.OFF)
UNCALIBRATED: Final = int(Mode.UNCALIBRATED)
HOLDING: Final = int(Mode.HOLDING)
TRACKING: Final = int(Mode.TRACKING)
LAW_NAN: Final = int(FaultCode.LAW_NAN)
LAW_BOUNDS: Final = int(FaultCode.LAW_BOUNDS)


@part_kernel
def drive(params: ServoParameters, state: ServoState) -> None:
    """Torque of the law, guarded, in modes that give any."""
    state.clipped = 0
    if gives_torque(state.mode):
        model_terms(params, state)
        law_torque(params, state)
    if swap_asked(state.swap):
        answer_swap(state.swap, swap_law(state), state.tick, state.t_ns)
    if not gives_torque(state.mode):
        return
    add_torque_setpoints(state)
    code, joint, clipped = limit_torque(state.tau, params.tau_max)
    if code == LAW_NAN:
        state.law_failed = 1
        report_fault(state, code, joint)
        built_in_law(params, state)
        code, joint, clipped = limit_torque(state.tau, params.tau_max)
    state.clipped = clipped


@lean_kernel
def law_torque(params: ServoParameters, state: ServoState) -> None:
    """Torque of the law in force, with the bias of the last swap; nothing where the drives close the loop."""
    if params.position_drives != 0:
        state.tau[:] = 0.0
        return
    if state.law_failed != 0 or lost(params, state):
        built_in_law(params, state)
        return
    swap = state.swap
    if not call_law(state, swap.law_at, state.q_ref, swap.gains, swap.settings, state.memory, state.tau):
        state.law_failed = 1
        report_fault(state, LAW_BOUNDS)
        built_in_law(params, state)
        return
    if state.mode == TRACKING:
        fade_bias(state.swap, state.dt)
    for j in range(state.tau.size):
        state.tau[j] += state.swap.bias[j]


@lean_kernel
def call_law(state: ServoState, address: int, q_ref: Any, gains: Any, settings: Any, memory: Any, tau: Any) -> bool:
    """Run the law at `address` on copies of what the servo knows in this cycle; False when it wrote beside them.

    `tau` is filled, with NaN where the law leaves it out, and `memory` goes on. Shapes (n,) and (64,).
    """
    copies = state.copies
    copy_vector(copies.q_ref, q_ref)
    copy_vector(copies.v_ref, state.v_ref)
    copy_vector(copies.a_ref, state.a_ref)
    copy_vector(copies.q, state.q)
    copy_vector(copies.v, state.v)
    copy_vector(copies.gravity, state.gravity)
    copy_vector(copies.friction, state.friction)
    copy_vector(copies.sensors, state.sensors)
    copy_vector(copies.payload, state.payload)
    for k in range(gains.shape[0]):
        for j in range(gains.shape[1]):
            copies.gains[k, j] = gains[k, j]
    copy_vector(copies.settings, settings)
    copy_vector(copies.memory, memory)
    copies.dt[0] = state.dt
    copies.tau[:] = np.nan
    law_at(address)(  # [:]: the pointer takes plain arrays, not fields of a record
        copies.q_ref[:], copies.v_ref[:], copies.a_ref[:], copies.q[:], copies.v[:], copies.gravity[:],
        copies.friction[:], copies.sensors[:], copies.payload[:], copies.gains[:], copies.settings[:],
        copies.memory[:], copies.dt[:], copies.tau[:],
    )  # fmt: skip
    copy_vector(memory, copies.memory)
    copy_vector(tau, copies.tau)
    return bool(broken_words(copies) == 0)


@lean_kernel
def swap_law(state: ServoState) -> int:
    """Do the swap that is asked for, where the mode allows it: unpowered as it is, holding without a bump.

    Other settings of a compliant law are taken in any mode, for it goes over to them by itself, unless it has failed
    meanwhile and another law is in force.

    The arm is then held where it is: what is left of an error must not become a motion under a law that integrates it.
    """
    mode, swap = state.mode, state.swap
    if swap.only_settings != 0:
        return take_settings(swap) if swap.law_at == swap.next_law_at else NOT_NOW
    if mode == OFF:
        return install(swap)
    if mode != HOLDING or state.law_failed != 0:
        return NOT_NOW
    swap.trial_memory[:] = 0.0
    next_law = swap.next_law_at
    if not call_law(state, next_law, state.q, swap.next_gains, swap.next_settings, swap.trial_memory, swap.trial):
        return OUT_OF_BOUNDS
    result = install_after_trial(swap, state.tau, state.memory)
    if result == SWAPPED:
        hold_position(state)
    return result


@lean_kernel
def lost(params: ServoParameters, state: ServoState) -> bool:
    """Not even potentiometers tell where the joints are: no model can help, nor a law that trusts in one."""
    return state.mode == UNCALIBRATED and not has_table(params)


@lean_kernel
def model_terms(params: ServoParameters, state: ServoState) -> None:
    """Gravity at the measured pose on the compensated joints, friction at the reference velocity or of a push."""
    if lost(params, state):
        for j in range(state.q.size):
            state.gravity[j], state.friction[j] = 0.0, 0.0
        return
    gravity_torque(state.q, state.model, state.work, state.gravity)
    for j in range(state.q.size):
        state.watch.load[j] = state.gravity[j]
        state.gravity[j] *= 1.0 if led(state, j) else params.gravity_share[j]
    motor_rates(state.v_ref, params.transmission, state.scratch)
    motor_push(params, state, state.tau_motor)
    lead(state.scratch, state.tau_motor, params.friction)
    friction_torque(state.scratch, params.friction, state.tau_motor)
    motor_to_torque(state.tau_motor, params.transmission, state.friction)
    for j in range(state.q.size):
        state.friction[j] *= FRICTION_SHARE if led(state, j) else 1.0


@lean_kernel
def motor_push(params: ServoParameters, state: ServoState, push: Any) -> None:
    """Motor torques of the torque setpoints beyond what carries the arm; none of joints that follow positions.

    `push` is filled, and `friction` used on the way. Shapes (n,).
    """
    for j in range(push.size):
        uncarried = state.watch.load[j] - state.gravity[j]
        state.friction[j] = state.torque_setpoint[j] - uncarried if state.joint_modes[j] == TORQUE_SETPOINT else 0.0
    torque_to_motor(state.friction, params.transmission, push)


@lean_kernel
def built_in_law(params: ServoParameters, state: ServoState) -> None:
    """Law that replaces one that failed: PD with gravity compensation and the robot file's gains, without a bias."""
    forget_bias(state.swap)
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


@part_kernel
def write(params: ServoParameters, state: ServoState, mail: Any) -> int:
    """Register writes of this cycle: every DAC, and DISCRETE when it changes; none when the guardian has the board."""
    if not gives_torque(state.mode):  # a fault may have come up after the law had run
        state.tau[:] = 0.0
    torque_to_dac(state.tau, params.transmission, state.tau_motor, state.dac)
    channels = wanted_channels(params, state)
    compose_discrete(state, mail.command.hand, channels != 0)
    if state.started == 0:
        return 0
    mail.heartbeat.discrete = state.discrete_word & ~params.outputs.off_discrete
    left_on = state.outputs & params.outputs.off != 0 or analog_on(params, state)  # to be ended should we die
    keep_armed(state, mail, wants_power(state.mode) or left_on)  # before anything is posted
    if guardian_holds(params, state, mail):
        state.discrete_sent = -1
        return 0
    n = 0
    changed = state.discrete_word != state.discrete_sent or say_again(state)
    if changed and not wants_power(state.mode):
        n = put_write(state.ops, n, DISCRETE, state.discrete_word)  # power goes before the torque does
    for channel in range(N_DACS):
        code = state.dac[channel] if channel < state.dac.size else free_dac(params, state, channel)
        n = put_write(state.ops, n, DAC + 2 * channel, code)
    if params.position_drives != 0 and gives_torque(state.mode):
        n = post_reference(params, state, n)
    if changed and wants_power(state.mode):
        n = put_write(state.ops, n, DISCRETE, state.discrete_word)  # power comes after the torque is set
    n = post_outputs(params, state, n)
    n = post_analog(params, state, n)
    n = post_latches(state, n)
    n = post_index_watch(state, n, state.discrete_word)
    if channels != 0:
        n = start_sample(state.adc, state.ops, n, state.discrete_word, channels, state.image_seen, state.revision)
    state.discrete_sent = state.discrete_word
    return n


@lean_kernel
def post_reference(params: ServoParameters, state: ServoState, n: int) -> int:
    """Tell the drives where the motors are to be; returns the number of operations."""
    transmission = params.transmission
    joint_to_motor(state.q_ref, transmission, state.scratch)
    for j in range(state.q_ref.size):
        counts = state.scratch[j] / transmission.rad_per_count[j] + transmission.count_offset[j]
        n = put_reference(state.ops, n, j, math.floor(counts * REFERENCE_PER_COUNT + 0.5))
    return n


@lean_kernel
def compose_discrete(state: ServoState, hand: int, sampling: bool) -> None:
    """DISCRETE from mode and hand request; scratch bits stay as they are. Hand solenoids are active low."""
    word = state.discrete_word & ~(DISCRETE_POWER | DISCRETE_HAND_RELAXED | DISCRETE_ADC)
    if sampling:
        word |= DISCRETE_ADC
    if wants_power(state.mode):
        word |= DISCRETE_POWER
    if hand == OPEN:
        word |= DISCRETE_HAND_CLOSE  # which keeps the other solenoid off
    elif hand == CLOSED:
        word |= DISCRETE_HAND_OPEN
    else:
        word |= DISCRETE_HAND_RELAXED
    state.discrete_word = word
