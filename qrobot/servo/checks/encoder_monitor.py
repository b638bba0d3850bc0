"""The watch over encoders: which of them count, and a joint that must have moved since its encoder last did.

It gathers what `servo.checks.dead_encoder` judges, whose docstring says why.
"""

from __future__ import annotations

from typing import Final

from qrobot.faultcodes import FaultCode
from qrobot.model.transmission import motor_rates
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.checks.dead_encoder import (
    WRONG_INERTIA,
    is_missing,
    predict_travel,
    sliding_torque,
    torque_bounds,
)
from qrobot.servo.checks.motor_fault_diagnosis import counted_speed
from qrobot.servo.checks.potentiometer_monitor import pot_is_watching
from qrobot.servo.event import report_fault
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

ENC_STUCK: Final = int(FaultCode.ENC_STUCK)
BRAKE_STUCK: Final = int(FaultCode.BRAKE_STUCK)

MOVED_COUNTS: Final = 20  # further than a closed brake lets a joint twitch
MISSING_COUNTS: Final = 4.0  # so many the model is sure of, and none came [A]
DRIVEN_COUNTS: Final = 5.0  # the reference has gone on by so many since the last: the motor is driven [A]
GONE_READINGS: Final = 2  # of a potentiometer in a row that show a motor gone
STRAYED_READINGS: Final = 4  # that show it on its way, where the model is sure of missing counts [A]
STANDS_TURNS: Final = 0.5  # the model is sure of so much, and the potentiometer shows none of it
SCALE_SHARE: Final = 0.3  # S [A]: torques a fifth too small, weights 5 % too light


@lean_kernel
def follow_counts(params: ServoParameters, state: ServoState, dt: float) -> None:
    """Note, after a new sample `dt` seconds later, which encoders count, and how fast the motor was when one last did.

    Where motors are coupled, one stands at times while its joint moves.
    """
    watch = state.watch
    watch.sample_s = dt
    motor_rates(state.v, params.transmission, state.scratch)
    for j in range(state.q.size):
        step, before = (state.counts[j] - watch.counts[j]) * params.watch.count_way[j], watch.step[j]
        watch.step[j] = step
        if step != 0:
            watch.travel[j] = watch.travel[j] + step if watch.travel[j] * step > 0 else step
            speed_of_count = params.watch.unit_per_count[j] / dt
            watch.v_moving[j] = counted_speed(state.scratch[j], watch.v_moving[j], step, before, speed_of_count)
            watch.counts[j], watch.still_s[j] = state.counts[j], 0.0
        else:
            watch.still_s[j] += dt


@lean_kernel
def forget_encoder(state: ServoState, j: int) -> None:
    """Forget how joint `j` slides: its watch begins anew from the reference of now."""
    watch = state.watch
    watch.travel[j], watch.slid[j], watch.q_ref_then[j] = 0, 0.0, state.q_ref[j]
    watch.going[j], watch.driven[j], watch.missing_v[j], watch.missing[j] = 0, 0, 0.0, 0.0
    watch.push_least[j], watch.push_most[j] = 0.0, 0.0


@lean_kernel
def watch_encoder(params: ServoParameters, state: ServoState, j: int) -> None:
    """Raise an encoder whose joint must have moved since it last counted."""
    watch, limits, unit = state.watch, params.watch, params.watch.unit_per_count[j]
    torque, way = state.tau_motor[j], state.scratch[j] * watch.travel[j]
    push_least, push_most = min(watch.push_least[j], torque), max(watch.push_most[j], torque)
    watch.push_least[j], watch.push_most[j] = (push_least, push_most) if state.unseen != 0 else (torque, torque)
    if watch.still_s[j] == 0.0:
        if state.unseen == 0:  # the count is of this cycle's image
            slid = push_most if watch.travel[j] > 0 else push_least
            watch.slid[j] = sliding_torque(slid, watch.travel[j], params.inertia[j], watch.bend[j])
        watch.q_ref_then[j], watch.swept_then[j] = state.q_ref[j], watch.swept
        watch.going[j] = 1 if way > 0.0 else 0
        watch.driven[j], watch.missing_v[j], watch.missing[j] = 0, 0.0, 0.0
        return
    if not way > 0.0:
        watch.going[j] = 0
    if state.unseen != 0:
        return
    shifted = limits.unknown_load[j] * (watch.swept - watch.swept_then[j])
    least, greatest = torque_bounds(
        watch.slid[j], watch.travel[j], watch.going[j] != 0,
        limits.holds_up[j], limits.holds_down[j], limits.rise_up[j] + shifted, limits.rise_down[j] + shifted,
        watch.inertial[j] + watch.planned[j] + WRONG_INERTIA * params.inertia[j] * watch.late[j],
        SCALE_SHARE * abs(watch.load[j]),
    )  # fmt: skip
    watch.missing_v[j], watch.missing[j] = predict_travel(
        push_least if torque > 0.0 else push_most,
        least,
        greatest,
        params.inertia[j],
        watch.sample_s,
        watch.missing_v[j],
        watch.missing[j],
    )
    watch.driven[j] = 1 if abs(state.q_ref[j] - watch.q_ref_then[j]) > DRIVEN_COUNTS * unit else watch.driven[j]
    watching = pot_is_watching(state, j)
    counts = STANDS_TURNS * params.transmission.counts_per_rev[j] if watching else MISSING_COUNTS
    strayed = abs(state.pots.strayed[j]) >= STRAYED_READINGS and is_missing(watch.missing[j], MISSING_COUNTS, unit)
    gone = strayed or (watch.driven[j] != 0 and state.pots.gone[j] >= GONE_READINGS)
    if gone or is_missing(watch.missing[j], counts, unit):
        code = held_by(params, state, j) if watching and not gone and state.pots.gone[j] == 0 else ENC_STUCK
        report_fault(state, code, j, abs(torque), greatest if torque > 0.0 else -least)


@lean_kernel
def held_by(params: ServoParameters, state: ServoState, j: int) -> int:
    """Code of a joint that is driven and stands, as encoder and potentiometer agree; 0 for one that something holds.

    How hard a joint may push against what holds it is a matter of the unexplained torque: a peg on the rim of its hole,
    or a tool that is pressed on a surface, is no fault.
    """
    moved = abs(state.counts[j] - state.watch.counts_on[j]) > MOVED_COUNTS
    return 0 if moved or params.watch.braked[j] == 0 else BRAKE_STUCK
