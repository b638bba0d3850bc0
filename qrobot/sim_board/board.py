"""The TRC004's actions on its registers, as two kernels of which a board's tick is made.

`accept_operations` applies what controllers posted, strictly in order, and decides about power and brakes;
`publish_sample` takes the shafts' positions, runs encoders and converter, and publishes the input words; `take_sample`
is all of that but the last. Time is an argument; nothing here knows of motors or of who posts.

Tags as in `hwif.registers`: [V] the vendor's driver, [I] inferred from its sequences, [A] our choice.

* DACs keep their last word: the board has no watchdog. `BoardOptions.watchdog_ns` adds one (our extension, off).
* A flip-flop in STATUS (index seen, conversion done) is preset to 1 while its DISCRETE mask bit is 0, armed by mask
  bit 1, and dropped to 0 by its event [V]. An event while the mask is 0 is lost: on revision E the mask is set after
  the conversion was started, in the same burst of operations [V].
* What STATUS shows of a flip-flop while its mask bit is 0 no source tells: `BoardOptions.adc_idle` and `index_idle`.
  The vendor's driver shifts bits 15 and 14 of a cold board into its own scratch bits, and takes itself for calibrated
  where bit 14 is 1 [V]; so the default is 0, on which it works [A].
* Power is on while DISCRETE bit 0 is set, the emergency stop is healthy, and ARM POWER was pressed after the bit was
  set; whatever drops it has to be followed by a new press [I].
* Brakes are fail-safe: they release some time after power came on and engage some time after it dropped.
* Counters, latches and the CALIB and J6 overflow bits live here, not in the host: they survive its death [I].
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Words
from qrobot.hwif.board_memory import LANE_CAPACITY, N_LANES, BoardMemory, publish_image
from qrobot.hwif.image import (
    IMAGE_ADC_VALUE,
    IMAGE_COUNT,
    IMAGE_ENC_COUNT,
    IMAGE_ENC_INDEX,
    IMAGE_STATUS,
    IMAGE_T_NS,
    make_image,
)
from qrobot.hwif.lanes import operation_is_early, take_operation
from qrobot.hwif.operations import ALL_ANALOG, OP_ANALOG, OP_FIELDS, OP_OUTPUTS, OP_READ, OP_WRITE, signed_microvolts
from qrobot.hwif.registers import (
    ADC_F_CHANNEL_SHIFT,
    ADC_MUX,
    ADC_START,
    DAC,
    DAC_MASK,
    DAC_ZERO,
    DISCRETE,
    DISCRETE_POWER,
    ENC_LOAD,
    INDEX_BIT_0,
    N_DACS,
    N_ENCODERS,
    SCRATCH_BITS,
    STATUS_ADC_BUSY,
    STATUS_ESTOP_OK,
    STATUS_INDEX,
    STATUS_INPUTS,
    STATUS_POWER,
    WINDOW_BYTES,
)
from qrobot.hwif.trace import trace_write
from qrobot.realtime.atomics import load_acquire
from qrobot.realtime.jit import lean_kernel, part_kernel
from qrobot.sim_board.analog import Analog, convert_e, convert_f, input_volts, turn_wipers
from qrobot.sim_board.encoder import COUNTER_MASK, Encoders, sample_encoders
from qrobot.sim_board.fault_effects import (
    ADC_STUCK,
    BRAKE_LATE_NS,
    DEAF,
    ESTOP_PRESSED,
    POWER_OFF,
    Upset,
    make_upset,
    settle_amplifiers,
    settle_brakes,
    spoil_image,
    turn_counters,
)

CONVERSION_NS: Final = 20_000  # [A] longer than one I/O cycle, as the revision E sequence needs
BRAKE_RELEASE_NS: Final = 30_000_000  # [A]
BRAKE_ENGAGE_NS: Final = 20_000_000  # [A]

# STATUS flip-flops; their masks in DISCRETE are the same bits [V].
FLIP_FLOPS: Final = STATUS_INDEX | STATUS_ADC_BUSY
_ADC_F_CONVERT: Final = 0x40  # SWCONV bit of the AD7891's control word
_WORD: Final = 0xFFFF

# Words of `BoardState.register`.
REG_DISCRETE, REG_FLAGS, REG_POWER, REG_PRESSED, REG_PRESSES, REG_ESTOP_OK, REG_BRAKED, REG_SWITCHED_NS = range(8)
REG_ADC_CHANNEL, REG_ADC_SAMPLE, REG_ADC_DONE_NS, REG_ADC_VALUE, REG_COUNT, REG_WRITTEN_NS, REG_DROPPED = range(8, 15)
N_REGISTERS: Final = 15
_ADC_IDLE: Final = -1


class BoardOptions(NamedTuple):
    """Options in which boards differ, and those that no source tells."""

    revision_f: bool = True
    relatch: bool = True  # a further index pulse replaces the latched count
    adc_idle: bool = False  # level of STATUS bit 14 while its mask is 0
    index_idle: bool = False  # level of STATUS bits 8-13 while their masks are 0
    auto_panel: bool = True  # somebody presses ARM POWER whenever the host enables power
    conversion_ns: int = CONVERSION_NS
    brake_release_ns: int = BRAKE_RELEASE_NS
    brake_engage_ns: int = BRAKE_ENGAGE_NS
    watchdog_ns: int = 0  # without a write for this long all DACs go to zero torque; 0: no watchdog, as on the TRC004


class BoardState(NamedTuple):
    """State of the board's chips."""

    encoders: Encoders
    analog: Analog
    upset: Upset  # what faults make of it
    dac: NDArray[np.int64]  # [8] 12-bit words, as written
    amplified: NDArray[np.int64]  # [8] the words the amplifiers see
    brake: NDArray[np.float64]  # [6] share of its holding torque each brake has: 0 open, 1 closed
    counted: NDArray[np.float64]  # [6] shaft positions as the encoders have them
    register: NDArray[np.int64]  # [N_REGISTERS]
    image: NDArray[np.int64]  # [IMAGE_WORDS] scratch
    operation: NDArray[np.int64]  # [OP_FIELDS] scratch
    options: BoardOptions


def make_board(encoders: Encoders, analog: Analog, options: BoardOptions, seed: int = 0) -> BoardState:
    """A board just powered up: zero torque, everything off, brakes closed, not calibrated. The seed is its faults'."""
    register = np.zeros(N_REGISTERS, np.int64)
    register[REG_FLAGS] = FLIP_FLOPS
    register[REG_BRAKED] = 1
    register[REG_ESTOP_OK] = 1
    register[REG_ADC_DONE_NS] = _ADC_IDLE
    dac = np.full(N_DACS, DAC_ZERO, np.int64)
    return BoardState(
        encoders=encoders,
        analog=analog,
        upset=make_upset(seed),
        dac=dac,
        amplified=dac.copy(),
        brake=np.ones(N_ENCODERS),
        counted=np.zeros(N_ENCODERS),
        register=register,
        image=make_image(),
        operation=np.zeros(OP_FIELDS, np.int64),
        options=options,
    )


@lean_kernel
def _write_discrete(board: BoardState, value: int) -> None:
    """Latch the word; a mask bit at 0 presets its flip-flop, and power enable at 0 drops power."""
    register = board.register
    risen = value & ~register[REG_DISCRETE]
    register[REG_DISCRETE] = value & _WORD
    register[REG_FLAGS] |= ~value & FLIP_FLOPS
    if not value & DISCRETE_POWER:
        register[REG_DROPPED] = 1
        register[REG_PRESSED] = 0
    elif board.options.auto_panel and risen & DISCRETE_POWER:
        register[REG_PRESSED] = 1


@lean_kernel
def _start_conversion(board: BoardState, memory: BoardMemory, t_ns: int) -> None:
    """Sample the selected channel; its code shows `conversion_ns` later."""
    register = board.register
    volts = input_volts(board.analog, memory, board.upset.knob, register[REG_ADC_CHANNEL])
    register[REG_ADC_SAMPLE] = convert_f(volts) if board.options.revision_f else convert_e(volts)
    register[REG_ADC_DONE_NS] = t_ns + board.options.conversion_ns


@lean_kernel
def _write_mux(board: BoardState, memory: BoardMemory, value: int, t_ns: int) -> None:
    """Revision F: channel and start bit in one word; revision E: the channel only."""
    if board.options.revision_f:
        board.register[REG_ADC_CHANNEL] = value >> ADC_F_CHANNEL_SHIFT & 7
        if value & _ADC_F_CONVERT:
            _start_conversion(board, memory, t_ns)
    else:
        board.register[REG_ADC_CHANNEL] = value & 7


@lean_kernel
def _write(board: BoardState, memory: BoardMemory, offset: int, value: int, t_ns: int) -> None:
    """A legal write: 0x20-0x3E."""
    if offset >= DAC:
        board.dac[(offset - DAC) // 2] = value & DAC_MASK
    elif offset == DISCRETE:
        _write_discrete(board, value)
    elif offset == ADC_MUX:
        _write_mux(board, memory, value, t_ns)
    else:
        board.encoders.counter[(offset - ENC_LOAD) // 2] = value & COUNTER_MASK


@lean_kernel
def _apply(board: BoardState, memory: BoardMemory, lane: int, t_ns: int) -> None:
    """Apply `board.operation`; one on an offset of the wrong direction is ignored and counted [A]."""
    kind, offset, value = board.operation[0], board.operation[1], board.operation[2]
    even = offset % 2 == 0
    if kind == OP_WRITE and even and ENC_LOAD <= offset < WINDOW_BYTES:
        _write(board, memory, offset, value, t_ns)
        board.register[REG_WRITTEN_NS] = t_ns
        trace_write(memory, t_ns, lane, offset, value)
    elif kind == OP_READ and even and 0 <= offset < ENC_LOAD:
        if offset == ADC_START and not board.options.revision_f:
            _start_conversion(board, memory, t_ns)
    elif kind == OP_OUTPUTS:
        memory.panel.outputs = value & _WORD
    elif kind == OP_ANALOG and 0 <= offset <= ALL_ANALOG:
        _show_analog(memory, offset, value)
    else:
        memory.facts.illegal_ops += 1


@lean_kernel
def _show_analog(memory: BoardMemory, output: int, value: int) -> None:
    """Let the panel show an analogue output, or all of them off."""
    if output == ALL_ANALOG:
        memory.panel.analog_told = 0
    else:
        memory.panel.analog_outputs[output] = signed_microvolts(value)
        memory.panel.analog_told |= 1 << output


@lean_kernel
def _watch(register: Words, dac: Words, watchdog_ns: int, t_ns: int) -> None:
    """The optional watchdog."""
    if 0 < watchdog_ns < t_ns - register[REG_WRITTEN_NS]:
        dac[:] = DAC_ZERO


@lean_kernel
def _update_power(register: Words, switch: Words, options: BoardOptions, memory: BoardMemory, t_ns: int) -> None:
    """Arm power from enable bit, panel and emergency stop; brakes follow with their delays."""
    presses = load_acquire(memory.panel, "presses")
    pressed = register[REG_PRESSED] == 1 or presses != register[REG_PRESSES]
    register[REG_ESTOP_OK] = 1 if load_acquire(memory.panel, "estop") == 0 and switch[ESTOP_PRESSED] == 0 else 0
    healthy = register[REG_ESTOP_OK] == 1 and switch[POWER_OFF] == 0
    allowed = healthy and register[REG_DISCRETE] & DISCRETE_POWER != 0
    kept = register[REG_POWER] == 1 and register[REG_DROPPED] == 0
    power = 1 if allowed and (kept or pressed) else 0
    if power != register[REG_POWER]:
        register[REG_SWITCHED_NS] = t_ns
    register[REG_POWER], register[REG_PRESSES], register[REG_PRESSED], register[REG_DROPPED] = power, presses, 0, 0
    delay_ns = options.brake_release_ns if power else options.brake_engage_ns
    if register[REG_BRAKED] == power and t_ns - register[REG_SWITCHED_NS] >= delay_ns + switch[BRAKE_LATE_NS]:
        register[REG_BRAKED] = 1 - power


@part_kernel
def accept_operations(board: BoardState, memory: BoardMemory, t_ns: int) -> None:
    """Apply what was posted for times up to board time `t_ns`, lane by lane in order; then settle power and brakes."""
    for lane in range(N_LANES):
        for _ in range(LANE_CAPACITY):
            if operation_is_early(memory, lane, t_ns) or not take_operation(memory, lane, board.operation):
                break
            if board.upset.switch[DEAF] == 0:
                _apply(board, memory, lane, t_ns)
    memory.panel.discrete = board.register[REG_DISCRETE]
    _watch(board.register, board.dac, board.options.watchdog_ns, t_ns)
    _update_power(board.register, board.upset.switch, board.options, memory, t_ns)
    settle_amplifiers(board.upset.knob, board.dac, board.amplified)
    settle_brakes(board.upset.knob, board.register[REG_BRAKED], board.brake)


@lean_kernel
def _count(board: BoardState, shaft: NDArray[np.float64]) -> None:
    """Move the encoders to the shafts' positions; an index latched drops its flip-flop."""
    register = board.register
    armed = register[REG_DISCRETE] & STATUS_INDEX
    pending = armed & register[REG_FLAGS]
    repeated = armed if board.options.relatch else 0
    turn_counters(board.upset.knob, shaft, board.counted)
    latched = sample_encoders(board.encoders, shaft, board.counted, pending // INDEX_BIT_0, repeated // INDEX_BIT_0)
    register[REG_FLAGS] &= ~(latched * INDEX_BIT_0)
    turn_wipers(board.analog, shaft, board.encoders.counts_per_rev)


@lean_kernel
def _finish_conversion(register: Words, switch: Words, t_ns: int) -> None:
    """Show the code when its time has come; the done flip-flop drops when it is armed."""
    if register[REG_ADC_DONE_NS] == _ADC_IDLE or t_ns < register[REG_ADC_DONE_NS]:
        return
    if switch[ADC_STUCK] == 0:
        register[REG_ADC_VALUE] = register[REG_ADC_SAMPLE]
    register[REG_ADC_DONE_NS] = _ADC_IDLE
    register[REG_FLAGS] &= ~(register[REG_DISCRETE] & STATUS_ADC_BUSY)


@lean_kernel
def _status(register: Words, options: BoardOptions, memory: BoardMemory) -> int:
    """The STATUS word: of each flip-flop its state where it is unmasked, its idle level where it is masked."""
    unmasked = register[REG_DISCRETE] & FLIP_FLOPS
    idle = (STATUS_ADC_BUSY if options.adc_idle else 0) | (STATUS_INDEX if options.index_idle else 0)
    flags = register[REG_FLAGS] & unmasked | idle & ~unmasked
    inputs = memory.panel.inputs & STATUS_INPUTS & ~STATUS_ESTOP_OK
    estop = STATUS_ESTOP_OK if register[REG_ESTOP_OK] else 0
    power = STATUS_POWER if register[REG_POWER] else 0
    return int(power | flags | register[REG_DISCRETE] & SCRATCH_BITS | inputs | estop)


@lean_kernel
def publish_sample(board: BoardState, memory: BoardMemory, shaft: NDArray[np.float64], t_ns: int) -> None:
    """Sample the shafts (float64[6], counts from the encoder zero) at `t_ns` and publish the sixteen input words."""
    if take_sample(board, memory, shaft, t_ns):
        publish_image(memory, board.image)


@part_kernel
def take_sample(board: BoardState, memory: BoardMemory, shaft: NDArray[np.float64], t_ns: int) -> bool:
    """Sample the shafts into the sixteen input words; whether the board shows them."""
    _count(board, shaft)
    _finish_conversion(board.register, board.upset.switch, t_ns)
    image, register, latch, counter = board.image, board.register, board.encoders.latch, board.encoders.counter
    register[REG_COUNT] += 1
    image[IMAGE_T_NS], image[IMAGE_COUNT] = t_ns, register[REG_COUNT]
    for channel in range(N_ENCODERS):
        image[IMAGE_ENC_INDEX + channel] = latch[channel]
        image[IMAGE_ENC_COUNT + channel] = counter[channel]
    image[IMAGE_STATUS] = _status(register, board.options, memory)
    image[IMAGE_ADC_VALUE] = register[REG_ADC_VALUE]
    return spoil_image(board.upset, memory, image)
