"""Potentiometers against encoders while the motors carry torque: a motor that turns shows in one, or the other is dead.

pot - slope * counts does not change when a joint moves. While the counts of a joint that is driven stand, and its
potentiometer goes on, its encoder is dead (`servo.checks.dead_encoder`).

With a calibration table the potentiometers have been checked before power. Without one there is only the slope of the
robot file, which a deployment may have left as it was, so that one has to earn trust:

| a potentiometer is |                                                                  | is taken for               |
|--------------------|------------------------------------------------------------------|----------------------------|
| UNPROVEN           | quiet before power, and has not been moved yet                   | a motor gone, if it goes   |
| PROVEN             | and has gone with its encoder for two turns of the motor         | the same, and one that     |
|                    |                                                                  | stands, if it stands       |
| REFUTED            | noisy before power, when the board was met,                      | nothing                    |
|                    | or has not gone with its encoder                                 | nothing, until power goes  |

An UNPROVEN one that is dead, absent or wired elsewhere thus never excuses an encoder, nor accuses one by its noise.

A potentiometer stands at an end of its track wherever its motor is beyond it; joint 6 of the PUMA 560 turns so far.
There it excuses no encoder, and accuses only one whose counts say that it is to be well within its track.
"""

from __future__ import annotations

from typing import Final

from qrobot.faultcodes import NO_JOINT
from qrobot.hwif.registers import ADC_E_VOLT_PER_COUNT, ADC_F_VOLT_PER_COUNT
from qrobot.modecodes import Mode
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.calibration.potentiometers import TRACK_UNITS, are_silent, has_table, pot_residue
from qrobot.servo.calibration.state import (
    IMPLAUSIBLE,
    PLAUSIBLE,
    PROVEN,
    REFUTED,
    SILENT,
    UNJUDGED,
    UNPROVEN,
    Stage,
)
from qrobot.servo.checks.dead_encoder import (
    FIRST_READINGS,
    follow_pot,
    gone_units,
    has_followed,
    in_a_row,
    is_at_end,
    shown_residue,
)
from qrobot.servo.kernels.converter import REVISION_E
from qrobot.servo.modes import gives_torque
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

TURN: Final = 32  # so many conversions, however many cycles each takes,
POT_SHARE: Final = 8  # and of these for potentiometers, beside sensors: each channel once [A]
COMMON_SHARE: Final = 12  # and of these for all of them, beside joints that show no count though driven [A]
SUSPECT_S: Final = 0.02  # so long driven without a count: read more often [A]
HEARD: Final = 12  # readings of each potentiometer before power, where there is no table
QUIET_TURNS: Final = 0.3  # of the motor, within which they lie [A]; noise of the emulated ones makes 0.17
STEP_E: Final = ADC_E_VOLT_PER_COUNT / ADC_F_VOLT_PER_COUNT  # of 8 bits, ADC units: 0.4 turns
STRAYED_SHARE: Final = 0.6  # of what shows a motor gone: an answer where the model is sure of missing counts [A]
STOOD_READINGS: Final = 4  # of a motor that stands: as many as show one that is gone [A]
END_TURNS: Final = 0.5  # of the motor, so near to an end of its track a potentiometer may stand at it [A]
CALIBRATING: Final = int(Mode.CALIBRATING)
SWEEPING: Final = int(Stage.SWEEPING)


@lean_kernel
def wanted_channels(params: ServoParameters, state: ServoState) -> int:
    """ADC channels to sample now: the sensors', and potentiometers as long as they are needed. A bit each."""
    if not has_table(params):
        return int(params.sensor_mask | _unchecked_channels(params, state))
    if state.cal.stage == SWEEPING:  # nothing else, so that every turn has many readings
        return int(1 << params.pot_channel[state.cal.joint_now])
    verdict = state.pots.verdict
    if verdict == IMPLAUSIBLE or (verdict == PLAUSIBLE and not compared_now(params, state)):
        return int(params.sensor_mask)
    return int(params.sensor_mask | pot_channels(params, state))


@lean_kernel
def _unchecked_channels(params: ServoParameters, state: ServoState) -> int:
    """Channels of the potentiometers, without a table: until they were heard, and under torque; those of no sensor."""
    verdict = state.pots.verdict
    wanted = not gives_torque(state.mode) if verdict == UNJUDGED else compared_now(params, state)
    if params.pots == 0 or verdict == SILENT or not wanted:
        return 0
    return int(pot_channels(params, state) & ~params.sensor_mask)


@lean_kernel
def pot_channels(params: ServoParameters, state: ServoState) -> int:
    """Channels of all potentiometers, or most of the time of those of joints that show no count though driven."""
    every, suspects = 0, 0
    for j in range(params.pot_channel.size):
        bit = 1 << params.pot_channel[j]
        every |= bit
        if state.watch.driven[j] != 0 and state.watch.still_s[j] >= SUSPECT_S:
            suspects |= bit
    common = suspects == 0 or not watched(state) or state.adc.begun % TURN < COMMON_SHARE
    return every if common else suspects


@lean_kernel
def compared_now(params: ServoParameters, state: ServoState) -> bool:
    """The turn of the potentiometers, beside encoders under torque: always, or a quarter of the time beside sensors."""
    if not gives_torque(state.mode):
        return False
    return params.sensor_mask == 0 or state.adc.begun % TURN < POT_SHARE


@lean_kernel
def hear_pots(params: ServoParameters, state: ServoState, channel: int) -> None:
    """Take a new conversion of `channel` (-1: none) before power, without a table, and judge their noise.

    A converter that stays silent is not asked again.
    """
    pots = state.pots
    if has_table(params) or params.pots == 0 or pots.verdict != UNJUDGED or gives_torque(state.mode):
        return
    enough = True
    for j in range(params.pot_channel.size):
        if params.pot_channel[j] == channel:
            _hear_pot(params, state, j)
        enough = enough and (pots.readings[j] >= HEARD or _is_a_sensor(params, j))
    if enough:
        pots.verdict = PLAUSIBLE
    elif are_silent(params, state):
        pots.verdict, pots.suspect = SILENT, NO_JOINT


@lean_kernel
def _is_a_sensor(params: ServoParameters, j: int) -> bool:
    return bool(params.sensor_mask & (1 << params.pot_channel[j]) != 0)


@lean_kernel
def _hear_pot(params: ServoParameters, state: ServoState, j: int) -> None:
    pots, residue = state.pots, pot_residue(params, state, j)
    pots.low[j] = residue if pots.readings[j] == 0 else min(pots.low[j], residue)
    pots.high[j] = residue if pots.readings[j] == 0 else max(pots.high[j], residue)
    pots.readings[j] += 1


@lean_kernel
def follow_pots(params: ServoParameters, state: ServoState, channel: int) -> None:
    """Compare a new conversion of `channel` (-1: none) with its encoder while the motors carry torque."""
    if channel < 0 or state.pots.verdict != PLAUSIBLE:
        return
    for j in range(params.pot_channel.size):
        if params.pot_channel[j] != channel:
            continue
        if watched(state) and (has_table(params) or not _is_a_sensor(params, j)):
            _follow_pot(params, state, j)
        else:
            state.pots.followed[j], state.pots.gone[j], state.pots.strayed[j], state.pots.stood[j] = 0, 0, 0, 0


@lean_kernel
def watched(state: ServoState) -> bool:
    """The counts are those of the pose, and stay so: they are not being calibrated."""
    return gives_torque(state.mode) and state.mode != CALIBRATING


@lean_kernel
def _follow_pot(params: ServoParameters, state: ServoState, j: int) -> None:
    pots, residue = state.pots, pot_residue(params, state, j)
    counted = params.transmission.pot_per_count[j] * state.counts[j]
    turn = abs(params.transmission.pot_per_count[j]) * params.transmission.counts_per_rev[j]
    step = STEP_E if state.revision == REVISION_E else 0.0
    at_end = is_at_end(residue + counted, END_TURNS * turn + step, TRACK_UNITS)
    if not at_end:
        _try_pot(params, state, j, residue, turn)
    if not at_end or pots.followed[j] > 0:
        _compare_pot(state, j, residue, counted, turn, step, at_end)
    pots.at_end[j], pots.counts[j] = 1 if at_end else 0, state.counts[j]


@lean_kernel
def _try_pot(params: ServoParameters, state: ServoState, j: int, residue: float, turn: float) -> None:
    """Begin or go on with the proof; what a potentiometer did beyond the ends of its track proves nothing."""
    if state.pots.followed[j] == 0:
        _begin_proof(params, state, j, residue, turn)
    elif state.pots.at_end[j] != 0:
        state.pots.anchor[j], state.pots.anchor_counts[j] = residue, state.counts[j]
    else:
        _go_on_with_proof(params, state, j, residue, turn)


@lean_kernel
def _compare_pot(
    state: ServoState, j: int, residue: float, counted: float, turn: float, step: float, at_end: bool
) -> None:
    """Tell how far a reading is off the mean, which those on the track make."""
    pots, readings = state.pots, state.pots.followed[j]
    free = state.counts[j] != pots.counts[j] or state.watch.driven[j] == 0
    before = shown_residue(pots.newest[j], counted, TRACK_UNITS)
    average, trusted = follow_pot(residue, before, pots.average[j], readings, free, turn)
    pots.trusted[j] = 1 if trusted and (readings == 0 or pots.trusted[j] != 0) else 0
    if not at_end:
        pots.average[j], pots.newest[j] = average, residue
        pots.followed[j] += 1
    far = gone_units(turn, pots.high[j] - pots.low[j], step)
    credible = pots.trusted[j] != 0 and pots.proof[j] != REFUTED and readings >= FIRST_READINGS
    off = residue - shown_residue(pots.average[j], counted, TRACK_UNITS) if credible and not free else 0.0
    pots.gone[j] = pots.gone[j] + 1 if not abs(off) <= far else 0
    pots.strayed[j] = in_a_row(pots.strayed[j], off, STRAYED_SHARE * far)
    pots.stood[j] = pots.stood[j] + 1 if credible and not free and abs(off) <= STRAYED_SHARE * far else 0


@lean_kernel
def _begin_proof(params: ServoParameters, state: ServoState, j: int, residue: float, turn: float) -> None:
    """Power has come on: what its readings before say of a potentiometer, or a table."""
    pots = state.pots
    quiet = abs(pots.high[j] - pots.low[j]) <= QUIET_TURNS * turn
    pots.proof[j] = PROVEN if has_table(params) else UNPROVEN if quiet else REFUTED
    pots.anchor[j], pots.anchor_counts[j] = residue, state.counts[j]


@lean_kernel
def _go_on_with_proof(params: ServoParameters, state: ServoState, j: int, residue: float, turn: float) -> None:
    """Try a potentiometer that no table vouches for, on each stretch of two turns; refuted once, it stays so."""
    pots, counts = state.pots, state.counts[j] - state.pots.anchor_counts[j]
    followed = has_followed(residue - pots.anchor[j], counts, params.transmission.counts_per_rev[j], turn)
    if followed == 0 or has_table(params) or pots.proof[j] == REFUTED:
        return
    pots.proof[j] = PROVEN if followed > 0 else REFUTED
    pots.anchor[j], pots.anchor_counts[j] = residue, state.counts[j]


@lean_kernel
def joint_stands(state: ServoState, j: int) -> bool:
    """Encoder and potentiometer of a joint that is driven agree that it stands: something holds it."""
    return bool(pot_is_watching(state, j) and state.pots.stood[j] >= STOOD_READINGS)


@lean_kernel
def pot_is_watching(state: ServoState, j: int) -> bool:
    """A potentiometer that can be trusted would show a motor that turns while its encoder does not count."""
    pots = state.pots
    on_track = pots.followed[j] >= FIRST_READINGS and pots.at_end[j] == 0
    return bool(on_track and pots.trusted[j] != 0 and pots.proof[j] == PROVEN)
