"""Calibration: from counters that mean nothing to exact ones, one joint after the other, base to flange.

    for each joint:  back off where the range leaves no room   ->  creep in the positive direction over a few index
                     pulses, averaging the potentiometer over each motor turn  ->  find the rows of the table  ->  rest
    for all:         wait until no counter moves  ->  counter := row + (position - index)  ->  set the CALIB bit

The joints move in the table's direction (TRC004 vendor driver v4.3), so that backlash between motor and potentiometer
is the same as when the table was made; the first index pulse only tells where the turns begin. Everything that is
measured is on the motor side, and wrist joints are moved after those they are coupled to.

Whatever does not fit ends the attempt with a code, torque on and the arm at rest (`refuse`); nothing is loaded before
every joint is certain. Counters are loaded while nothing moves: every image up to the load shows the old words and the
first one after it exactly the new ones, or the calibration is refused.
"""

from __future__ import annotations

import math
from typing import Any, Final

from qrobot.faultcodes import NO_JOINT, FaultCode
from qrobot.hwif.image import IMAGE_ENC_INDEX
from qrobot.hwif.operations import put_write
from qrobot.hwif.registers import (
    DISCRETE,
    DISCRETE_CALIBRATED,
    DISCRETE_INDEX,
    ENC_LOAD,
    INDEX_BIT_0,
    STATUS_CALIBRATED,
)
from qrobot.modecodes import Mode
from qrobot.model.transmission import count_word, signed_word
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.calibration.index_matching import find_rows
from qrobot.servo.calibration.potentiometers import move_frame
from qrobot.servo.calibration.state import (
    Stage,
)
from qrobot.servo.event import report_event
from qrobot.servo.hold import allow_range, hold_position, hold_reference
from qrobot.servo.kernels.converter import await_answer, is_answered
from qrobot.servo.modes import set_mode
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

IDLE: Final = int(Stage.IDLE)
BACKING: Final = int(Stage.BACKING)
SWEEPING: Final = int(Stage.SWEEPING)
SLOWING: Final = int(Stage.SLOWING)
SETTLING: Final = int(Stage.SETTLING)
LOADING: Final = int(Stage.LOADING)
MARKING: Final = int(Stage.MARKING)
UNCALIBRATED: Final = int(Mode.UNCALIBRATED)
HOLDING: Final = int(Mode.HOLDING)

CAL_VOTE: Final = int(FaultCode.CAL_VOTE)
CAL_INDEX: Final = int(FaultCode.CAL_INDEX)
CAL_BLOCKED: Final = int(FaultCode.CAL_BLOCKED)
CAL_ROOM: Final = int(FaultCode.CAL_ROOM)
CAL_MOVED: Final = int(FaultCode.CAL_MOVED)

MISSING_TURNS: Final = 1.5  # so far without an index pulse: one is missing
SPACING_COUNTS: Final = 2  # by which the turns between index pulses may seem longer or shorter
SPARE_TURNS: Final = 2.0  # of room beyond the turns wanted: one to the first pulse, one to come to rest
POSE_TURNS: Final = 0.5  # what the pose before calibration may be wrong by
FEWEST_SAMPLES: Final = 4  # pot readings a turn
MOST_ATTEMPTS: Final = 2  # of a joint whose index pulses do not come as they should
ARRIVED: Final = 1e-4  # rad or m
ROUND: Final = 6  # settling times until a joint that does not come to rest is nudged
NEAR_COUNTS: Final = 20  # an arm held at rest moves by less while counters are loaded


@lean_kernel
def calibrate(params: ServoParameters, state: ServoState) -> None:
    """One cycle in mode CALIBRATING: moves the reference, and ends in HOLDING or, refused, in UNCALIBRATED."""
    stage, joint = state.cal.stage, state.cal.joint_now
    if stage == IDLE:
        begin_joint(params, state, 0)
    elif stage == BACKING:
        _back(params, state, joint)
    elif stage == SWEEPING:
        _sweep(params, state, joint)
    elif stage == SLOWING:
        _slow(params, state, joint)
    elif stage == SETTLING:
        _settle(params, state)
    else:
        _see_it_done(params, state)
    if state.cal.stage != IDLE and not abs(state.tau[joint]) <= params.creep_torque[joint]:
        refuse(state, CAL_BLOCKED, joint)


@lean_kernel
def leave_calibration(state: ServoState) -> None:
    """Forget an attempt, whatever ended it, and let the index latches be."""
    state.cal.stage, state.cal.rearm, state.cal.load = IDLE, 0, 0
    state.discrete_word &= ~DISCRETE_INDEX


@lean_kernel
def refuse(state: ServoState, code: int, joint: int) -> None:
    """End the attempt: hold where the arm is, uncalibrated, and say why."""
    leave_calibration(state)
    hold_position(state)
    report_event(state, code, joint)
    set_mode(state, UNCALIBRATED)


# ---------------------------------------------------------------------------------------------------------- motion


@lean_kernel
def turn_of(params: ServoParameters, joint: int) -> float:
    """A motor turn in joint units."""
    transmission = params.transmission
    return float(abs(transmission.rad_per_count[joint]) * transmission.counts_per_rev[joint])


@lean_kernel
def begin_joint(params: ServoParameters, state: ServoState, joint: int) -> None:
    """Start on a joint, or again from where it began: the sweep has to end inside the range."""
    cal = state.cal
    highest = params.q_max[joint] - (cal.wanted + SPARE_TURNS) * turn_of(params, joint)
    if joint != cal.joint_now or cal.stage == IDLE:
        cal.attempts = 0
        cal.begin = min(state.q_ref[joint], highest)
    cal.joint_now = joint
    if highest < params.q_min[joint]:
        refuse(state, CAL_ROOM, joint)
    elif state.q_ref[joint] > cal.begin:
        cal.stage = BACKING
    else:
        _begin_sweep(state, joint)


@lean_kernel
def _begin_sweep(state: ServoState, joint: int) -> None:
    cal = state.cal
    cal.stage, cal.first, cal.found, cal.rearm = SWEEPING, 1, 0, 1
    _begin_turn(state, state.counts[joint])


@lean_kernel
def _begin_turn(state: ServoState, count: int) -> None:
    cal = state.cal
    cal.last_index, cal.samples, cal.residue = count, 0, 0.0


@lean_kernel
def creep(params: ServoParameters, state: ServoState, joint: int, wish: float) -> None:
    """Move the reference of one joint on, its speed changing towards `wish` at the creeping acceleration."""
    most = params.creep_acceleration[joint] * state.dt
    change = min(max(wish - state.cal.speed, -most), most)
    state.cal.speed += change
    state.v_ref[joint] = state.cal.speed
    state.a_ref[joint] = change / state.dt
    state.q_ref[joint] += state.cal.speed * state.dt


@lean_kernel
def _back(params: ServoParameters, state: ServoState, joint: int) -> None:
    left = state.q_ref[joint] - state.cal.begin
    if left <= ARRIVED:
        _begin_sweep(state, joint)
        return
    braking = math.sqrt(2.0 * params.creep_acceleration[joint] * left)
    creep(params, state, joint, -min(params.creep_speed[joint], braking))
    if state.q[joint] < params.q_min[joint] - POSE_TURNS * turn_of(params, joint):
        refuse(state, CAL_ROOM, joint)


@lean_kernel
def _slow(params: ServoParameters, state: ServoState, joint: int) -> None:
    creep(params, state, joint, 0.0)
    if state.cal.speed != 0.0:
        return
    if joint + 1 < state.q.size:
        begin_joint(params, state, joint + 1)
    else:
        state.cal.stage, state.cal.still, state.cal.waited = SETTLING, 0, 0


# ------------------------------------------------------------------------------------------------------ index pulses


@lean_kernel
def _sweep(params: ServoParameters, state: ServoState, joint: int) -> None:
    cal, turn = state.cal, params.transmission.counts_per_rev[joint]
    creep(params, state, joint, params.creep_speed[joint])
    shown = cal.rearm == 0 and is_answered(cal.latch, state.adc, state.image, state.image_taken_ns)
    if shown and state.status & INDEX_BIT_0 << joint == 0:
        _take_index(params, state, joint)
    elif abs(state.counts[joint] - cal.last_index) > MISSING_TURNS * turn:
        _try_again(params, state, joint)
    elif state.q[joint] > params.q_max[joint] + POSE_TURNS * turn_of(params, joint):
        refuse(state, CAL_ROOM, joint)


@lean_kernel
def _take_index(params: ServoParameters, state: ServoState, joint: int) -> None:
    """An index pulse: the latched count, and the potentiometer's mean over the turn that ends there."""
    cal = state.cal
    latched = state.image[IMAGE_ENC_INDEX + joint]
    count = state.counts[joint] + signed_word(latched - state.raw[joint])
    if cal.first == 1:
        cal.first = 0
    elif not _spaced(cal, count, params.transmission.counts_per_rev[joint]):
        _try_again(params, state, joint)
        return
    elif cal.samples < FEWEST_SAMPLES:
        refuse(state, CAL_VOTE, joint)
        return
    else:
        pot = cal.residue / cal.samples + params.transmission.pot_per_count[joint] * count
        cal.index[cal.found], cal.pot[cal.found] = count, pot
        cal.found += 1
    cal.rearm = 1
    _begin_turn(state, count)
    if cal.found == cal.wanted:
        _decide(params, state, joint)


@lean_kernel
def _spaced(cal: Any, count: int, turn: int) -> bool:
    """An index pulse at `count` is one turn after the last one, and whole turns after the first that counts."""
    one, found = abs(count - cal.last_index), cal.found
    spaced = abs(one - turn) <= SPACING_COUNTS
    if found > 0:
        spaced = spaced and abs(abs(count - cal.index[0]) - found * turn) <= SPACING_COUNTS
    return bool(spaced)


@lean_kernel
def _try_again(params: ServoParameters, state: ServoState, joint: int) -> None:
    state.cal.attempts += 1
    if state.cal.attempts < MOST_ATTEMPTS:
        begin_joint(params, state, joint)
    else:
        refuse(state, CAL_INDEX, joint)


@lean_kernel
def _decide(params: ServoParameters, state: ServoState, joint: int) -> None:
    cal, table = state.cal, params.calibration
    code, row, cal.misfit[joint], cal.margin[joint], cal.votes[joint] = find_rows(table, joint, cal.pot, cal.wanted)
    if code != 0:
        refuse(state, code, joint)
        return
    newest = cal.wanted - 1
    true = table.count[joint, row + newest] + params.transmission.count_offset[joint]
    cal.shift[joint] = true - cal.index[newest]
    cal.stage = SLOWING


@lean_kernel
def post_latches(state: ServoState, n: int) -> int:
    """Arm the present joint's index latch (mask 0, then 1), or load the counters; returns the number of operations."""
    cal = state.cal
    if cal.rearm != 0:
        bit = INDEX_BIT_0 << cal.joint_now
        n = put_write(state.ops, n, DISCRETE, state.discrete_word & ~bit)
        state.discrete_word |= bit
        n = put_write(state.ops, n, DISCRETE, state.discrete_word)
        cal.rearm = 0
        await_answer(cal.latch)
    if cal.load != 0:
        for j in range(cal.words.size):
            n = put_write(state.ops, n, ENC_LOAD + 2 * j, cal.words[j])
        cal.load = 0
    return n


# ----------------------------------------------------------------------------------------------------------- loading


@lean_kernel
def _settle(params: ServoParameters, state: ServoState) -> None:
    """Wait until no counter has moved for a while, then have the new counts loaded."""
    cal = state.cal
    restless = NO_JOINT
    for j in range(state.raw.size):
        if state.raw[j] != cal.before[j]:
            restless = j
        cal.before[j] = state.raw[j]
    cal.still = cal.still + 1 if restless < 0 else 0
    _nudge(params, state, restless)
    cal.waited += 1
    if cal.waited > params.settle_patience:
        refuse(state, CAL_MOVED, restless)
    elif cal.still >= params.settle_cycles:
        for j in range(state.raw.size):
            cal.words[j] = count_word(state.counts[j] + cal.shift[j])
        cal.load, cal.moved, cal.waited, cal.stage = 1, 0, 0, LOADING


@lean_kernel
def _nudge(params: ServoParameters, state: ServoState, restless: int) -> None:
    """Move a joint on a little that came to rest on an encoder's edge, where its counter flickers under servo."""
    cal = state.cal
    rounds, phase = cal.waited // (ROUND * params.settle_cycles), cal.waited % (ROUND * params.settle_cycles)
    if restless >= 0 and 2 * phase > ROUND * params.settle_cycles:
        cal.joint_now = restless
    joint = cal.joint_now
    moving = rounds > 0 and phase < params.settle_cycles
    creep(params, state, joint, params.creep_speed[joint] if moving else 0.0)


@lean_kernel
def _differ(words: Any, others: Any) -> int:
    """Largest difference between two sets of encoder words, counts. Shapes (n,)."""
    largest = 0
    for j in range(words.size):
        largest = max(largest, abs(signed_word(words[j] - others[j])))
    return largest


@lean_kernel
def see_load(params: ServoParameters, state: ServoState, words: Any) -> bool:
    """Judge the encoder words of a new image while counters are being loaded.

    A joint that moved by a count before its counter was loaded looks like one that moved after it, so any motion
    spoils the attempt.

    Returns:
        True when they cannot be used: some show the old counter and some the new one.
    """
    cal = state.cal
    old, new = _differ(words, cal.before), _differ(words, cal.words)
    if new > NEAR_COUNTS and old > NEAR_COUNTS:
        return True
    if old != 0 and new != 0:
        cal.moved = 1
    if new <= NEAR_COUNTS and new <= old:
        _take_frame(params, state)
        if cal.moved != 0:
            refuse(state, CAL_MOVED, NO_JOINT)
    return False


@lean_kernel
def _take_frame(params: ServoParameters, state: ServoState) -> None:
    """The counters are the new ones."""
    cal = state.cal
    for j in range(state.raw.size):
        state.raw[j] = cal.words[j]
        state.counts[j] = signed_word(cal.words[j])
    move_frame(params, state)
    cal.stage, cal.waited = MARKING, 0


@lean_kernel
def _see_it_done(params: ServoParameters, state: ServoState) -> None:
    """Wait for the image to show what was posted: the counters, then the CALIB bit."""
    state.cal.waited += 1
    if state.cal.waited > params.load_patience:
        state.discrete_word &= ~DISCRETE_CALIBRATED
        refuse(state, CAL_MOVED, NO_JOINT)
    elif state.cal.stage == MARKING:
        state.discrete_word |= DISCRETE_CALIBRATED
        if state.status & STATUS_CALIBRATED != 0:
            leave_calibration(state)
            allow_range(params, state)
            hold_reference(state)
            set_mode(state, HOLDING)
