"""Analogue inputs of the board: a potentiometer behind each motor, free inputs, and two kinds of converter.

The potentiometer of a joint hangs on its motor through a reducer: 109 motor revolutions span 5 V [V, from the vendor's
pot table]. What the table shows beyond a straight line is slow waviness; noise is our own choice [A]:

    units = zero + slope * revolutions + wave * sin(2 pi revolutions / WAVE_LENGTH + phase) + noise * N(0, 1)

in units of the revision F converter, 20 V / 65536. Its track ends at 0 and 5 V: joint 6 of the PUMA 560 turns further
than that, and the vendor's table of it ends where the track does [V, from the vendor's pot table].
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from qrobot.hwif.board_memory import PANEL_MICRO, BoardMemory
from qrobot.hwif.registers import ADC_E_VOLT_PER_COUNT, ADC_F_MASK, ADC_F_VOLT_PER_COUNT, N_ADCS, N_ENCODERS
from qrobot.realtime.jit import lean_kernel
from qrobot.sim_board.fault_effects import POT_GAIN, POT_NOISE, POT_SHIFT, Knobs
from qrobot.sim_board.random_lcg import first_state, normal

WAVE_UNITS: Final = 20.0  # [A] amplitude; 14 rms against 11-22 in the vendor's table
WAVE_LENGTH_REVS: Final = 37.0  # [A] slow, and not a divisor of the range
NOISE_UNITS: Final = 5.0  # [A]
TRACK_UNITS: Final = 5.0 / ADC_F_VOLT_PER_COUNT  # supply of the potentiometers; the other end is at 0

_F_FULL_SCALE: Final = 32767
_E_FULL_SCALE: Final = 255


class Analog(NamedTuple):
    """Potentiometers of joints 1..n, each on its channel; the other channels are free inputs."""

    wiper: NDArray[np.float64]  # [6] position of the pot's train, motor revolutions from the encoder zero
    zero: NDArray[np.float64]  # [6] units at the encoder zero
    slope: NDArray[np.float64]  # [6] units per motor revolution in the direction of rising counts
    wave: NDArray[np.float64]  # [6] units
    wave_phase: NDArray[np.float64]  # [6] rad
    random: NDArray[np.int64]  # [1] state of the generator, 1..2^31-2
    pot_of: NDArray[np.int64]  # [8] joint whose potentiometer a channel carries, -1 for a free input
    external: NDArray[np.float64]  # [8] volts that sensors of the plant add at the free channels
    n_pots: int
    noise: float  # units
    backlash: float  # motor revolutions lost at a reversal of the pot's train


def make_analog(
    zero: NDArray[np.float64],
    slope: float | NDArray[np.float64],
    seed: int,
    noise: float = NOISE_UNITS,
    wave: float = WAVE_UNITS,
    backlash: float = 0.0,
    channels: NDArray[np.int64] | None = None,
) -> Analog:
    """Potentiometers with the given readings at encoder zero, on the given channels or on 0 and above.

    `slope` is what they rise by in a turn of rising counts, all alike or each. The seed draws their waviness
    and all later noise.
    """
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * math.pi, N_ENCODERS)
    zeros, slopes, waves = np.zeros(N_ENCODERS), np.zeros(N_ENCODERS), np.full(N_ENCODERS, wave)
    zeros[: zero.size], slopes[: zero.size] = zero, slope
    state = first_state(seed)
    pot_of = np.full(N_ADCS, -1, dtype=np.int64)
    pot_of[np.arange(zero.size) if channels is None else channels[: zero.size]] = np.arange(zero.size)
    wiper, external = np.zeros(N_ENCODERS), np.zeros(N_ADCS)
    return Analog(wiper, zeros, slopes, waves, phases, state, pot_of, external, zero.size, noise, backlash)


@lean_kernel
def turn_wipers(analog: Analog, shaft: NDArray[np.float64], counts_per_rev: NDArray[np.int64]) -> None:
    """Drag the pots' trains along with their motors, at `shaft` counts, through the backlash."""
    wiper, slack = analog.wiper, 0.5 * analog.backlash
    for joint in range(analog.n_pots):
        revolutions = shaft[joint] / counts_per_rev[joint]
        wiper[joint] = min(max(wiper[joint], revolutions - slack), revolutions + slack)


@lean_kernel
def pot_units(analog: Analog, knob: Knobs, joint: int) -> float:
    """Reading of a potentiometer now, converter units of revision F before rounding; draws fresh noise."""
    turns = analog.wiper[joint]
    wave = math.sin(2.0 * math.pi * turns / WAVE_LENGTH_REVS + analog.wave_phase[joint])
    smooth = analog.zero[joint] + analog.slope[joint] * turns + analog.wave[joint] * wave
    smooth = min(max(smooth, 0.0), TRACK_UNITS)
    noise = knob[POT_NOISE, joint] * analog.noise * normal(analog.random)
    return float(knob[POT_GAIN, joint] * (smooth + noise))


@lean_kernel
def input_volts(analog: Analog, memory: BoardMemory, knob: Knobs, channel: int) -> float:
    """Voltage at ADC channel 0..7: a potentiometer, or what panel and sensors set at a free channel."""
    joint = analog.pot_of[channel]
    if joint >= 0:
        return float(pot_units(analog, knob, joint) * ADC_F_VOLT_PER_COUNT + knob[POT_SHIFT, joint])
    return float(memory.panel.analog[channel] / PANEL_MICRO + analog.external[channel])


@lean_kernel
def convert_f(volts: float) -> int:
    """Revision F: 12 bits of +-10 V, left-justified in a two's complement 16-bit word [V]."""
    rounded = math.floor(volts / ADC_F_VOLT_PER_COUNT / 16.0 + 0.5) * 16
    return int(min(max(rounded, -_F_FULL_SCALE - 1), _F_FULL_SCALE)) & ADC_F_MASK


@lean_kernel
def convert_e(volts: float) -> int:
    """Revision E and before: 8 bits of 0-5 V [V]."""
    return int(min(max(math.floor(volts / ADC_E_VOLT_PER_COUNT + 0.5), 0), _E_FULL_SCALE))
