"""The servo's side of the board's one converter: a channel at a time, round robin, without ever waiting.

A cycle posts the vendor's sequence (TRC004 vendor driver v4.3) as register operations and looks for the result in the
images of later cycles:

    revision F    done mask 0, 1;  ADC_MUX = (channel << 7) | 0x50;  STATUS bit 14 falls;  ADC_VALUE & 0xFFF0
    revision E    done mask 0;  ADC_MUX = channel;  read ADC_START;  done mask 1;  STATUS bit 14 falls;  low byte

Mask 0 presets the done flag, so the flag of the last conversion is never taken for that of this one, once the image
shows what the operations did. The first image of which that is certain is the second one after they were posted: its
sampling began when they were there. One conversion takes two images, or one cycle of a servo slower than that.

Images are counted from the one that the board shows when the operations are posted, not from the one that the cycle has
seen: a machine may stall in between. And an image that an emulated board makes up after a stall is as old as it says.
Behind a gateway they are counted by exchanges (`hwif.gateway`), from the one that is under way, if any. Index latches
that a cycle arms (`Awaited`) are judged by the same rule: the flag of one that nobody waits for looks like a pulse.

The vendor's driver polls without end. Here a conversion that is not done in `patience` cycles is given up and counted,
and its channel reads NaN until one succeeds: a law that needs it stops the arm (LAW_NAN), the others go on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from qrobot.hwif.image import IMAGE_ADC_VALUE, IMAGE_COUNT, IMAGE_STATUS
from qrobot.hwif.operations import put_read, put_write
from qrobot.hwif.registers import (
    ADC_E_VOLT_PER_COUNT,
    ADC_F_CHANNEL_SHIFT,
    ADC_F_COMMAND,
    ADC_F_MASK,
    ADC_F_VOLT_PER_COUNT,
    ADC_MUX,
    ADC_START,
    DISCRETE,
    DISCRETE_ADC,
    N_ADCS,
    STATUS_ADC_BUSY,
)
from qrobot.model.transmission import signed_word
from qrobot.realtime.jit import lean_kernel
from qrobot.servo.kernels.awaited import NOT_NOTED

REVISION_E: Final = ord("E")  # as the board says it; whatever else stands there is read as revision F
IMAGES_TO_ANSWER: Final = 2


@dataclass(eq=False)
class AdcState:
    """State of the sampling from cycle to cycle."""

    done: Any  # int64[8] conversions of each channel so far
    lost: Any  # int64[8] those that were given up
    channel: int = N_ADCS - 1  # being converted, or the one before
    busy: int = 0  # 1 while a conversion is under way
    answer_at: int = 0  # count of the first image that can answer
    posted_ns: int = 0  # when its operations were posted: an image taken before cannot answer
    waited: int = 0  # cycles this conversion has taken
    timeouts: int = 0  # conversions given up
    begun: int = 0  # conversions so far, answered or not
    newest: int = 0  # count of the newest image when the last cycle posted, see `board_memory.newest_count`
    noted_ns: int = 0  # and when that was


def make_adc_state() -> AdcState:
    """State before the first sample; the first conversion is that of the lowest channel wanted."""
    return AdcState(np.zeros(N_ADCS, dtype=np.int64), np.zeros(N_ADCS, dtype=np.int64))


@lean_kernel
def collect_sample(adc: Any, sensors: Any, image: Any, taken_ns: int, revision: int, patience: int) -> int:
    """Take the conversion under way out of the newest image, or give it up after `patience` cycles.

    Args:
        adc: `AdcState`. sensors: volts of the channels, float64[8] (out). image: int64[IMAGE_WORDS].
        taken_ns: when it was taken.
        revision: the board's, as it says it: ord("E") or ord("F").

    Returns:
        The channel that has a new value, or -1.
    """
    if adc.busy == 0:
        return -1
    adc.waited += 1
    channel = adc.channel
    answered = image[IMAGE_COUNT] >= adc.answer_at and taken_ns > adc.posted_ns
    if answered and image[IMAGE_STATUS] & STATUS_ADC_BUSY == 0:
        sensors[channel] = code_volts(image[IMAGE_ADC_VALUE], revision)
        adc.done[channel] += 1
        adc.busy = 0
        return int(channel)
    if adc.waited > patience:
        sensors[channel] = math.nan
        adc.timeouts += 1
        adc.lost[channel] += 1
        adc.busy = 0
    return -1


@lean_kernel
def code_volts(code: int, revision: int) -> float:
    """Volts of an ADC_VALUE word: 12 bits of +-10 V left-justified (revision F), 8 bits of 0-5 V (revision E)."""
    if revision == REVISION_E:
        return float((code & 0xFF) * ADC_E_VOLT_PER_COUNT)
    return float(signed_word(code & ADC_F_MASK) * ADC_F_VOLT_PER_COUNT)


@lean_kernel
def start_sample(adc: Any, ops: Any, n: int, word: int, wanted: int, count: int, revision: int) -> int:
    """Post the conversion of the next channel wanted, unless one is under way; returns the new number of operations.

    Args:
        adc: `AdcState`. ops: list of operations with `n` in it. word: DISCRETE as it is to stand, done mask set.
        wanted: bit per channel, not 0. count: count of the newest image.
    """
    if adc.busy != 0:
        return n
    channel = next_channel(adc.channel, wanted)
    adc.channel, adc.busy, adc.waited = channel, 1, 0
    adc.begun += 1
    adc.answer_at = count + IMAGES_TO_ANSWER
    n = put_write(ops, n, DISCRETE, word & ~DISCRETE_ADC)
    if revision == REVISION_E:
        n = put_write(ops, n, ADC_MUX, channel)
        n = put_read(ops, n, ADC_START)
        return put_write(ops, n, DISCRETE, word)
    n = put_write(ops, n, DISCRETE, word)
    return put_write(ops, n, ADC_MUX, channel << ADC_F_CHANNEL_SHIFT | ADC_F_COMMAND)


@lean_kernel
def note_post(adc: Any, count: int, now_ns: int) -> None:
    """Take note that a cycle, with the conversion that begins in it, is posted while image `count` is the newest."""
    adc.newest, adc.noted_ns = count, now_ns
    if adc.busy != 0 and adc.waited == 0:
        adc.answer_at = max(adc.answer_at, count + IMAGES_TO_ANSWER)
        adc.posted_ns = now_ns


@lean_kernel
def await_answer(awaited: Any) -> None:
    """Wait for the answer to something that this cycle posts."""
    awaited.answer_at = NOT_NOTED


@lean_kernel
def is_answered(awaited: Any, adc: Any, image: Any, taken_ns: int) -> bool:
    """True of an image that shows what was posted, in a cycle after it.

    Args:
        awaited: `Awaited`. adc: `AdcState`, which knows when the last cycle posted. taken_ns: when the image was taken.
    """
    if awaited.answer_at == NOT_NOTED:
        awaited.answer_at, awaited.posted_ns = adc.newest + IMAGES_TO_ANSWER, adc.noted_ns
    return bool(image[IMAGE_COUNT] >= awaited.answer_at and taken_ns > awaited.posted_ns)


@lean_kernel
def next_channel(channel: int, wanted: int) -> int:
    """The channel after `channel`, round robin, whose bit is set in `wanted`."""
    for step in range(1, N_ADCS + 1):
        candidate = (channel + step) % N_ADCS
        if wanted >> candidate & 1:
            return candidate
    return channel
