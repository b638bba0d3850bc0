"""Effects of faults on the board: knobs and switches that leave everything as it is while they are at neutral.

The board's kernels read them at every step, fault or no fault, so a healthy board and a sick one are the same code.
Who turns them is `injection`; what an encoder fault does is the same for all of them: of each step of its shaft a
channel counts a share, and what it did not count is lost for good, as with a real cable.

    counted = shaft + slip + shift,    slip <- slip + (rate - 1) step,    rate per direction
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from qrobot.arrays import Words
from qrobot.hwif.board_memory import HISTORY_IMAGES, BoardMemory
from qrobot.hwif.image import IMAGE_ENC_COUNT, IMAGE_INPUTS, IMAGE_WORDS
from qrobot.hwif.registers import DAC_ZERO, N_DACS, N_ENCODERS, N_INPUT_WORDS
from qrobot.realtime.jit import lean_kernel
from qrobot.sim_board.random_lcg import first_state, uniform

Knobs = NDArray[np.float64]
N_CHANNELS: Final = 8  # as many as the DACs; encoders and brakes use the first six

# Rows of `Upset.knob`, one value per channel; the first N_RESET return to neutral before every step.
(
    ENC_RATE_UP,  # share of a rising step that is counted
    ENC_RATE_DOWN,
    ENC_SHIFT,  # counts added
    ENC_RANDOM,  # 1: the counter's word is random
    POT_NOISE,  # factor on the noise
    POT_GAIN,
    POT_SHIFT,  # V
    DAC_GAIN,  # share of the torque asked for that the amplifier gives
    DAC_HOLD,  # word the amplifier sees whatever is written, or _WRITTEN
    BRAKE_OPEN,  # share of its holding torque an open brake keeps
    BRAKE_CLOSED,  # share of its holding torque a closed brake has
    PUSH,  # N.m or N on the joint
    N_RESET,
) = range(13)
# State of the encoders' shafts, counts: what went uncounted, where they stood at the last sample, and their last step.
ENC_SLIP, ENC_TURNED, ENC_STEP, N_KNOBS = range(N_RESET, N_RESET + 4)

# Words of `Upset.switch`; the first N_SWITCHES_RESET return to neutral before every step.
(
    POWER_OFF,  # 1: amplifiers cannot be on
    ESTOP_PRESSED,
    BRAKE_LATE_NS,
    ADC_STUCK,
    DEAF,  # 1: operations are lost
    IMAGE_FROZEN,
    IMAGE_WORD,  # what every input word reads, or _WRITTEN
    IMAGE_DELAY,  # images
    N_SWITCHES_RESET,
) = range(9)
DELAYED, TOUCHED, N_SWITCHES = range(N_SWITCHES_RESET, N_SWITCHES_RESET + 3)

_WRITTEN: Final = -1
_KNOB_NEUTRAL: Final = np.array([1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 1.0, _WRITTEN, 0.0, 1.0, 0.0])
_SWITCH_NEUTRAL: Final = np.array([0, 0, 0, 0, 0, 0, _WRITTEN, 0])


class Upset(NamedTuple):
    """State of all faults of one board."""

    knob: Knobs  # [N_KNOBS, N_CHANNELS]
    switch: NDArray[np.int64]  # [N_SWITCHES]
    random: NDArray[np.int64]  # [1] state of the generator


def make_upset(seed: int = 0) -> Upset:
    """Everything at neutral."""
    upset = Upset(np.zeros((N_KNOBS, N_CHANNELS)), np.zeros(N_SWITCHES, np.int64), first_state(seed))
    to_neutral(upset)
    return upset


@lean_kernel
def to_neutral(upset: Upset) -> None:
    """Set every knob as if there were no fault; counts that were lost stay lost."""
    for row in range(N_RESET):
        for channel in range(N_CHANNELS):
            upset.knob[row, channel] = _KNOB_NEUTRAL[row]
    for word in range(N_SWITCHES_RESET):
        upset.switch[word] = _SWITCH_NEUTRAL[word]


@lean_kernel
def turn_counters(knob: Knobs, shaft: NDArray[np.float64], counted: NDArray[np.float64]) -> None:
    """Count the shafts at `shaft`, counts, as faulty encoders do; `counted` is the output. Shapes (6,)."""
    for channel in range(N_ENCODERS):
        step = shaft[channel] - knob[ENC_TURNED, channel]
        rate = knob[ENC_RATE_UP, channel] if step > 0.0 else knob[ENC_RATE_DOWN, channel]
        knob[ENC_SLIP, channel] += (rate - 1.0) * step
        knob[ENC_TURNED, channel], knob[ENC_STEP, channel] = shaft[channel], step
        counted[channel] = shaft[channel] + knob[ENC_SLIP, channel] + knob[ENC_SHIFT, channel]


@lean_kernel
def settle_amplifiers(knob: Knobs, dac: NDArray[np.int64], output: NDArray[np.int64]) -> None:
    """The words the amplifiers see, from those written. Shapes (8,)."""
    for channel in range(N_DACS):
        given = knob[DAC_GAIN, channel] * (dac[channel] - DAC_ZERO)
        hold = knob[DAC_HOLD, channel]
        output[channel] = DAC_ZERO + math.floor(given + 0.5) if hold == _WRITTEN else int(hold)


@lean_kernel
def settle_brakes(knob: Knobs, closed: int, brake: NDArray[np.float64]) -> None:
    """Share of its holding torque each brake has. Shape (6,)."""
    for joint in range(N_ENCODERS):
        brake[joint] = knob[BRAKE_CLOSED, joint] if closed else knob[BRAKE_OPEN, joint]


@lean_kernel
def spoil_image(upset: Upset, memory: BoardMemory, image: NDArray[np.int64]) -> bool:
    """Make of the image (int64[IMAGE_WORDS]) what a controller gets to see; False when it sees nothing new."""
    knob, switch = upset.knob, upset.switch
    if switch[TOUCHED] == 0:
        return True
    for channel in range(N_ENCODERS):
        if knob[ENC_RANDOM, channel] != 0.0:
            image[IMAGE_ENC_COUNT + channel] = int(uniform(upset.random) * 0x10000)
    if switch[IMAGE_WORD] != _WRITTEN:
        for word in range(N_INPUT_WORDS):
            image[IMAGE_INPUTS + word] = switch[IMAGE_WORD]
    _delay(upset.switch, memory, image)
    return bool(switch[IMAGE_FROZEN] == 0)


@lean_kernel
def _delay(switch: Words, memory: BoardMemory, image: NDArray[np.int64]) -> None:
    """Replace the image by an older one; by the first one kept while there is none of that age."""
    if switch[IMAGE_DELAY] == 0:
        switch[DELAYED] = 0
        return
    newest = switch[DELAYED]
    oldest = max(0, newest - min(switch[IMAGE_DELAY], HISTORY_IMAGES - 1))
    for word in range(IMAGE_WORDS):
        memory.history[newest % HISTORY_IMAGES, word] = image[word]
        image[word] = memory.history[oldest % HISTORY_IMAGES, word]
    switch[DELAYED] = newest + 1
