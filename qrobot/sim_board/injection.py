"""Faults in the memory of an emulated board: who injects them, and the kernel that makes them act.

Faults stand in slots of the board memory, so a test in lock-step, a program and somebody at the command line inject
them alike, while the board runs. Only an emulated board looks there. While no slot was ever used the kernel returns at
once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from qrobot.errors import ConfigError
from qrobot.hwif.board_memory import FAULT_SLOTS, PANEL_MICRO, BoardMemory, FaultSlot
from qrobot.hwif.registers import DAC_MASK, DISCRETE_POWER, N_ENCODERS
from qrobot.realtime.atomics import load_acquire, store_release
from qrobot.realtime.jit import lean_kernel, part_kernel
from qrobot.sim_board import faults as kinds
from qrobot.sim_board.board import (
    REG_ADC_CHANNEL,
    REG_ADC_SAMPLE,
    REG_ADC_VALUE,
    REG_BRAKED,
    REG_DISCRETE,
    REG_DROPPED,
    REG_POWER,
    BoardState,
)
from qrobot.sim_board.fault_effects import (
    ADC_STUCK,
    BRAKE_CLOSED,
    BRAKE_LATE_NS,
    BRAKE_OPEN,
    DAC_GAIN,
    DAC_HOLD,
    DEAF,
    ENC_RANDOM,
    ENC_RATE_DOWN,
    ENC_RATE_UP,
    ENC_SHIFT,
    ENC_SLIP,
    ENC_STEP,
    ESTOP_PRESSED,
    IMAGE_DELAY,
    IMAGE_FROZEN,
    IMAGE_WORD,
    POT_GAIN,
    POT_NOISE,
    POT_SHIFT,
    POWER_OFF,
    PUSH,
    TOUCHED,
    to_neutral,
)
from qrobot.sim_board.faults import Fault, FaultPlan, kind_of
from qrobot.sim_board.random_lcg import uniform
from qrobot.units import NS_PER_MS, NS_PER_S

_FOREVER_NS: Final = 1 << 62
_MOVES: Final = 0.01  # counts per step; a shaft that turns less stands still
_ALL_ONES: Final = 0xFFFF


# -------------------------------------------------------------------------------------------------------- the kernel


@lean_kernel
def _upset_encoder(board: BoardState, kind: int, channel: int, value: float, first: bool) -> bool:
    """True when the channel counts other than its shaft turns."""
    knob = board.upset.knob
    step = knob[ENC_STEP, channel]
    if kind == kinds.ENC_JUMP:
        if first:
            knob[ENC_SLIP, channel] += value
        return first
    if kind == kinds.ENC_WRONG:
        knob[ENC_SHIFT, channel] += value
        return value != 0.0
    if kind == kinds.ENC_GARBAGE:
        knob[ENC_RANDOM, channel] = 1.0
        return True
    if kind == kinds.ENC_LOST:
        knob[ENC_RATE_UP, channel] = 1.0 - 1.0 / value
        return bool(step > _MOVES)
    rate = 0.0
    if kind == kinds.ENC_OFF:
        board.encoders.pulses[channel] = 0
    elif kind == kinds.ENC_REVERSED:
        rate = -1.0
    elif kind == kinds.ENC_SCALE:
        rate = value
    knob[ENC_RATE_UP, channel] = knob[ENC_RATE_DOWN, channel] = rate
    return bool(rate != 1.0 and abs(step) > _MOVES)


@lean_kernel
def _upset_index(board: BoardState, slot: FaultSlot, channel: int) -> bool:
    """True when an index pulse was swallowed or added since the last step."""
    encoders = board.encoders
    if slot.steps == 0:
        slot.note = encoders.odd[channel]
    encoders.pulses[channel] = 2 if slot.kind == kinds.INDEX_DOUBLE else 0
    happened = slot.note != encoders.odd[channel]
    slot.note = encoders.odd[channel]
    return bool(happened)


@lean_kernel
def _upset_pot(board: BoardState, kind: int, channel: int, value: float) -> bool:
    """True when the converter looks at this potentiometer."""
    knob = board.upset.knob
    if kind == kinds.POT_NOISY:
        knob[POT_NOISE, channel] = value
    elif kind == kinds.POT_DEAD:
        knob[POT_GAIN, channel] = 0.0
    else:
        knob[POT_SHIFT, channel] += value
    return bool(board.analog.pot_of[board.register[REG_ADC_CHANNEL]] == channel)


@lean_kernel
def _upset_dac(board: BoardState, slot: FaultSlot, channel: int, value: float) -> bool:
    """True when, in the step before, an amplifier under power saw another word than the one written."""
    knob, kind = board.upset.knob, slot.kind
    if slot.steps == 0:
        slot.note = board.amplified[channel]
    if kind == kinds.DAC_STUCK:
        knob[DAC_HOLD, channel] = slot.note
    elif kind == kinds.DAC_FULL:
        knob[DAC_HOLD, channel] = 0.0 if value < 0.0 else DAC_MASK
    else:
        knob[DAC_GAIN, channel] = value if kind == kinds.DAC_GAIN_OFF else 0.0
    return bool(board.register[REG_POWER] == 1 and board.amplified[channel] != board.dac[channel])


@lean_kernel
def _upset_power(board: BoardState, kind: int, first: bool) -> bool:
    """True when power was on, or would have been."""
    register = board.register
    if kind == kinds.POWER_FAILED:
        board.upset.switch[POWER_OFF] = 1
        return bool(register[REG_DISCRETE] & DISCRETE_POWER != 0)
    if first:
        register[REG_DROPPED] = 1
    return bool(first and register[REG_POWER] == 1)


@lean_kernel
def _upset_brake(board: BoardState, kind: int, channel: int, value: float) -> bool:
    """True when a brake is not what the board wants it to be."""
    register = board.register
    if kind == kinds.BRAKE_SLOW:
        board.upset.switch[BRAKE_LATE_NS] = int(value * NS_PER_MS)
        return bool(register[REG_BRAKED] == register[REG_POWER])
    if kind == kinds.BRAKE_STUCK:
        board.upset.knob[BRAKE_OPEN, channel] = 1.0
        return bool(register[REG_BRAKED] == 0)
    board.upset.knob[BRAKE_CLOSED, channel] = value
    return bool(register[REG_BRAKED] == 1)


@lean_kernel
def _upset_adc(board: BoardState) -> bool:
    """True when the converter's last sample is not what it shows."""
    board.upset.switch[ADC_STUCK] = 1
    return bool(board.register[REG_ADC_SAMPLE] != board.register[REG_ADC_VALUE])


@lean_kernel
def _upset_bus(board: BoardState, memory: BoardMemory, kind: int, value: float) -> bool:
    """True when the image differs, or operations are lost."""
    switch = board.upset.switch
    if kind == kinds.BOARD_FROZEN:
        switch[IMAGE_FROZEN] = 1
    elif kind == kinds.BOARD_SLOW:
        switch[IMAGE_DELAY] = int(value * NS_PER_MS) // max(1, memory.facts.period_ns)
        return bool(switch[IMAGE_DELAY] > 0)
    elif kind == kinds.BOARD_DEAF:
        switch[DEAF] = 1
    elif kind == kinds.BOARD_OFF:
        switch[IMAGE_WORD] = int(value)
    else:
        gone = uniform(board.upset.random) < value
        if gone:
            switch[IMAGE_WORD] = _ALL_ONES
        return gone
    return True


@lean_kernel
def _act(board: BoardState, memory: BoardMemory, slot: FaultSlot) -> bool:
    """Let the fault in the slot act in this step; True when that makes a difference."""
    kind, value = slot.kind, slot.value / PANEL_MICRO
    channel = min(max(0, slot.channel), N_ENCODERS - 1)
    first = slot.steps == 0
    component, acts = kind // 10, True
    if component == kinds.ENC_STUCK // 10:
        acts = _upset_encoder(board, kind, channel, value, first)
    elif component == kinds.INDEX_MISSING // 10:
        acts = _upset_index(board, slot, channel)
    elif component == kinds.POT_NOISY // 10:
        acts = _upset_pot(board, kind, channel, value)
    elif component == kinds.ADC_STOPPED // 10:
        acts = _upset_adc(board)
    elif component == kinds.DAC_STUCK // 10:
        acts = _upset_dac(board, slot, channel, value)
    elif component == kinds.POWER_DROP // 10:
        acts = _upset_power(board, kind, first)
    elif component == kinds.BRAKE_STUCK // 10:
        acts = _upset_brake(board, kind, channel, value)
    elif component == kinds.ESTOP_HELD // 10:
        board.upset.switch[ESTOP_PRESSED] = 1
    elif component == kinds.BOARD_OFF // 10:
        acts = _upset_bus(board, memory, kind, value)
    elif component == kinds.ARM_PUSHED // 10:
        board.upset.knob[PUSH, channel] += value
    return acts


@part_kernel
def apply_faults(board: BoardState, memory: BoardMemory, now_ns: int) -> None:
    """Turn the board's knobs to what the faults active at `now_ns` call for; first of all in a step."""
    used = min(load_acquire(memory.faults, "used"), FAULT_SLOTS)
    if used <= 0 and board.upset.switch[TOUCHED] == 0:
        return
    to_neutral(board.upset)
    board.encoders.pulses[:] = 1
    board.upset.switch[TOUCHED] = 1 if used > 0 else 0
    for place in range(used):
        slot = memory.faults.slots[place]
        if slot.start_ns <= now_ns < slot.end_ns:
            if _act(board, memory, slot):
                slot.acted += 1
            slot.steps += 1


@lean_kernel
def _open_slots(memory: BoardMemory, used: int) -> None:
    """Let the board look at so many slots from now on; their contents were written before."""
    store_release(memory.faults, "used", used)


# ----------------------------------------------------------------------------------------------------- who injects


@dataclass(frozen=True)
class Injected:
    """A fault in a board, and what came of it.

    Attributes:
        fault: as injected, less its start.
        steps: steps of the board in which it was active.
        acted: steps in which that made a difference: a stuck encoder whose shaft turned, a dead amplifier that should
            have given torque.
        over: it is past.
    """

    fault: Fault
    steps: int
    acted: int
    over: bool


class FaultPanel:
    """Entry of faults into an emulated board: `memory` is its board memory, of this process or a mapped one.

    One process at a time should inject; two that do so in the same instant may take the same slot.
    """

    def __init__(self, memory: BoardMemory) -> None:
        self._memory = memory

    def add(self, fault: Fault | str) -> int:
        """Inject a fault, or one line saying it; times count from now. Returns its place, for `report`.

        Raises:
            ConfigError: the line is none, the robot has no such joint, or all places are taken.
        """
        fault = Fault.parse(fault) if isinstance(fault, str) else fault
        memory, place = self._memory, int(self._memory.faults.used)
        if fault.joint is not None and fault.joint > memory.facts.joints:
            raise ConfigError(f"{fault}: the robot has {memory.facts.joints} joints")
        if place >= FAULT_SLOTS:
            raise ConfigError(f"{FAULT_SLOTS} faults are in the board already: clear them first")
        slot = memory.faults.slots[place]
        slot.steps = slot.acted = slot.note = 0
        slot.kind, slot.channel = fault.row.number, (fault.joint or 1) - 1
        slot.start_ns = memory.facts.now_ns + round(fault.start_s * NS_PER_S)
        lasts_ns = _FOREVER_NS if fault.duration_s is None else round(fault.duration_s * NS_PER_S)
        slot.end_ns = min(slot.start_ns + lasts_ns, _FOREVER_NS)
        slot.value = round(fault.amount * PANEL_MICRO)
        _open_slots(memory, place + 1)
        return place

    def extend(self, plan: FaultPlan) -> None:
        """Inject all faults of a plan. Raises ConfigError, as `add`."""
        for fault in plan.faults:
            self.add(fault)

    def clear(self) -> None:
        """Repair everything; counts that were lost stay lost."""
        _open_slots(self._memory, 0)

    def report(self, place: int) -> Injected:
        """Report of the fault at a place. Raises KeyError when none was injected there."""
        if not 0 <= place < self._memory.faults.used:
            raise KeyError(place)
        slot = self._memory.faults.slots[place]
        over = bool(self._memory.facts.now_ns >= slot.end_ns)
        return Injected(_fault_in(slot), int(slot.steps), int(slot.acted), over)

    def reports(self) -> list[Injected]:
        """Reports of all faults since the last `clear`, in the order they were injected."""
        in_use = min(max(int(self._memory.faults.used), 0), FAULT_SLOTS)
        return [self.report(place) for place in range(in_use)]


def _fault_in(slot: FaultSlot) -> Fault:
    """The fault a slot holds, less its start: when it was injected is not kept."""
    row = kind_of(int(slot.kind))
    lasts_ns = int(slot.end_ns - slot.start_ns)
    return Fault(
        row.component,
        row.name,
        int(slot.channel) + 1 if row.per_joint else None,
        duration_s=None if slot.end_ns == _FOREVER_NS else lasts_ns / NS_PER_S,
        value=None if row.default is None else slot.value / PANEL_MICRO,
    )
