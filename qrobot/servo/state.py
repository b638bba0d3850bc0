"""Everything the cycle remembers, in preallocated arrays; nothing else survives from one tick to the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from qrobot.config.fences import MOST_OTHER_ARMS
from qrobot.config.outputs import N_OUTPUTS
from qrobot.faultcodes import NO_JOINT
from qrobot.fences.gate import N_VERDICT, OUTSIDE
from qrobot.fences.table import N_ROWS, N_WORK
from qrobot.hwif.image import make_image
from qrobot.hwif.operations import OP_FIELDS
from qrobot.hwif.registers import N_ADCS
from qrobot.model.dynamics import DynamicsParams, dynamics_work
from qrobot.realtime.flat_record import record_of
from qrobot.realtime.structure import local_record
from qrobot.servo.calibration.state import CalibrationState, PotState, make_calibration_state, make_pot_state
from qrobot.servo.checks.lost_counts import IndexWatch, make_index_watch
from qrobot.servo.checks.monitor_state import WatchState, make_watch_state
from qrobot.servo.kernels.converter import AdcState, make_adc_state
from qrobot.servo.kernels.interpolation_polynomials import N_KNOTS
from qrobot.servo.kernels.wrench import N_COMPONENTS
from qrobot.servo.laws.guarded_copies import LawCopies, make_law_copies
from qrobot.servo.laws.law import MEMORY_WORDS, Law
from qrobot.servo.laws.law_swap import SwapState, make_swap_state
from qrobot.servo.memory.setpoint_queue import make_frame
from qrobot.servo.memory.telemetry import N_PAYLOAD, TelemetryLayout
from qrobot.servo.neighbour import N_NEIGHBOUR
from qrobot.servo.parameters import ServoParameters
from qrobot.wire.vocabulary import N_ANALOG_OUTPUTS, N_SIGNALS

# values of ADOPT
ADOPT_NOTHING, ADOPT_BOARD, ADOPT_JUMPED = range(3)

MAX_OPS: Final = 49


@dataclass(eq=False)
class ServoState:
    """Mutable arrays of one servo, laid out as one record. Vectors have shape (n,) and SI units."""

    image: Any  # int64[IMAGE_WORDS], as fetched
    raw: Any  # encoder words of the last tick, int64
    counts: Any  # unwrapped, int64
    jump: Any  # counts a motor may be from where it is expected, int64
    ahead: Any  # where that is, in counts from its last good reading, int64
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
    rounding: Any  # (2, n) how far beside knots 1 and 2 the reference passes, see `servo.kernels.rounding`
    aside: Any  # how far beside its place the newest setpoint was taken, see `servo.kernels.lead_back`
    setpoint: Any
    setpoint_modes: Any  # of the frame being looked at, int64
    joint_modes: Any  # in force, int64
    led_from: Any  # where each joint stood before a hand led it
    torque_setpoint: Any
    frame: Any  # a `servo.memory.setpoint_queue.QueuedFrame`
    force: Any  # (6,) force and torque at the wrist, N and N m; NaN where it is not known
    force_zero: Any  # (8,) volts that the force sensor's channels show without a load
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
    signals: Any  # (8,) numbers that the law tells
    program_signals: Any  # (8,) numbers that the program tells, NaN for none
    fence_work: Any  # of `fences.gate`, as the next three
    fence_rows: Any
    fence_place: Any
    fence_verdict: Any
    neighbour: Any  # (4, 6), a row for each other arm: `servo.neighbour`
    payload: Any  # (10,) in force: mass, first moments, inertia in the last frame, see `servo.stages.payload`
    payload_before: Any  # the one that it goes over from
    payload_goal: Any  # the one that it goes over to
    payload_next: Any  # the one being looked at
    model: DynamicsParams  # of the arm with its payload
    analog_outputs: Any  # (8,) V, in force
    analog_seen: Any  # int64[8], of what was said of them
    outputs_let_go: Any  # int64[16], how often each was let go of
    analog_sent: Any  # int64[8] microvolts, last ones posted
    row: Any  # the telemetry row, see `servo.memory.telemetry`
    mode: int = 0
    fault: int = 0  # code of the FAULT mode, also while a stop ends in it
    event: int = 0  # newest code of any kind
    event_joint: int = (
        NO_JOINT  # joint the newest code speaks of, NO_JOINT for none; written with it, see `servo.event`
    )
    tick: int = 0
    started: int = 0  # 0 until the first whole image was seen
    t_ns: int = 0  # point of the time grid that this cycle is for
    skipped_ns: int = 0  # how much earlier the cycle was to run that it stands in for; the loop sets it
    late_ns: int = 0  # how much later than that it really runs
    status: int = 0  # STATUS register of this tick's image
    image_ok: int = 0
    pending: int = 0  # worst code raised in this tick
    pending_joint: int = NO_JOINT
    power_locked: int = 0  # 1: power was taken away and has not been asked for anew
    offs_seen: int = 0
    ons_seen: int = 0
    asked_anew: int = 0  # 1: power was asked for anew in this cycle
    power_seen: int = 0  # level of the power request at the last tick
    clears_seen: int = 0
    stops_seen: int = 0
    stop_asked: int = 0  # 1: somebody asked in this cycle for a stop, or for an end of power
    halted: int = 0  # 1: somebody has asked for either, and that is told still, see `servo.stages.mode_machine`
    halted_ns: int = 0  # when they did so last
    resumes_seen: int = 0
    resumed_until_ns: int = 0  # until then programs are told of a pause, whose end they have to hear
    powering_since_ns: int = 0
    clear_until_ns: int = 0
    after_stop: int = 0  # mode that follows STOPPING
    stop_since_ns: int = 0
    stream: int = -1  # stream being followed
    guided: int = 0  # 1: joints of that stream that are driven by torque are led by a hand
    dead_stream: int = -1  # newest stream that a stop has ended, and all before it
    next_seq: int = 0
    last_arrival_ns: int = 0
    play_at_ns: int = 0  # when a waiting stream starts
    frame_ns: int = 0  # its sample period
    misses: int = 0  # frames missed in a row
    missed_frames: int = 0  # in all
    late_cycles: int = 0
    setpoint_seq: int = 0  # of the setpoint being played
    inputs: int = 0  # binary inputs, as bits of STATUS
    pots_verdict: int = 0  # of `pots`, as it is told: PLAUSIBLE without a table
    hand: int = 0  # as asked for
    glitches: int = 0  # encoder jumps held back in a row
    law_failed: int = 0  # 1: the built-in law has replaced the user's
    clipped: int = 0  # joints at their torque limit in this tick
    discrete_word: int = 0  # shadow of the DISCRETE register
    discrete_sent: int = -1  # last one posted, -1 for none
    busy_ns: int = 0  # computing time of the previous cycle, told by the loop
    flag_bits: int = 0  # FLAG_* of `servo.memory.published_state`
    flag_word: int = 0  # the same with what telemetry tells beside
    image_seen: int = 0  # count of the newest image
    unchanged: int = 0  # cycles in a row that have seen no newer one
    too_fast: int = 0  # cycles in a row in which a joint was faster than its limit
    unseen: int = 0  # 1: no image says where the joints are, and they are carried on, see `servo.stages.dropout_hold`
    read_ns: int = 0  # when encoder words were last taken from an image
    adopt: int = ADOPT_BOARD  # what to take over from the next good image
    revision: int = 0  # of the board, as it says itself
    board_joints: int = 0  # encoder channels of the board, as it says itself; 0 where it has said nothing yet
    board_losses: int = -1  # times the board was lost, as its side says; -1 before the first cycle
    lost_ns: int = 0  # when that was last seen to have happened
    board_away: int = 0  # 1: lost in a mode without torque, and seen in no image that was asked for since
    module_losses: int = 0  # times a remote module beside the board was lost, as its side says
    calibrates_seen: int = 0
    outputs: int = 0  # in force, output 1 in bit 0
    outputs_locked: int = 0  # switched off by a stop, and not let go of since
    outputs_sent: int = 0  # last ones posted
    analog_powered: int = 0  # power was wanted at the last tick
    bridged: int = 0  # the knot that stands for a missing frame: 1 the newest, 2 the one before, 0 neither
    led_back: int = 0  # 1: the newest setpoint was led beside its place, or back to it
    began_ns: int = 0  # when this cycle really began
    key_told_ns: int = 0  # when the key that lets the arm move was said to be held, and when as this servo counts it
    key_ns: int = 0
    driven: int = 0  # 1: this cycle's writes drive something: power is wanted, or outputs are on that a stop ends
    armed: int = 1  # 1: the guardian is to act should the servo fall silent, see `servo.checks.guardian_arming`
    safe_head: int = -1  # end of the first list of the lane after which nothing is driven, -1 for none
    safe_image: int = -1  # count of the image in which that list was seen taken, -1 before
    image_taken_ns: int = 0  # when the image fetched for this tick was taken, on the same clock
    image_age_ns: int = 0  # of the image fetched for this tick, on the clock of the servo
    clock_board_ns: int = 0  # passed in this window by the board's clock, and by ours, see `servo.checks.board_clock`
    clock_own_ns: int = 0
    clock_taken_ns: int = 0  # when the image before was taken
    clock_fast: int = 0  # windows in a row in which the board's clock went too fast
    dt: float = 0.0
    sample_dt: float = 0.0
    phase: float = 0.0
    rate: float = 0.0
    rate_slope: float = 0.0
    rate_at_stop: float = 0.0
    stop_seconds: float = 0.0
    pending_value: float = 0.0  # what was measured when the pending code was raised, and what was allowed
    pending_limit: float = 0.0
    paused: int = 0  # 1: the operator wants motions to stand still on their path
    override: float = 1.0  # the operator's speed override
    speed_limit: float = 1.0  # share of the joints' greatest speeds that programs may plan
    tool_speed_limit: float = 0.0  # m/s; 0 for none
    payload_mass: float = 0.0  # kg
    payload_left_s: float = 0.0  # until the payload asked for is in force
    payloads_seen: int = 0


def make_state(params: ServoParameters, law: Law) -> ServoState:
    """Fresh state: mode OFF, nothing seen yet. `law` has to live as long as the state."""
    n = params.q_min.size

    def vector() -> Any:
        return np.zeros(n)

    def integers() -> Any:
        return np.zeros(n, dtype=np.int64)

    return record_of(ServoState(
        image=make_image(), raw=integers(), counts=integers(),
        jump=integers(), ahead=integers(), range_min=vector(), range_max=vector(),
        q=vector(), q_before=vector(), v=vector(), observed=vector(), unmodelled=vector(),
        v_seen=vector(), lag=vector(), lag_rate=vector(),
        q_ref=vector(), v_ref=vector(), a_ref=vector(), work=dynamics_work(n),
        gravity=vector(), friction=vector(), tau=vector(), tau_motor=vector(), scratch=vector(), dac=integers(),
        knots=np.zeros((N_KNOTS, n)), rounding=np.zeros((2, n)), aside=vector(), setpoint=vector(),
        setpoint_modes=integers(), joint_modes=integers(), led_from=vector(), torque_setpoint=vector(),
        frame=make_frame(n), force=np.full(N_COMPONENTS, np.nan), force_zero=np.array(params.wrench.bias),
        sensors=np.zeros(N_ADCS), adc=make_adc_state(),
        index_watch=make_index_watch(), pots=make_pot_state(n), cal=make_calibration_state(n),
        memory=np.zeros(MEMORY_WORDS),
        swap=make_swap_state(law, params.gains), copies=make_law_copies(n),
        ops=np.zeros((MAX_OPS, OP_FIELDS), dtype=np.int64),
        watch=make_watch_state(n), signals=np.zeros(N_SIGNALS),
        program_signals=np.full(N_SIGNALS, np.nan), payload=np.zeros(N_PAYLOAD),
        payload_before=np.zeros(N_PAYLOAD), payload_goal=np.zeros(N_PAYLOAD), payload_next=np.zeros(N_PAYLOAD),
        model=params.dynamics, speed_limit=params.speed_share, tool_speed_limit=params.tool_speed,
        fence_work=np.zeros(N_WORK), fence_rows=np.full(4 * N_ROWS, OUTSIDE), fence_place=vector(),
        fence_verdict=np.zeros(N_VERDICT), neighbour=np.zeros((MOST_OTHER_ARMS, N_NEIGHBOUR)),
        analog_outputs=np.array(params.analog.off), analog_seen=np.zeros(N_ANALOG_OUTPUTS, np.int64),
        outputs_let_go=np.zeros(N_OUTPUTS, np.int64),
        analog_sent=np.zeros(N_ANALOG_OUTPUTS, np.int64),
        row=local_record(TelemetryLayout(n).source_dtype),
    ))  # fmt: skip
