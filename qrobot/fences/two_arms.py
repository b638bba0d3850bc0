"""Distance of two arms that stand side by side, from their capsules."""

from __future__ import annotations

import math

import numpy as np

from qrobot.arrays import Floats
from qrobot.config.fences import Stand
from qrobot.fences.clearance import end_of, place_capsules, radius_of
from qrobot.fences.distance import axes_apart
from qrobot.fences.fence_set import FenceSet
from qrobot.fences.table import CAPSULE_WORDS, CAPSULES, N_CAPSULES, N_WORK
from qrobot.model.transform import inverse, rpy, transform
from qrobot.model.vec3 import Vec
from qrobot.realtime.jit import lean_kernel
from qrobot.units import RAD_PER_DEG


@lean_kernel
def arms_apart(words: Floats, work: Floats, others: Floats, other_work: Floats, pose: Floats) -> float:
    """Distance of two arms whose capsules are placed, m; below zero where they overlap. Their bases stand still.

    Args:
        words, work: of one arm, see `fences.clearance.place_capsules`. others, other_work: of the other.
        pose: of the other's base in the one's. Shape (4, 4).
    """
    least = math.inf
    for j in range(int(others[N_CAPSULES])):
        c, d = moved(pose, end_of(other_work, j, 0)), moved(pose, end_of(other_work, j, 3))
        stands = others[CAPSULES + CAPSULE_WORDS * j] == 0.0
        for i in range(int(words[N_CAPSULES])):
            if stands and words[CAPSULES + CAPSULE_WORDS * i] == 0.0:
                continue
            apart = axes_apart(end_of(work, i, 0), end_of(work, i, 3), c, d) - radius_of(words, i)
            least = min(least, apart - radius_of(others, j))
    return least


@lean_kernel
def moved(pose: Floats, p: Vec) -> Vec:
    """A point (3,) by a pose (4, 4)."""
    return (
        pose[0, 0] * p[0] + pose[0, 1] * p[1] + pose[0, 2] * p[2] + pose[0, 3],
        pose[1, 0] * p[0] + pose[1, 1] * p[1] + pose[1, 2] * p[2] + pose[1, 3],
        pose[2, 0] * p[0] + pose[2, 1] * p[1] + pose[2, 2] * p[2] + pose[2, 3],
    )


class ArmPair:
    """Two arms.

    Args:
        one, other: whose capsules count; their fences do not.
        pose: of the other's base in the one's. Shape (4, 4).
    """

    def __init__(self, one: FenceSet, other: FenceSet, pose: Floats) -> None:
        self._words, self._others, self._pose = one.words, other.words, np.ascontiguousarray(pose)
        self._work, self._other_work = np.zeros(N_WORK), np.zeros(N_WORK)

    def distance(self, q: Floats, other_q: Floats) -> float:
        """Distance of the arms, m, at joint positions (n,) of each."""
        place_capsules(q, self._words, self._work)
        place_capsules(other_q, self._others, self._other_work)
        return float(arms_apart(self._words, self._work, self._others, self._other_work, self._pose))


def pose_between(one: Stand, other: Stand) -> Floats:
    """Pose of the other's base in the one's. Shape (4, 4)."""
    return inverse(_pose(one)) @ _pose(other)


def _pose(stand: Stand) -> Floats:
    roll, pitch, yaw = (angle * RAD_PER_DEG for angle in stand.rpy_deg)
    return transform(rpy(roll, pitch, yaw), np.array(stand.position_m))
