"""Everything the cycle remembers, in preallocated arrays; nothing else survives from one tick to the next.

Single numbers live in two small arrays, `i` (int64) and `f` (float64), under the names below.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from qrobot.faultcodes import NO_JOINT
from qrobot.hwif.board_memory import IMAGE_WORDS, OP_FIELDS
from qrobot.hwif.registers import N_ADCS
from qrobot.model.dynamics import dynamics_work
from qrobot.realtime.flat_record import record_of
from qrobot.servo.calibration.state import CalibrationState, PotState, make_calibration_state, make_pot_state
from qrobot.servo.checks.lost_counts import IndexWatch, make_index_watch
from qrobot.servo.checks.monitor_state import WatchState, make_watch_state
from qrobot.servo.laws.guarded_copies import LawCopies, make_law_copies
from qrobot.servo.laws.law import MEMORY_WORDS, Law
from qrobot.servo.laws.law_swap import SwapState, make_swap_state
from qrobot.servo.memory.mailbox import state_words
from qrobot.servo.memory.setpoint_queue import frame_words
from qrobot.servo.memory.telemetry import TelemetryLayout
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.stages.converter import AdcState, make_adc_state
from qrobot.servo.stages.interpolation_polynomials import N_KNOTS
from qrobot.servo.stages.wrench import N_COMPONENTS

# indexes into `i`
(
    MODE,
    FAULT,  # code that latched the FAULT mode
    EVENT,  # newest code of any kind
    JOINT,  # joint the newest code speaks of, NO_JOINT for none; written with it, see `servo.event`
    TICK,
    STARTED,  # 0 until the first whole image was seen
    LAST_NOW_NS,
    STATUS,  # STATUS register of this tick's image
    IMAGE_OK,
    PENDING,  # worst code raised in this tick
    PENDING_JOINT,
    POWER_LOCKED,  # 1: power was taken away and has not been asked for anew
    OFFS_SEEN,
    POWER_SEEN,  # level of the power request at the last tick
    CLEARS_SEEN,
    STOPS_SEEN,
    POWERING_SINCE_NS,
    CLEAR_UNTIL_NS,
    AFTER_STOP,  # mode that follows STOPPING
    STOP_SINCE_NS,
    STREAM,  # stream being followed
    DEAD_STREAM,  # newest stream that a stop has ended, and all before it
    NEXT_SEQ,
    LAST_ARRIVAL_NS,
    PLAY_AT_NS,  # when a waiting stream starts
    FRAME_NS,  # its sample period
    MISSES,  # frames missed in a row
    MISSED,  # frames missed in all
    LATE,  # late cycles
    GLITCHES,  # encoder jumps held back in a row
    LAW_FAILED,  # 1: the built-in law has replaced the user's
    CLIPPED,  # joints at their torque limit in this tick
    DISCRETE_WORD,  # shadow of the DISCRETE register
    DISCRETE_SENT,  # last one posted, -1 for none
    BUSY_NS,  # computing time of the previous cycle, told by the loop
    FLAGS,
    IMAGE_SEEN,  # count of the newest image
    UNCHANGED,  # cycles in a row that have seen no newer one
    UNSEEN,  # 1: no image says where the joints are, and they are carried on, see `servo.stages.dropout_hold`
    READ_NS,  # when encoder words were last taken from an image
    ADOPT,  # what to take over from the next good image
    REVISION,  # of the board, as it says itself
    MODULE_LOSSES,  # times a remote module beside the board was lost, as its side says
    CALIBRATES_SEEN,
    OUTPUTS,  # in force, output 1 in bit 0
    OUTPUTS_LOCKED,  # switched off by a stop, and not let go of since
    OUTPUTS_SENT,  # last ones posted
    OUTPUT_STOPS_SEEN,
    BRIDGED,  # the knot that stands for a missing frame: 1 the newest, 2 the one before, 0 neither
    BEGAN_NS,  # when this cycle really began
    DRIVEN,  # 1: this cycle's writes drive something: power is wanted, or outputs are on that a stop ends
    ARMED,  # 1: the guardian is to act should the servo fall silent, see `servo.checks.guardian_arming`
    SAFE_HEAD,  # end of the first list of the lane after which nothing is driven, -1 for none
    SAFE_IMAGE,  # count of the image in which that list was seen taken, -1 before
    IMAGE_AGE_NS,  # of the image fetched for this tick, on the clock of the servo
    N_INTEGERS,
) = range(56)

# indexes into `f`
(
    DT,
    SAMPLE_DT,
    PHASE,
    RATE,
    RATE_SLOPE,
    RATE_AT_STOP,
    STOP_SECONDS,
    PENDING_VALUE,  # what was measured when the pending code was raised, and what was allowed
    PENDING_LIMIT,
    N_FLOATS,
) = range(10)

# values of ADOPT
ADOPT_NOTHING, ADOPT_BOARD, ADOPT_JUMPED = range(3)

MAX_OPS: Final = 41


class ServoState(NamedTuple):
    """Mutable arrays of one servo, laid out as one record. Vectors have shape (n,) and SI units."""

    i: Any
    f: Any
    image: Any  # int64[IMAGE_WORDS], as fetched
    raw: Any  # encoder words of the last tick, int64
    counts: Any  # unwrapped, int64
    jump: Any  # counts a joint may have moved since the last good image, int64
    q: Any
    q_before: Any
    v: Any
    v_seen: Any  # `v` of the newest sample, while the joints are carried on
    lag: Any  # of the joints behind their reference when they were last seen, and its rate of change
    lag_rate: Any
    observed: Any  # the observer's position
    unmodelled: Any  # the acceleration it finds that the torques do not explain
    range_min: Any  # range in force: the robot's, or wider where the arm was powered up outside it
    range_max: Any
    q_ref: Any
    v_ref: Any
    a_ref: Any
    work: Any  # of the rigid-body model, see `model.dynamics.dynamics_work`
    gravity: Any
    friction: Any
    tau: Any
    tau_motor: Any
    scratch: Any
    dac: Any  # int64
    knots: Any  # (4, n)
    setpoint: Any
    setpoint_modes: Any  # of the frame being looked at, int64
    joint_modes: Any  # in force, int64
    torque_setpoint: Any
    frame: Any
    wrench: Any  # (6,) force and torque at the wrist, N and N m; NaN where it is not known
    sensors: Any  # (8,) volts at the ADC channels; NaN where the converter does not answer
    adc: AdcState
    index_watch: IndexWatch
    pots: PotState
    cal: CalibrationState
    memory: Any  # (64,), the law's own
    swap: SwapState
    copies: LawCopies
    watch: WatchState
    ops: Any  # (MAX_OPS, 3)
    block: Any  # the state block, floats as bit patterns
    row: Any  # the telemetry row, floats as bit patterns


def make_state(params: ServoParameters, law: Law) -> ServoState:
    """Fresh state: mode OFF, nothing seen yet. `law` has to live as long as the state."""
    n = params.q_min.size

    def vector() -> Any:
        return np.zeros(n)

    def integers() -> Any:
        return np.zeros(n, dtype=np.int64)

    frame = np.zeros(frame_words(n), dtype=np.int64)
    block = np.zeros(state_words(n), dtype=np.int64)
    row = np.zeros(TelemetryLayout(n).row_words, dtype=np.int64)
    numbers = np.zeros(N_INTEGERS, dtype=np.int64)
    numbers[[STREAM, DEAD_STREAM, DISCRETE_SENT, SAFE_HEAD, SAFE_IMAGE]] = -1
    numbers[[JOINT, PENDING_JOINT]] = NO_JOINT
    numbers[ARMED] = 1  # nobody knows yet what a predecessor has left at the board
    numbers[ADOPT] = ADOPT_BOARD
    return record_of(ServoState(
        i=numbers, f=np.zeros(N_FLOATS), image=np.zeros(IMAGE_WORDS, dtype=np.int64), raw=integers(), counts=integers(),
        jump=integers(), range_min=vector(), range_max=vector(),
        q=vector(), q_before=vector(), v=vector(), observed=vector(), unmodelled=vector(),
        v_seen=vector(), lag=vector(), lag_rate=vector(),
        q_ref=vector(), v_ref=vector(), a_ref=vector(), work=dynamics_work(n),
        gravity=vector(), friction=vector(), tau=vector(), tau_motor=vector(), scratch=vector(), dac=integers(),
        knots=np.zeros((N_KNOTS, n)), setpoint=vector(), setpoint_modes=integers(), joint_modes=integers(),
        torque_setpoint=vector(), frame=frame, wrench=np.full(N_COMPONENTS, np.nan),
        sensors=np.zeros(N_ADCS), adc=make_adc_state(),
        index_watch=make_index_watch(), pots=make_pot_state(n), cal=make_calibration_state(n),
        memory=np.zeros(MEMORY_WORDS),
        swap=make_swap_state(law, params.gains), copies=make_law_copies(n),
        ops=np.zeros((MAX_OPS, OP_FIELDS), dtype=np.int64),
        watch=make_watch_state(n), block=block, row=row,
    ))  # fmt: skip
