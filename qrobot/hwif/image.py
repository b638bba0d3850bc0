"""The image of a board's inputs: time stamp, count and the sixteen input words, int64[IMAGE_WORDS].

Where an input stands follows from the register table: `image[IMAGE_STATUS]`, `image[IMAGE_ENC_COUNT + joint]`.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Words
from qrobot.hwif.registers import N_INPUT_WORDS, REGISTERS
from qrobot.realtime.jit import lean_kernel

IMAGE_T_NS: Final = 0
IMAGE_COUNT: Final = 1
IMAGE_INPUTS: Final = 2
IMAGE_WORDS: Final = IMAGE_INPUTS + N_INPUT_WORDS


@lean_kernel
def input_at(offset: int) -> int:
    """Word of an image that shows the register at byte `offset`."""
    return IMAGE_INPUTS + offset // 2


_INPUT: Final = {row.name: IMAGE_INPUTS + row.offset // 2 for row in REGISTERS}

IMAGE_ENC_INDEX: Final = _INPUT["ENC_INDEX"]  # the first of six
IMAGE_STATUS: Final = _INPUT["STATUS"]
IMAGE_ENC_COUNT: Final = _INPUT["ENC_COUNT"]  # the first of six
IMAGE_ADC_VALUE: Final = _INPUT["ADC_VALUE"]


def make_image() -> Words:
    """An image to be filled. Shape (IMAGE_WORDS,)."""
    return np.zeros(IMAGE_WORDS, np.int64)
