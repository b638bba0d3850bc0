"""Setpoints of a task against the fences of its arm: an arm that were stopped now has to rest before each margin.

The stop is that of the servo: within T seconds, and over half of the way that the arm would go in that time.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from qrobot.arrays import Floats
from qrobot.fences.fence_set import SLACK_M, FenceSet
from qrobot.fences.gate import way_of_stop

STOP_SHARES: Final = (0.0, 0.5, 1.0)  # [A] of its way, at which it is looked at


def check_setpoints(
    fences: FenceSet, what: str, before: Floats, setpoints: Floats, a_stop: Floats, period_s: float
) -> None:
    """Judge positions (n,) that follow others, `before`; an arm too near already may leave, and come no nearer.

    Args:
        fences: of the arm.
        what: is asked, for people.
        before, setpoints: joint positions. Shapes (n,).
        a_stop: deceleration of a stop. Shape (n,).
        period_s: from one to the other.

    Raises:
        FenceCrossed: names fence, part of the arm and distance.
    """
    floor = np.minimum(fences.floor(before) + SLACK_M, -SLACK_M)  # each sample has its own: no creeping in
    way = way_of_stop((setpoints - before) / period_s, a_stop, period_s)
    for share in STOP_SHARES:
        fences.check(setpoints + share * way, floor, what, 1.0)
