"""Analogue outputs: what the program has said last, until a stop ends it.

An output that goes off at a stop shows its off value until its program says another; what is said while the stop
stands is not taken. All go off when arm power goes and when the board is lost: nobody knows then what they show.
"""

from __future__ import annotations

import math
from typing import Any, Final

from qrobot.config.outputs import N_ANALOG_OUTPUTS
from qrobot.hwif.operations import put_analog
from qrobot.hwif.registers import DAC_COUNTS_PER_VOLT, DAC_MASK, DAC_ZERO
from qrobot.realtime.atomics import load_acquire
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.modes import wants_power
from qrobot.servo.parameters import ServoParameters
from qrobot.servo.state import ServoState

MICRO_PER_VOLT: Final = 1e6


@lean_kernel
def settle_analog(params: ServoParameters, state: ServoState, mail: Any, stopped: bool) -> None:
    """The analogue outputs of this cycle; `stopped` tells that the arm is being stopped, or was."""
    lines = params.analog
    if lines.lines == 0:
        return
    powered = wants_power(state.mode)
    unserved = mail.guardian.takeover != 0 or mail.command.shutdown != 0
    lost = state.image_ok == 0 or unserved or (state.analog_powered != 0 and not powered)
    state.analog_powered = 1 if powered else 0
    mail.heartbeat.analog = lines.modules
    for k in range(N_ANALOG_OUTPUTS):
        if lines.lines >> k & 1 == 0:
            continue
        take_volts(params, state, mail, k)
        if lost or (stopped and lines.holds >> k & 1 == 0):
            state.analog_outputs[k] = lines.off[k]


@lean_kernel
def take_volts(params: ServoParameters, state: ServoState, mail: Any, k: int) -> None:
    """Take what is new of output `k`, unless it is out of range, or no number."""
    told = load_acquire(mail.command.analog_told, k)
    if told == state.analog_seen[k]:
        return
    state.analog_seen[k] = told
    volts = mail.command.analog_volts[k]
    if params.analog.least[k] <= volts <= params.analog.most[k]:
        state.analog_outputs[k] = volts


@lean_kernel
def analog_on(params: ServoParameters, state: ServoState) -> bool:
    """An output shows what somebody has to end should the servo die: one that holds in a stop, too."""
    lines = params.analog
    on = False
    for k in range(N_ANALOG_OUTPUTS):
        if lines.lines >> k & 1 != 0:
            on = on or state.analog_outputs[k] != lines.off[k]
    return on


@lean_kernel
def free_dac(params: ServoParameters, state: ServoState, channel: int) -> int:
    """Code of a converter that drives no motor: that of its output, or of 0 V."""
    k = params.analog.at_dac[channel]
    if k < 0:
        return DAC_ZERO
    code = math.floor(DAC_ZERO - state.analog_outputs[k] * DAC_COUNTS_PER_VOLT + 0.5)
    return int(min(max(code, 0), DAC_MASK))


@lean_kernel
def post_analog(params: ServoParameters, state: ServoState, n: int) -> int:
    """Tell the modules beside the board what is new, all of it to a board that is new; returns the list's length."""
    modules = params.analog.modules
    if modules == 0:
        return n
    for k in range(N_ANALOG_OUTPUTS):
        microvolts = math.floor(state.analog_outputs[k] * MICRO_PER_VOLT + 0.5)
        if modules >> k & 1 != 0 and (microvolts != state.analog_sent[k] or state.discrete_sent < 0):
            state.analog_sent[k] = microvolts
            n = put_analog(state.ops, n, k, microvolts)
    return n
