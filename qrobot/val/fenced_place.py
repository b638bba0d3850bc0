"""A place of a program against the fences of the arm, before anything moves."""

from __future__ import annotations

import numpy as np

from qrobot.errors import FenceCrossed
from qrobot.fences.fence_set import SLACK_M, FenceSet
from qrobot.val.values import JointLocation, Transformation
from qrobot.val.workspace import Workspace


def fence_refusal(fences: FenceSet, space: Workspace, place: Transformation | JointLocation, word: str) -> str:
    """Reason against a motion to a place that the arm reaches, whatever its configuration; "" for none."""
    why, floor = "", np.full_like(fences.margins, -SLACK_M)
    for q in space.ways_to(place):
        try:
            fences.check(q, floor, word, 1.0)
        except FenceCrossed as error:
            why = why or str(error)
        else:
            return ""
    return why
