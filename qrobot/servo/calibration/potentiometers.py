"""Reading of the potentiometers before an arm gets power.

A potentiometer hangs on its motor, so that pot - slope * counts does not change when the joint moves: the mean of a few
readings is good to a fraction of a turn, at rest or not.

* Counters that are not calibrated are shifted by what the potentiometers say. The pose is then right to about a quarter
  of a motor turn (0.03 rad), enough to carry the arm's weight and to keep away from its stops, not enough to work with.
  Not so beyond the ends of a potentiometer's track, where joint 6 can stand: it carries nothing, and meets no stop.
* Counters that claim to be calibrated are checked. Off by more than the potentiometers allow, they get no power.

Both need a calibration table. Under torque potentiometers watch their encoders, with a table and without
(`servo.checks.potentiometer_monitor`).
"""

from __future__ import annotations

import math
from typing import Any, Final

from qrobot.faultcodes import NO_JOINT
from qrobot.hwif.registers import ADC_E_VOLT_PER_COUNT, ADC_F_VOLT_PER_COUNT, STATUS_CALIBRATED
from qrobot.model.transmission import counts_to_joint
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.calibration.index_matching import in_table
from qrobot.servo.calibration.state import (
    IMPLAUSIBLE,
    PLAUSIBLE,
    SILENT,
    UNJUDGED,
    UNPROVEN,
    Stage,
)
from qrobot.servo.kernels.converter import REVISION_E
from qrobot.servo.modes import gives_torque
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

READINGS: Final = 4  # per joint; noise is 5 units (see `sim_board.analog`) against 150 a turn
MOST_SILENCES: Final = 3  # conversions without an answer
ROWS_BEYOND: Final = 3  # a table begins in the second turn of the range, and an arm may stand a little outside of it
OFF_TURNS: Final = 0.6  # pot against table: backlash 0.3 turns, waviness, noise
TRACK_UNITS: Final = 5.0 / ADC_F_VOLT_PER_COUNT  # where the track of a potentiometer ends, ADC units; it begins at 0
HALF_STEP_E: Final = 0.5 * ADC_E_VOLT_PER_COUNT / ADC_F_VOLT_PER_COUNT  # what 8 bits leave open, ADC units
SWEEPING: Final = int(Stage.SWEEPING)


@lean_kernel
def has_table(params: ServoParameters) -> bool:
    """True when the servo was given a calibration table."""
    return bool(params.calibration.rows[0] > 0)


@lean_kernel
def answer_pots(params: ServoParameters, state: ServoState) -> bool:
    """True when the potentiometers have had their say on a request for power, or none is wanted; ask in each cycle.

    Where they found the counters right before, an encoder may have been off since: each request has them read anew.
    Where they did not, that stands until the board is met anew, or the counters are given up.
    Without a table they are heard until they are quiet or silent: under torque there is no other time for it.
    """
    pots = state.pots
    if not has_table(params):
        return bool(params.pots == 0 or pots.verdict != UNJUDGED)
    if pots.asked_at != state.tick - 1 and pots.verdict == PLAUSIBLE:
        forget_pots(params, state)
    pots.asked_at = state.tick
    return bool(pots.verdict != UNJUDGED)


@lean_kernel
def forget_trials(state: ServoState) -> None:
    """Power comes on: what the potentiometers have shown beside their encoders is of the time before."""
    for j in range(state.pots.followed.size):
        state.pots.followed[j], state.pots.gone[j], state.pots.strayed[j], state.pots.stood[j] = 0, 0, 0, 0


@lean_kernel
def forget_pots(params: ServoParameters, state: ServoState) -> None:
    """Another board, other counters, or another request for power: read everything anew."""
    forget_trials(state)
    state.pots.verdict, state.pots.silences_before = UNJUDGED, _silences(params, state)
    for j in range(state.pots.total.size):
        state.pots.total[j], state.pots.readings[j] = 0.0, 0
        state.pots.low[j], state.pots.high[j], state.pots.proof[j] = 0.0, 0.0, UNPROVEN


@lean_kernel
def pot_units(volts: float) -> float:
    """Volts in the table's units, 20 V / 65536."""
    return volts / ADC_F_VOLT_PER_COUNT


@lean_kernel
def pot_residue(params: ServoParameters, state: ServoState, joint: int) -> float:
    """The newest reading less what the counts account for, ADC units."""
    units = pot_units(state.sensors[params.pot_channel[joint]])
    return float(units - params.transmission.pot_per_count[joint] * state.counts[joint])


@lean_kernel
def watch_pots(params: ServoParameters, state: ServoState, channel: int) -> None:
    """Take a new conversion of `channel` (-1: none in this cycle) until every joint has its readings; then judge.

    A converter that has been silent is asked again and again, and believed once it answers.
    """
    if not has_table(params):
        return
    if state.pots.verdict == SILENT and _is_a_pot(params, channel):
        forget_pots(params, state)
    if state.pots.verdict != UNJUDGED:
        return
    enough = True
    for j in range(params.pot_channel.size):
        if params.pot_channel[j] == channel:
            state.pots.total[j] += pot_residue(params, state, j)
            state.pots.readings[j] += 1
        enough = enough and state.pots.readings[j] >= READINGS
    if enough and not gives_torque(state.mode):
        _judge(params, state)
    elif are_silent(params, state):
        state.pots.verdict, state.pots.suspect = SILENT, NO_JOINT


@lean_kernel
def are_silent(params: ServoParameters, state: ServoState) -> bool:
    """The converter gives no answer about potentiometers. What it says of a sensor is another matter."""
    return bool(_silences(params, state) - state.pots.silences_before >= MOST_SILENCES)


@lean_kernel
def _silences(params: ServoParameters, state: ServoState) -> int:
    lost = 0
    for channel in range(state.adc.lost.size):
        if params.sensor_mask & (1 << channel) == 0:
            lost += state.adc.lost[channel]
    return int(lost)


@lean_kernel
def _is_a_pot(params: ServoParameters, channel: int) -> bool:
    found = False
    for j in range(params.pot_channel.size):
        found = found or params.pot_channel[j] == channel
    return found


@lean_kernel
def gather_pot(params: ServoParameters, state: ServoState, channel: int) -> None:
    """Add a new conversion of a sweeping joint's `channel` to the turn it was made in."""
    if state.cal.stage == SWEEPING and params.pot_channel[state.cal.joint_now] == channel:
        state.cal.residue += pot_residue(params, state, state.cal.joint_now)
        state.cal.samples += 1


@lean_kernel
def _judge(params: ServoParameters, state: ServoState) -> None:
    state.pots.verdict = PLAUSIBLE
    calibrated = state.status & STATUS_CALIBRATED != 0
    coarse = HALF_STEP_E if state.revision == REVISION_E else 0.0
    for j in range(state.counts.size):
        residue = state.pots.total[j] / state.pots.readings[j]
        pot = residue + params.transmission.pot_per_count[j] * state.counts[j]
        turn = params.transmission.pot_per_count[j] * params.transmission.counts_per_rev[j]
        count = state.counts[j] - params.transmission.count_offset[j]
        told = table_pot(params.calibration, j, count)
        told = min(max(told, 0.0), TRACK_UNITS)
        off = abs(pot - told)
        if not in_table(params.calibration, j, pot, ROWS_BEYOND) or (
            calibrated and not off <= OFF_TURNS * abs(turn) + coarse
        ):
            state.pots.verdict, state.pots.suspect = IMPLAUSIBLE, j
            return
    if not calibrated:
        _take_pose(params, state)


@lean_kernel
def _take_pose(params: ServoParameters, state: ServoState) -> None:
    """Shift the counts so that the straight line of the robot file holds: pot = zero + slope * (counts - offset)."""
    transmission = params.transmission
    for j in range(state.counts.size):
        residue = state.pots.total[j] / state.pots.readings[j]
        off = (residue - transmission.pot_at_zero[j]) / transmission.pot_per_count[j] + transmission.count_offset[j]
        state.counts[j] += math.floor(off + 0.5)
    move_frame(params, state)


@lean_kernel
def move_frame(params: ServoParameters, state: ServoState) -> None:
    """The counts have another zero now: positions, reference and where the arm is parked follow; nothing has moved."""
    counts_to_joint(state.counts, params.transmission, state.scratch)
    for j in range(state.q.size):
        step = state.scratch[j] - state.q_before[j]
        state.q_ref[j] += step
        state.observed[j] += step
        state.watch.q_parked[j] += step
        state.q_before[j] = state.scratch[j]


@lean_kernel
def table_pot(table: Any, joint: int, count: int) -> float:
    """Reading the table has for a count without offset; straight on beyond its ends."""
    rows = table.rows[joint]
    step = table.count[joint, 1] - table.count[joint, 0]
    place = (count - table.count[joint, 0]) / step
    row = min(max(math.floor(place), 1), rows - 2)  # the first row may be off
    share = place - row
    return float(table.pot[joint, row] * (1.0 - share) + table.pot[joint, row + 1] * share)
