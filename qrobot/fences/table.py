"""An arm's body and its fences as one table of numbers, which every kernel takes as it is.

Its size is the same for every arm, so that nothing is compiled anew for another number of fences.

    words     what
    HEAD      number of joints, capsules, shapes, pairs; margin of the pairs; all but the last whole numbers
    CHAIN     for each joint cos and sin of alpha, a, d, theta, 1 where it slides
    CAPSULES  for each capsule its link, both ends, radius, 1 where it is of the tool
    SHAPES    for each shape its kind, 1 to stay inside, bodies, margin, sizes, axes and middle in the base frame
    PAIRS     for each pair of capsules that keep apart their numbers
"""

from __future__ import annotations

from typing import Final

from qrobot.config.fences import MOST_SHAPES
from qrobot.config.shape import MOST_CAPSULES

MOST_JOINTS: Final = 16
MOST_PAIRS: Final = MOST_CAPSULES * (MOST_CAPSULES - 1) // 2

HEAD, N_JOINTS, N_CAPSULES, N_SHAPES, N_PAIRS, PAIR_MARGIN, HEAD_WORDS = 0, 0, 1, 2, 3, 4, 8
CHAIN: Final = HEAD_WORDS
CHAIN_WORDS: Final = 6
CAPSULES: Final = CHAIN + CHAIN_WORDS * MOST_JOINTS
CAPSULE_WORDS: Final = 9  # link, ends, radius, tool
SHAPES: Final = CAPSULES + CAPSULE_WORDS * MOST_CAPSULES
SHAPE_WORDS: Final = 19  # kind, inside, bodies, margin, 3 sizes, 9 axes, 3 of the middle
PAIRS: Final = SHAPES + SHAPE_WORDS * MOST_SHAPES
N_WORDS: Final = PAIRS + 2 * MOST_PAIRS

LINKS, TOOL = 1, 2  # bits of the bodies of a shape
N_ROWS: Final = MOST_SHAPES + 1  # a distance for each shape, and behind the last one that of the pairs
N_WORK: Final = 6 * MOST_CAPSULES  # both ends of each capsule in the base frame
